//! Coherent sets (RTPS 2.5 section 8.7.6; DDS 1.4 sections 2.2.2.4.1.10 and 2.2.3.6).
//!
//! Each change of a set says which one the set begins with. That the set has ended is said at once, by a DATA without
//! payload whose PID_COHERENT_SET is SEQUENCENUMBER_UNKNOWN, so that readers need not wait for the next change. It goes to
//! readers that have asked for coherent access alone; to the others its number is a gap.
//!
//! Members of a set are changes like others: the window holds them back, readers may acknowledge and ask for them while
//! the set is open, and KEEP_LAST replaces them. A set that shall arrive whole from a KEEP_LAST writer must not have more
//! changes of an instance than its depth.

use std::collections::VecDeque;

use super::{Group, Writer};
use crate::history::{HistoryCache, Membership};
use crate::qos::{Presentation, PresentationScope};
use crate::wire::{GroupDigest, HeartbeatGroup, SequenceNumber, Timestamp};

/// The set that is open, and what says that earlier ones have ended.
#[derive(Clone, Debug, Default)]
pub(super) struct CoherentSets {
    open: Option<OpenSet>,
    ends: VecDeque<SetEnd>,
    /// So many ends may there be before those without a set are looked for.
    most_ends: usize,
    /// The newest group sequence number that is known, and the writers of the group.
    group: Option<(SequenceNumber, GroupDigest)>,
}

/// A set that has begun.
#[derive(Clone, Copy, Debug, Default)]
struct OpenSet {
    first: Option<SequenceNumber>,
}

/// The end of a set.
#[derive(Clone, Copy, Debug)]
struct SetEnd {
    /// The first change of the set.
    first: SequenceNumber,
    /// What says that it has ended.
    sequence: SequenceNumber,
}

impl SetEnd {
    /// Whether a change of the set is still there.
    fn has_members(&self, history: &HistoryCache) -> bool {
        let first = history.next_from(self.first);
        first.is_some_and(|(first, _)| first < self.sequence)
    }
}

impl CoherentSets {
    const FEW_ENDS: usize = 8;

    /// Whether a change that is written now belongs to nothing.
    fn is_idle(&self) -> bool {
        self.open.is_none()
    }
}

impl Writer {
    /// What is written from now on is one coherent set; without effect where PRESENTATION does not offer coherent access.
    pub fn begin_coherent(&mut self) {
        if self.config.qos.presentation.coherent && self.sets.is_idle() {
            self.sets.open = Some(OpenSet::default());
        }
    }

    /// Ends the set that was begun, and says so, as of `timestamp`. Gives the number that this takes; a set without changes takes
    /// none.
    pub fn end_coherent(&mut self, timestamp: Timestamp) -> Option<SequenceNumber> {
        let first = self.sets.open.take()?.first?;
        let membership = Membership {
            coherent_set: Some(SequenceNumber::UNKNOWN),
            ..Membership::default()
        };
        Some(self.end_set(first, membership, timestamp))
    }

    /// As [`end_coherent`](Self::end_coherent) for a writer of a group, whose set is still open there. Where any of its writers
    /// has written, each says that the set has ended, or else readers would wait for those that have not.
    pub fn end_coherent_in(
        &mut self,
        group: &Group,
        timestamp: Timestamp,
    ) -> Option<SequenceNumber> {
        if self.config.qos.presentation.scope != PresentationScope::Group {
            return self.end_coherent(timestamp);
        }
        let open = self.sets.open.take().unwrap_or_default();
        let stamp = group.stamp_of_end();
        stamp.set?;
        self.sets.group = Some((group.last(), group.writers()));
        let membership = Membership {
            coherent_set: Some(SequenceNumber::UNKNOWN),
            group: Some(stamp),
            writers: Some(group.writers()),
        };
        let first = open.first.unwrap_or_else(|| self.last.next());
        Some(self.end_set(first, membership, timestamp))
    }

    /// The set and the group of the change that is written next.
    pub(super) fn next_membership(&mut self, group: Option<&mut Group>) -> Option<Box<Membership>> {
        if self.sets.is_idle() && group.is_none() {
            return None;
        }
        if group.as_ref().is_some_and(|group| group.has_open_set()) {
            self.begin_coherent();
        }
        let next = self.last.next();
        let open = self.sets.open.as_mut();
        let coherent_set = open.map(|set| *set.first.get_or_insert(next));
        let is_stamped = is_group(self.config.qos.presentation);
        let group = group.filter(|_| is_stamped).map(|group| {
            let stamp = group.stamp();
            self.sets.group = Some((group.last(), group.writers()));
            stamp
        });
        let membership = Membership {
            coherent_set,
            group,
            writers: None,
        };
        (membership != Membership::default()).then(|| Box::new(membership))
    }

    /// What a HEARTBEAT of changes from `first` on says of the group.
    pub(super) fn heartbeat_group(&self, first: SequenceNumber) -> Option<HeartbeatGroup> {
        let (current, writers) = self.sets.group?;
        let stamp = |sequence: Option<SequenceNumber>| {
            let change = self.history.get(sequence?)?;
            Some(change.membership.as_ref()?.group?.sequence)
        };
        let oldest = self.history.next_from(first).map(|(oldest, _)| oldest);
        Some(HeartbeatGroup {
            current,
            first: stamp(oldest).unwrap_or_else(|| current.next()),
            last: stamp(self.history.last()).unwrap_or(current),
            writers,
            secure_writers: GroupDigest::default(),
        })
    }

    /// Ends of sets that have no changes any more tell late joiners nothing.
    pub(super) fn drop_set_ends(&mut self, done: SequenceNumber) {
        let Self { history, sets, .. } = self;
        while let Some(end) = sets.ends.front()
            && end.sequence <= done
            && !end.has_members(history)
        {
            history.remove(end.sequence);
            sets.ends.pop_front();
        }
        if sets.ends.len() > sets.most_ends.max(CoherentSets::FEW_ENDS) {
            sets.ends.retain(|end| {
                let is_needed = end.sequence > done || end.has_members(history);
                if !is_needed {
                    history.remove(end.sequence);
                }
                is_needed
            });
            sets.most_ends = 2 * sets.ends.len();
        }
    }

    fn end_set(
        &mut self,
        first: SequenceNumber,
        membership: Membership,
        timestamp: Timestamp,
    ) -> SequenceNumber {
        self.last = self.last.next();
        if self.keeps_past() || !self.readers.is_empty() {
            self.history
                .insert_set_end(self.last, membership, timestamp);
        }
        if self.keeps_past() {
            let sequence = self.last;
            self.sets.ends.push_back(SetEnd { first, sequence });
        }
        self.skip_without_readers();
        self.last
    }
}

/// Whether changes are numbered throughout the publisher.
fn is_group(presentation: Presentation) -> bool {
    let is_used = presentation.coherent || presentation.ordered;
    is_used && presentation.scope == PresentationScope::Group
}
