//! ReaderProxy: what a writer knows of one matched reader (RTPS 2.5 section 8.4.7.2).

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::WriterTiming;
use super::count::LastCount;
use super::interest::Interest;
use super::outbox::Outbox;
use crate::RemoteEndpoint;
use crate::count::Count;
use crate::wire::{AckNack, Guid, NackFrag, SequenceNumber};

/// How far a reader has got.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Base {
    /// It has acknowledged everything up to this change.
    pub(super) acknowledged: SequenceNumber,
    /// The first change that it lacks of those that were sent to all readers: a late joiner that fetches the past does not
    /// hold the others up.
    pub(super) window: SequenceNumber,
}

impl Base {
    /// As far as both have got.
    pub(super) fn min(self, other: Self) -> Self {
        Self {
            acknowledged: self.acknowledged.min(other.acknowledged),
            window: self.window.min(other.window),
        }
    }
}

/// A matched reader.
#[derive(Debug)]
pub(super) struct ReaderProxy {
    guid: Guid,
    /// Where it is reached: one address, or none.
    address: Arc<[SocketAddr]>,
    is_reliable: bool,
    /// The topic, where it expects inline QoS.
    inline_topic: Option<String>,
    /// The first change that concerns it.
    start: SequenceNumber,
    /// It does not want what the writer keeps of the past.
    pub(super) skips_past: bool,
    /// The first change that was sent to all readers while it was among them.
    live_from: SequenceNumber,
    /// It has acknowledged everything up to this change.
    acknowledged: SequenceNumber,
    acknack_count: LastCount,
    nack_frag_count: LastCount,
    heartbeat_period: Duration,
    next_heartbeat: Instant,
    /// Of the last HEARTBEAT that went to it alone.
    pub(super) heartbeat_count: Count,
    answered_at: Option<Instant>,
    /// The last change of which it told how far it has got, and the first fragment of that which it lacked.
    progress: Option<(SequenceNumber, u32)>,
    /// It used to tell that, and was waited for in vain.
    is_silent: bool,
    /// Whether it stands in the writer's queue of readers to be sent something.
    pub(super) is_queued: bool,
    pub(super) interest: Interest,
    pub(super) outbox: Outbox,
}

impl ReaderProxy {
    /// For a reader that changes from `start` on concern, and that gets those from `live_from` on like all others.
    pub(super) fn new(
        now: Instant,
        remote: &RemoteEndpoint,
        is_reliable: bool,
        start: SequenceNumber,
        live_from: SequenceNumber,
        timing: &WriterTiming,
    ) -> Self {
        Self {
            guid: remote.guid,
            address: first_address(remote),
            is_reliable,
            inline_topic: inline_topic(remote),
            start,
            skips_past: false,
            live_from,
            acknowledged: start.previous(),
            acknack_count: LastCount::default(),
            nack_frag_count: LastCount::default(),
            heartbeat_period: timing.heartbeat_period,
            next_heartbeat: now + timing.heartbeat_period,
            heartbeat_count: Count::default(),
            answered_at: None,
            progress: None,
            is_silent: false,
            is_queued: false,
            interest: Interest::of(remote),
            outbox: Outbox::default(),
        }
    }

    /// Discovery has got other locators for it.
    pub(super) fn update(&mut self, remote: &RemoteEndpoint) {
        if self.address.first() != remote.unicast.first() {
            self.address = first_address(remote);
        }
        self.inline_topic = inline_topic(remote);
    }

    pub(super) fn guid(&self) -> Guid {
        self.guid
    }

    pub(super) fn address(&self) -> &Arc<[SocketAddr]> {
        &self.address
    }

    pub(super) fn addresses(&self) -> impl Iterator<Item = SocketAddr> + '_ {
        self.address.iter().copied()
    }

    pub(super) fn is_reliable(&self) -> bool {
        self.is_reliable
    }

    /// The topic, where the reader expects inline QoS.
    pub(super) fn inline_topic(&self) -> Option<&str> {
        self.inline_topic.as_deref()
    }

    pub(super) fn start(&self) -> SequenceNumber {
        self.start
    }

    pub(super) fn base(&self) -> Base {
        Base {
            acknowledged: self.acknowledged,
            window: self.acknowledged.next().max(self.live_from),
        }
    }

    /// The newest of the changes that the reader says it lacks, though they were sent to it, with the others, before
    /// `end`.
    pub(super) fn newest_lost(
        &self,
        acknack: &AckNack,
        end: SequenceNumber,
    ) -> Option<SequenceNumber> {
        let sent = self.live_from..end;
        let missing = acknack.state.iter();
        missing.filter(|member| sent.contains(member)).last()
    }

    /// Takes in an ACKNACK, where `end` is the first change that has not been sent yet. Gives whether it counts.
    pub(super) fn handle_acknack(
        &mut self,
        now: Instant,
        acknack: &AckNack,
        end: SequenceNumber,
        timing: &WriterTiming,
    ) -> bool {
        if !self.is_reliable || !self.acknack_count.accept(now, acknack.count) {
            return false;
        }
        self.acknowledge(now, acknack.state.base, end, timing);
        self.outbox.request_changes(now, acknack.state, end, timing);
        // One that is not final asks for a HEARTBEAT (RTPS 8.3.8.1), as does that which a reader sends before it has
        // heard of the writer.
        if !acknack.is_final && self.may_answer(now, timing) {
            self.answered_at = Some(now);
            if self.skips_past && self.is_greeting(acknack) {
                self.outbox.greet_anew(self.start);
            } else {
                self.outbox.announce();
            }
        }
        true
    }

    /// Whether the reader may not have heard of the writer yet: it was matched later here than there, and what came
    /// before was not for it.
    fn is_greeting(&self, acknack: &AckNack) -> bool {
        acknack.state.is_empty() && acknack.state.base <= self.start
    }

    /// The reader has everything below `base`, where `end` is the first change that has not been sent yet.
    pub(super) fn acknowledge(
        &mut self,
        now: Instant,
        base: SequenceNumber,
        end: SequenceNumber,
        timing: &WriterTiming,
    ) {
        // Nobody can have what was not sent: a larger number is an error or an attack.
        let acknowledged = base.min(end).previous();
        if self.is_reliable && acknowledged > self.acknowledged {
            self.acknowledged = acknowledged;
            self.heartbeat_period = timing.heartbeat_period;
            self.next_heartbeat = now + timing.heartbeat_period;
        }
    }

    /// Takes in a NACK_FRAG for fragments that were sent. What is still to be sent will be followed by a HEARTBEAT that
    /// asks for what is missing then. Gives whether it counts.
    pub(super) fn handle_nack_frag(
        &mut self,
        now: Instant,
        nack: &NackFrag,
        timing: &WriterTiming,
    ) -> bool {
        let counts = self.is_reliable && self.nack_frag_count.accept(now, nack.count);
        if counts {
            self.outbox
                .request_fragments(now, nack.sequence, nack.missing, timing);
        }
        counts
    }

    /// It has the fragments of a change below `fragment`.
    pub(super) fn handle_progress(&mut self, sequence: SequenceNumber, fragment: u32) {
        self.progress = self.progress.max(Some((sequence, fragment)));
        self.is_silent = false;
    }

    /// It is not waited for until it tells how far it has got.
    pub(super) fn fall_silent(&mut self) {
        self.is_silent = true;
    }

    pub(super) fn is_silent(&self) -> bool {
        self.is_silent
    }

    /// The first fragment of a change that it lacks; `None` where it does not tell such things.
    pub(super) fn progress(&self, sequence: SequenceNumber) -> Option<u32> {
        let (told, fragment) = self.progress?;
        Some(if told == sequence { fragment } else { 1 })
    }

    /// Whether the reader is to be reminded of changes below `end`.
    pub(super) fn lags_behind(&self, end: SequenceNumber) -> bool {
        self.is_reliable && self.acknowledged.next() < end
    }

    /// When the next reminder is due, where the reader lags behind.
    pub(super) fn next_heartbeat(&self) -> Instant {
        self.next_heartbeat
    }

    /// Puts a reminder into the outbox; the next one comes later the more of them bring nothing.
    pub(super) fn remind(&mut self, now: Instant, timing: &WriterTiming) {
        self.outbox.announce();
        self.heartbeat_period = (self.heartbeat_period * 2).min(timing.heartbeat_period_max);
        self.next_heartbeat = now + self.heartbeat_period;
    }

    /// A reader that answers each HEARTBEAT with a question is not answered faster than it can get on.
    fn may_answer(&self, now: Instant, timing: &WriterTiming) -> bool {
        self.answered_at
            .is_none_or(|answered_at| answered_at + timing.nack_suppression <= now)
    }
}

fn first_address(remote: &RemoteEndpoint) -> Arc<[SocketAddr]> {
    remote.unicast.iter().take(1).copied().collect()
}

fn inline_topic(remote: &RemoteEndpoint) -> Option<String> {
    remote.expects_inline_qos.then(|| remote.topic.clone())
}
