//! WriterProxy: what a reader knows of the changes of one matched writer (RTPS 2.5 sections 8.4.10.4 and 8.4.11).
//!
//! All numbers below `next` are dealt with: given to the cache, irrelevant, or lost. Above it `done` has those
//! that are dealt with or held; what is missing lies between. Changes reach the cache in order. When the cache
//! has no room, `next` stays where it is, so that the writer is not told of the change and waits in its turn.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use super::acknack::Responder;
use super::cache::Cache;
use super::change::{Arrival, Change, Meaning, Payload, Terms};
use super::coherent::{self, CoherentSets};
use super::events::Events;
use super::heartbeat_filter::{HeartbeatFilter, MARGIN};
use super::held::Held;
use super::liveliness::Lease;
use super::ranges::Ranges;
use super::reassembly::Reassembly;
use super::{ReaderConfig, RejectedReason};
use crate::RemoteEndpoint;
use crate::qos::Durability;
use crate::wire::{Gap, Guid, Heartbeat, SequenceNumber, SequenceNumberSet};

/// What the GUID prefixes of Fast DDS begin with: its vendor id, as RTPS 2.5 section 9.3.1.5 asks for.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// Ranges of numbers that are dealt with beyond missing ones.
const MAX_RANGES: usize = 4096;

#[derive(Debug)]
pub(super) struct WriterProxy {
    pub(super) guid: Guid,
    /// Where its answers go.
    pub(super) destinations: Option<Arc<[SocketAddr]>>,
    pub(super) lease: Lease,
    terms: Terms,
    pub(super) reassembly: Reassembly,
    pub(super) responder: Responder,
    pub(super) filter: HeartbeatFilter,
    /// Where the reader has asked for coherent access.
    pub(super) sets: Option<Box<CoherentSets>>,
    reliable: bool,
    /// The writer keeps history for this reader.
    has_past: bool,
    /// The highest number of the first HEARTBEAT: where that history ends.
    past: SequenceNumber,
    /// The reader is VOLATILE and the writer keeps history for readers that are not.
    skips_history: bool,
    next: SequenceNumber,
    /// The highest number that the writer is known to have used.
    highest: SequenceNumber,
    /// The highest number of a HEARTBEAT.
    announced: SequenceNumber,
    /// Whether it is known where the stream begins for this reader.
    started: bool,
    /// Whether a GAP has told so before any HEARTBEAT.
    told: bool,
    /// Whether a HEARTBEAT has come since the match.
    heard: bool,
    /// Whether the cache had no room for the change at `next`.
    blocked: bool,
    /// Bytes of the last change that came, which tell what those will have that are missing.
    change_size: usize,
    done: Ranges,
    held: Held,
}

impl WriterProxy {
    pub(super) fn new(now: Instant, config: &ReaderConfig, remote: &RemoteEndpoint) -> Self {
        let reliable = config.qos.reliability.is_reliable() && remote.qos.reliability.is_reliable();
        let presentation = config.qos.presentation;
        Self {
            guid: remote.guid,
            destinations: destinations(remote),
            lease: Lease::new(now, remote.qos.liveliness),
            terms: Terms {
                lifespan: remote.qos.lifespan.0.to_std(),
                presents: presentation.coherent || presentation.ordered,
            },
            reassembly: Reassembly::new(config.max_sample_size, reliable),
            responder: Responder::default(),
            filter: HeartbeatFilter::default(),
            sets: presentation
                .coherent
                .then(|| Box::new(CoherentSets::new(remote))),
            reliable,
            has_past: reliable
                && config.qos.durability != Durability::Volatile
                && remote.qos.durability != Durability::Volatile,
            past: SequenceNumber::ZERO,
            skips_history: config.qos.durability == Durability::Volatile
                && remote.qos.durability != Durability::Volatile,
            next: SequenceNumber(1),
            highest: SequenceNumber::ZERO,
            announced: SequenceNumber::ZERO,
            started: false,
            told: false,
            heard: false,
            blocked: false,
            change_size: 0,
            done: Ranges::default(),
            held: Held::new(config.max_sample_size),
        }
    }

    /// Takes over what has changed of a writer that is matched already.
    pub(super) fn update(&mut self, remote: &RemoteEndpoint) {
        self.destinations = destinations(remote);
        self.lease.update(remote.qos.liveliness);
        self.terms.lifespan = remote.qos.lifespan.0.to_std();
    }

    /// Goes on at `next`, with ACKNACKs counted from `count`; 1 or less is no progress to go on from.
    pub(super) fn resume(&mut self, next: SequenceNumber, count: i32) {
        self.responder.resume(count);
        if next > self.next {
            self.next = next;
            self.highest = next.previous();
            self.started = true;
        }
    }

    pub(super) fn is_reliable(&self) -> bool {
        self.reliable
    }

    pub(super) fn is_blocked(&self) -> bool {
        self.blocked
    }

    pub(super) fn has_heard(&self) -> bool {
        self.heard
    }

    /// Whether all has come that the writer had to repeat.
    pub(super) fn has_history(&self) -> bool {
        !self.has_past || (self.heard && self.next > self.past)
    }

    /// The number below which all is dealt with.
    pub(super) fn next(&self) -> SequenceNumber {
        self.next
    }

    pub(super) fn announced(&self) -> SequenceNumber {
        self.announced
    }

    /// The newest change that is held.
    pub(super) fn newest_held(&self) -> SequenceNumber {
        self.held.newest().unwrap_or(SequenceNumber::ZERO)
    }

    /// How many changes are held.
    pub(super) fn held_count(&self) -> usize {
        self.held.len()
    }

    /// How many ranges of numbers it remembers.
    #[cfg(test)]
    pub(super) fn ranges(&self) -> usize {
        self.done.len()
    }

    /// The base of an ACKNACK: what is below it is acknowledged. A set cannot begin where not all its numbers
    /// would exist, but a writer that far is no honest one.
    pub(super) fn base(&self) -> SequenceNumber {
        let highest = SequenceNumber(i64::MAX).plus(-SequenceNumberSet::MAX_SPAN);
        self.next.min(highest)
    }

    /// The base of the ACKNACK that greets the writer. To an empty set from the first number on every writer
    /// answers with a HEARTBEAT at once, but Fast DDS does so only where the set begins at 0, which others take
    /// for malformed.
    pub(super) fn greeting_base(&self) -> SequenceNumber {
        let is_fast_dds = self.guid.prefix.0.starts_with(&FAST_DDS);
        if is_fast_dds && !self.started && self.next == SequenceNumber(1) {
            SequenceNumber::ZERO
        } else {
            self.base()
        }
    }

    /// About how many changes have so many bytes.
    pub(super) fn changes_in(&self, bytes: usize) -> usize {
        bytes / self.change_size.max(1)
    }

    /// A change of so many bytes is coming.
    pub(super) fn note_size(&mut self, bytes: usize) {
        self.change_size = bytes;
    }

    /// Whether a change with this number and so many bytes is wanted now.
    pub(super) fn wants(&self, sequence: SequenceNumber, bytes: usize) -> bool {
        if sequence < self.next || sequence.0 == i64::MAX {
            return false;
        }
        if !self.reliable {
            return true;
        }
        if self.done.contains(sequence.0) {
            return false;
        }
        let has_room = self.held.has_room(bytes) && self.done.len() < MAX_RANGES;
        let is_near = !self.started || sequence <= self.highest.plus(MARGIN);
        sequence == self.next || (has_room && is_near)
    }

    /// Takes in a change that is wanted, whatever it turns out to be.
    pub(super) fn receive(
        &mut self,
        config: &ReaderConfig,
        arrival: &Arrival<'_>,
        payload: Payload<'_>,
        cache: &mut Cache,
        events: &mut Events,
    ) {
        self.note_size(payload.as_slice().len());
        match arrival.meaning(config, payload.as_slice()) {
            Meaning::Update(instance) => {
                let change = arrival.to_change(instance, payload.into_bytes(), &self.terms);
                self.accept(change, cache, events);
            }
            // It may say that a set has ended, in its turn.
            Meaning::Irrelevant if self.sets.is_some() => {
                self.accept(arrival.to_void(&self.terms), cache, events);
            }
            Meaning::Irrelevant => self.skip(arrival.sequence, cache, events),
            Meaning::Malformed => self.lose(arrival.sequence, cache, events),
        }
    }

    /// Deals with a change that has come, but cannot be taken in.
    pub(super) fn lose(
        &mut self,
        sequence: SequenceNumber,
        cache: &mut Cache,
        events: &mut Events,
    ) {
        self.skip(sequence, cache, events);
        events.lost(self.guid, 1);
        self.break_sets(sequence.next(), cache, events);
    }

    fn accept(&mut self, change: Change, cache: &mut Cache, events: &mut Events) {
        let sequence = change.sequence;
        self.drop_partials_to(sequence);
        if !self.reliable {
            self.pass(sequence, cache, events);
            match coherent::admit(&mut self.sets, &change, cache, events) {
                Ok(place) => coherent::store(&mut self.sets, place, change, cache, events),
                Err(reason) => {
                    events.rejected(self.guid, change.instance, reason);
                    self.break_sets(sequence.next(), cache, events);
                }
            }
            return;
        }
        self.highest = self.highest.max(sequence);
        if sequence == self.next {
            match coherent::admit(&mut self.sets, &change, cache, events) {
                Ok(place) => {
                    coherent::store(&mut self.sets, place, change, cache, events);
                    self.next = sequence.next();
                    self.advance(cache, events);
                    return;
                }
                Err(reason) => self.block(&change, reason, events),
            }
        }
        self.hold(change);
    }

    /// Deals with a number that has come to nothing.
    pub(super) fn skip(
        &mut self,
        sequence: SequenceNumber,
        cache: &mut Cache,
        events: &mut Events,
    ) {
        self.drop_partials_to(sequence);
        if self.reliable {
            self.highest = self.highest.max(sequence);
            self.done.insert(sequence.0..sequence.next().0);
            self.advance(cache, events);
        } else {
            self.pass(sequence, cache, events);
        }
    }

    /// Everything below `next` is dealt with.
    pub(super) fn skip_to(&mut self, next: SequenceNumber, cache: &mut Cache, events: &mut Events) {
        if next > self.next {
            self.started = true;
            self.highest = self.highest.max(next.previous());
            self.irrelevant(self.next, next);
            self.advance(cache, events);
        }
    }

    /// GAP. What it says of numbers far beyond the known ones is not believed; a HEARTBEAT has to come first.
    pub(super) fn gap(&mut self, gap: &Gap, cache: &mut Cache, events: &mut Events) {
        let believed = if self.started {
            self.highest.plus(MARGIN)
        } else {
            SequenceNumber(i64::MAX)
        };
        let is_start = !self.started;
        self.told |= is_start;
        self.irrelevant(gap.start, gap.list.base.min(believed));
        for number in gap.list.iter().filter(|number| *number < believed) {
            self.irrelevant(number, number.next());
        }
        if is_start && !self.has_past {
            // Before what has come already gets its turn: the sets that begin here are whole.
            self.break_sets(gap.list.base.min(believed), cache, events);
        }
        self.advance(cache, events);
    }

    /// Deals with irrelevant numbers from `start` to below `end`.
    fn irrelevant(&mut self, start: SequenceNumber, end: SequenceNumber) {
        let start = start.max(self.next);
        if end <= start {
            return;
        }
        if !self.reliable {
            if start == self.next {
                self.next = end;
            }
            return;
        }
        if start > self.next && self.done.len() >= MAX_RANGES {
            return;
        }
        self.done.insert(start.0..end.0);
        if !self.reassembly.is_empty() {
            self.reassembly.remove(start..=end.previous());
        }
    }

    /// HEARTBEAT; returns whether it is to be answered.
    pub(super) fn heartbeat(
        &mut self,
        heartbeat: &Heartbeat,
        cache: &mut Cache,
        events: &mut Events,
    ) -> bool {
        if !std::mem::replace(&mut self.heard, true) {
            self.past = heartbeat.last;
        }
        if !self.started {
            self.start(heartbeat, cache, events);
        } else if !self.filter.is_believable(heartbeat, self.highest) {
            return true;
        }
        if let Some(sets) = &mut self.sets {
            sets.note_group(heartbeat.group.as_ref());
        }
        self.highest = self.highest.max(heartbeat.last);
        self.announced = self.announced.max(heartbeat.last);
        if heartbeat.first > self.next {
            let lost = self.done.insert(self.next.0..heartbeat.first.0);
            if lost > 0 {
                events.lost(self.guid, lost);
                self.break_sets(heartbeat.first, cache, events);
            }
            self.reassembly
                .remove(SequenceNumber::ZERO..=heartbeat.first.previous());
        }
        self.advance(cache, events);
        if !heartbeat.is_final {
            self.responder.request();
        }
        !heartbeat.is_final || self.lacks_something()
    }

    /// The first HEARTBEAT tells where the stream begins. A VOLATILE reader has no use for what a writer keeps
    /// for others, and not every writer says in a GAP where the new begins: then it begins with the first change
    /// that has come since the match, or after all that there is.
    fn start(&mut self, heartbeat: &Heartbeat, cache: &mut Cache, events: &mut Events) {
        self.started = true;
        let start = if self.skips_history && !self.told && self.next == SequenceNumber(1) {
            let first_held = self.held.first().map(|change| change.sequence);
            first_held.unwrap_or_else(|| heartbeat.last.next())
        } else {
            heartbeat.first
        };
        if !self.has_past {
            self.break_sets(start, cache, events);
        }
        if start > self.next {
            self.done.insert(self.next.0..start.0);
            self.reassembly
                .remove(SequenceNumber::ZERO..=start.previous());
        }
    }

    /// Whether something is missing that the writer has announced.
    pub(super) fn lacks_something(&self) -> bool {
        self.done.first_missing(self.next.0) <= self.announced.0
    }

    /// The numbers to ask for, as many as an ACKNACK can span; those in the making included.
    pub(super) fn missing(&self) -> impl Iterator<Item = SequenceNumber> + '_ {
        let span = SequenceNumberSet::MAX_SPAN;
        let end = self.next.plus(span).min(self.announced.next());
        self.done.missing(self.next.0..end.0).map(SequenceNumber)
    }

    /// Gives the cache what has become due, in order, until something is missing or there is no room; returns
    /// whether `next` has moved.
    pub(super) fn advance(&mut self, cache: &mut Cache, events: &mut Events) -> bool {
        if self.done.is_empty() {
            return false;
        }
        let before = self.next;
        let end = SequenceNumber(self.done.first_missing(self.next.0));
        while let Some(first) = self.held.first().filter(|first| first.sequence < end) {
            match coherent::admit(&mut self.sets, first, cache, events) {
                Ok(place) => {
                    if let Some(change) = self.held.pop_first() {
                        coherent::store(&mut self.sets, place, change, cache, events);
                    }
                }
                Err(reason) => {
                    self.next = first.sequence;
                    if !std::mem::replace(&mut self.blocked, true) {
                        events.rejected(self.guid, first.instance, reason);
                    }
                    return self.next > before;
                }
            }
        }
        self.blocked = false;
        self.next = end;
        self.done.remove_below(end.0);
        self.next > before
    }

    fn block(&mut self, change: &Change, reason: RejectedReason, events: &mut Events) {
        if !std::mem::replace(&mut self.blocked, true) {
            events.rejected(self.guid, change.instance, reason);
        }
    }

    fn hold(&mut self, change: Change) {
        self.done
            .insert(change.sequence.0..change.sequence.next().0);
        self.held.insert(change);
    }

    /// Best effort: moves on behind `sequence`; what has not come before it is lost.
    fn pass(&mut self, sequence: SequenceNumber, cache: &mut Cache, events: &mut Events) {
        let is_first = !std::mem::replace(&mut self.started, true);
        if !is_first {
            events.lost(self.guid, sequence.0.abs_diff(self.next.0));
        }
        if sequence != self.next {
            self.break_sets(sequence, cache, events);
        }
        self.next = sequence.next();
        self.highest = sequence;
    }

    /// Drops the parts of a sample that is dealt with; in best effort of all before it, too.
    fn drop_partials_to(&mut self, sequence: SequenceNumber) {
        if self.reassembly.is_empty() {
            return;
        }
        let from = if self.reliable {
            sequence
        } else {
            SequenceNumber::ZERO
        };
        self.reassembly.remove(from..=sequence);
    }
}

/// One address is enough; the best comes first.
fn destinations(remote: &RemoteEndpoint) -> Option<Arc<[SocketAddr]>> {
    remote.unicast.first().map(|address| Arc::from([*address]))
}
