//! PRESENTATION coherent_access: the changes of a coherent set become visible as a whole or not at all
//! (RTPS 2.5 section 8.7.6, DDS 1.4 section 2.2.3.6).
//!
//! All changes of a set name its first one. A set has ended when the next change in order, of whatever kind, does not name
//! it: most writers send one without payload at once for that. What that names differs between vendors (nothing, no set,
//! or the set that it ends); it can be nothing but an end. Until then its changes wait here, in a place between
//! the WriterProxy, which brings them in order, and the cache. Numbers that a GAP calls irrelevant, or that the
//! content filter is not interested in, are no loss to a set. A set that lacks a change is dropped, and counts as lost.
//!
//! Sets of all scopes are kept together by their writer; where the application accesses groups, ended ones wait on
//! with the [`Groups`](super::groups::Groups).

use super::RejectedReason;
use super::admission::Place;
use super::cache::Cache;
use super::change::{Change, Extras};
use super::events::Events;
use super::groups::{GroupSet, StagedSet};
use super::writer_proxy::WriterProxy;
use crate::RemoteEndpoint;
use crate::qos::PresentationScope;
use crate::wire::{GroupDigest, Guid, HeartbeatGroup, SequenceNumber};

/// Changes of the sets of one writer that wait.
const MAX_CHANGES: usize = 1 << 16;
/// Bytes of their payloads.
const MAX_BYTES: usize = 256 << 20;

/// The coherent sets of one writer.
#[derive(Debug)]
pub(super) struct CoherentSets {
    writer: Guid,
    /// Whether it writes sets together with others.
    offers_groups: bool,
    /// Sets that begin before it lack a change.
    whole_from: SequenceNumber,
    open: Option<OpenSet>,
    /// The writers of its publisher, where it has said so.
    group: Option<GroupDigest>,
    /// The newest set of its publisher that it has ended.
    ended: SequenceNumber,
}

/// A set that has not ended yet.
#[derive(Debug)]
struct OpenSet {
    first: SequenceNumber,
    /// Where the set of the publisher begins that it is a part of.
    group_first: Option<SequenceNumber>,
    changes: Vec<Change>,
    bytes: usize,
}

impl CoherentSets {
    pub(super) fn new(remote: &RemoteEndpoint) -> Self {
        let presentation = remote.qos.presentation;
        Self {
            writer: remote.guid,
            offers_groups: presentation.coherent && presentation.scope == PresentationScope::Group,
            whole_from: SequenceNumber::ZERO,
            open: None,
            group: None,
            ended: SequenceNumber::ZERO,
        }
    }

    /// Something before `next` is missing for good.
    fn broken_before(&mut self, next: SequenceNumber, cache: &mut Cache, events: &mut Events) {
        self.whole_from = self.whole_from.max(next);
        if self.open.as_ref().is_some_and(|set| set.first < next) {
            self.drop_open(cache, events);
        }
    }

    /// Drops what has not ended.
    pub(super) fn drop_open(&mut self, cache: &mut Cache, events: &mut Events) {
        if let Some(set) = self.open.take() {
            cache.staged -= set.changes.len();
            events.lost(self.writer, set.changes.len() as u64);
        }
    }

    /// Looks for room for the next change in order, and ends the set before it.
    pub(super) fn admit(
        &mut self,
        change: &Change,
        cache: &mut Cache,
        events: &mut Events,
    ) -> Result<Place, RejectedReason> {
        let extras = change.extras.as_deref();
        let first = extras.and_then(Extras::set);
        let is_other = |set: &OpenSet| Some(set.first) != first;
        if self.open.as_ref().is_some_and(is_other) {
            self.end(extras, cache, events)?;
        }
        if first.is_none()
            && let Some(extras) = extras
        {
            self.note_end(extras, cache);
        }
        match first {
            _ if change.is_void() => Ok(Place::Nowhere),
            Some(first) => self.admit_member(first, change, cache, events),
            None => cache.admit(change),
        }
    }

    /// Puts a change that has been admitted into its set.
    pub(super) fn add(&mut self, change: Change, cache: &mut Cache) {
        let extras = change.extras.as_deref();
        let Some(first) = extras.and_then(Extras::set) else {
            return;
        };
        let group_first = extras.and_then(|extras| extras.group_set);
        let set = self.open.get_or_insert_with(|| OpenSet {
            first,
            group_first,
            changes: Vec::new(),
            bytes: 0,
        });
        set.bytes += change.payload.len();
        set.changes.push(change);
        cache.staged += 1;
    }

    /// What a HEARTBEAT says of the publisher.
    pub(super) fn note_group(&mut self, group: Option<&HeartbeatGroup>) {
        if let Some(group) = group {
            self.group = Some(group.writers);
        }
    }

    /// Whether it has yet to end its part of a set.
    fn awaits(&self, set: &GroupSet) -> bool {
        let has_begun = |open: &OpenSet| open.group_first == Some(set.first);
        let is_of_group = self.group.is_some() && self.group == set.writers;
        self.open.as_ref().is_some_and(has_begun) || (is_of_group && self.ended < set.first)
    }

    fn admit_member(
        &mut self,
        first: SequenceNumber,
        change: &Change,
        cache: &mut Cache,
        events: &mut Events,
    ) -> Result<Place, RejectedReason> {
        if first < self.whole_from {
            events.lost(self.writer, 1);
            return Ok(Place::Nowhere);
        }
        let is_full = self.open.as_ref().is_some_and(|set| {
            set.changes.len() >= MAX_CHANGES
                || set.bytes.saturating_add(change.payload.len()) > MAX_BYTES
        });
        match cache.has_room_for_staged() {
            Ok(()) if !is_full => Ok(Place::Set),
            Err(reason) if !is_full && !cache.is_drained() => Err(reason),
            // There will never be room for all of it.
            _ => {
                events.lost(self.writer, 1);
                self.broken_before(change.sequence.next(), cache, events);
                Ok(Place::Nowhere)
            }
        }
    }

    /// Ends the open set: `next` is what the change that is not of it says.
    fn end(
        &mut self,
        next: Option<&Extras>,
        cache: &mut Cache,
        events: &mut Events,
    ) -> Result<(), RejectedReason> {
        let Some(set) = &self.open else {
            return Ok(());
        };
        let group_first = set.group_first.filter(|_| cache.groups.is_some());
        if group_first.is_none()
            && let Err(reason) = cache.fits(&set.changes)
        {
            if !cache.is_drained() {
                return Err(reason);
            }
            self.drop_open(cache, events);
            return Ok(());
        }
        let Some(set) = self.open.take() else {
            return Ok(());
        };
        match group_first {
            None => cache.publish(set.changes, events),
            Some(first) => {
                self.group = next.and_then(|next| next.writers).or(self.group);
                self.ended = self.ended.max(first);
                let id = GroupSet {
                    participant: self.writer.prefix,
                    writers: self.group,
                    first,
                };
                cache.stage(StagedSet::new(id, set.changes), events);
            }
        }
        Ok(())
    }

    /// The writer has ended its part of a set of its publisher, in which it may have written nothing.
    fn note_end(&mut self, extras: &Extras, cache: &Cache) {
        if cache.groups.is_some()
            && let Some(first) = extras.group_set
        {
            self.group = extras.writers.or(self.group);
            self.ended = self.ended.max(first);
        }
    }
}

impl WriterProxy {
    /// Something before `next` is missing for good.
    pub(super) fn break_sets(
        &mut self,
        next: SequenceNumber,
        cache: &mut Cache,
        events: &mut Events,
    ) {
        if let Some(sets) = &mut self.sets {
            sets.broken_before(next, cache, events);
        }
    }

    /// Whether the writer has yet to end its part of a set of its publisher, as far as is known.
    pub(super) fn awaits(&self, set: &GroupSet) -> bool {
        let is_unheard = self.is_reliable() && !self.has_heard();
        let sets = self.sets.as_ref();
        sets.is_some_and(|sets| (is_unheard && sets.offers_groups) || sets.awaits(set))
    }
}

/// Looks for room for the next change in order, with its coherent set if it has one.
#[inline]
pub(super) fn admit(
    sets: &mut Option<Box<CoherentSets>>,
    change: &Change,
    cache: &mut Cache,
    events: &mut Events,
) -> Result<Place, RejectedReason> {
    match sets {
        None => cache.admit(change),
        Some(sets) => sets.admit(change, cache, events),
    }
}

/// Puts a change where there was room for it.
#[inline]
pub(super) fn store(
    sets: &mut Option<Box<CoherentSets>>,
    place: Place,
    change: Change,
    cache: &mut Cache,
    events: &mut Events,
) {
    match (sets, place) {
        (Some(sets), Place::Set) => sets.add(change, cache),
        _ => cache.store(place, change, events),
    }
}
