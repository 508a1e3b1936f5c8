//! Coherent sets of GROUP scope: the parts that the writers of one publisher have in several readers of one subscriber
//! (RTPS 2.5 section 8.7.6).
//!
//! A reader knows when its writers have ended their parts, but not what other readers still wait for. So parts that
//! have ended are staged, and whoever has all the readers in hand releases them together: when one of them has staged a
//! [`GroupSet`] and none of them [awaits](Reader::awaits_group) it.

use std::collections::VecDeque;

use super::Reader;
use super::cache::Cache;
use super::change::Change;
use super::events::Events;
use crate::qos::PresentationScope;
use crate::wire::{GroupDigest, GuidPrefix, SequenceNumber};

/// Parts of sets that wait to be released; when there are more, the oldest wait no longer.
const MAX_SETS: usize = 4096;

/// The name of a coherent set of a publisher.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct GroupSet {
    /// The participant of the publisher.
    pub participant: GuidPrefix,
    /// The writers of the publisher, where they say who they are.
    pub writers: Option<GroupDigest>,
    /// The group sequence number of the first change.
    pub first: SequenceNumber,
}

/// What one writer wrote in such a set.
#[derive(Debug)]
pub(super) struct StagedSet {
    id: GroupSet,
    changes: Vec<Change>,
}

impl StagedSet {
    pub(super) fn new(id: GroupSet, changes: Vec<Change>) -> Self {
        Self { id, changes }
    }
}

/// The parts that have ended, oldest first.
pub(super) type Groups = VecDeque<StagedSet>;

impl Reader {
    /// Has sets of GROUP scope wait until they are released; false where PRESENTATION asks for no such sets. Without that
    /// each reader shows its part by itself.
    pub fn stage_groups(&mut self) -> bool {
        let presentation = self.config.qos.presentation;
        let has_groups = presentation.coherent && presentation.scope == PresentationScope::Group;
        if has_groups {
            self.cache.groups.get_or_insert_default();
        }
        has_groups
    }

    /// The sets that parts are staged of, in the order in which they ended; one may be named several times.
    pub fn staged_groups(&self) -> impl Iterator<Item = GroupSet> + '_ {
        self.cache.groups.iter().flatten().map(|set| set.id)
    }

    /// Whether a writer of the publisher is matched that has yet to end its part, or that has not been heard so far and
    /// may be one of them.
    pub fn awaits_group(&self, set: &GroupSet) -> bool {
        self.proxies
            .keys()
            .filter(|writer| writer.prefix == set.participant)
            .filter_map(|writer| self.proxies.get(writer))
            .any(|proxy| proxy.awaits(set))
    }

    /// Makes the parts of a set visible.
    pub fn release_group(&mut self, set: &GroupSet) {
        self.cache.release(set, &mut self.events);
    }
}

impl Cache {
    /// Keeps a part of a set until it is released.
    pub(super) fn stage(&mut self, set: StagedSet, events: &mut Events) {
        let Some(groups) = &mut self.groups else {
            return;
        };
        groups.push_back(set);
        if groups.len() > MAX_SETS
            && let Some(oldest) = groups.pop_front()
        {
            self.publish(oldest.changes, events);
        }
        events.data_available();
    }

    fn release(&mut self, id: &GroupSet, events: &mut Events) {
        let Some(groups) = &mut self.groups else {
            return;
        };
        let (released, rest) = std::mem::take(groups)
            .into_iter()
            .partition::<Groups, _>(|set| set.id == *id);
        *groups = rest;
        for set in released {
            self.publish(set.changes, events);
        }
    }
}
