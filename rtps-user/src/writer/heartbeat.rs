//! When HEARTBEATs are sent (RTPS 2.5 section 8.4.7.1, heartbeatPeriod; 8.4.9.2.7).
//!
//! As few as will do, since each costs every reader an ACKNACK: one travels with every so many changes or bytes, one
//! follows a fragmented change after which there is nothing to send, and a timer reminds the readers that have not
//! acknowledged what they were sent.

use std::time::{Duration, Instant};

use crate::CountClock;
use crate::count::Count;

/// The counts, and what makes the next HEARTBEAT due.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heartbeats {
    clock: Option<CountClock>,
    /// Of the last one to all readers.
    to_all: Count,
    /// Of any.
    highest: Count,
    deadline: Option<Instant>,
    /// What was sent to all readers since the last one.
    since: Sent,
    is_due: bool,
}

/// What has been sent, or how much of it makes a HEARTBEAT due.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sent {
    pub(super) changes: u32,
    /// Bytes of the changes.
    pub(super) weight: u64,
    /// How often all that there was to be sent had been.
    pub(super) flushes: u32,
}

impl Sent {
    /// How many times more bytes may go without a HEARTBEAT where changes are sent one by one, since the answer comes
    /// within a few of them.
    const LONE: u64 = 3;

    fn reaches(&self, limits: &Self) -> bool {
        let is_lone = self.flushes >= self.changes;
        let weight = limits.weight * if is_lone { Self::LONE } else { 1 };
        self.changes > 0
            && (self.changes >= limits.changes
                || self.weight >= weight
                || self.flushes >= limits.flushes)
    }
}

impl Heartbeats {
    /// With counts that follow `clock`, if there is one.
    pub(super) fn new(clock: Option<CountClock>) -> Self {
        Self {
            clock,
            ..Self::default()
        }
    }

    /// Counts on from `count`.
    pub(super) fn resume_from(&mut self, count: i32) {
        self.to_all = Count::after(count);
        self.highest = self.to_all;
    }

    /// The count of the next HEARTBEAT to all readers.
    pub(super) fn next_count(&mut self, now: Instant) -> i32 {
        self.to_all = self.highest.advance(now, self.clock);
        self.to_all.value()
    }

    /// The count of the next HEARTBEAT to one reader, whose `last` one this becomes. Counts that follow the time must
    /// not run ahead of it because there are many readers.
    pub(super) fn next_count_to(&mut self, now: Instant, last: &mut Count) -> i32 {
        if self.clock.is_none() {
            return self.next_count(now);
        }
        *last = self.to_all.max(*last).advance(now, self.clock);
        self.highest = self.highest.max(*last);
        last.value()
    }

    /// Changes have been sent to reliable readers.
    pub(super) fn handle_sent(
        &mut self,
        now: Instant,
        period: Duration,
        sent: Sent,
        limits: &Sent,
    ) {
        self.since.changes = self.since.changes.saturating_add(sent.changes);
        self.since.weight += sent.weight;
        self.since.flushes = self.since.flushes.saturating_add(sent.flushes);
        self.is_due |= self.since.reaches(limits);
        self.arm(now + period);
    }

    /// The readers are to answer at once, for whatever reason.
    pub(super) fn hurry(&mut self) {
        self.is_due = true;
    }

    /// Whether one is to travel with what is sent to all readers.
    pub(super) fn is_due(&self) -> bool {
        self.is_due
    }

    /// One was sent to all readers.
    pub(super) fn sent_to_all(&mut self) {
        self.is_due = false;
        self.since = Sent::default();
    }

    /// Makes the timer go off at `deadline` at the latest.
    pub(super) fn arm(&mut self, deadline: Instant) {
        self.deadline = Some(self.deadline.map_or(deadline, |old| old.min(deadline)));
    }

    /// Everything is acknowledged.
    pub(super) fn disarm(&mut self) {
        self.deadline = None;
    }

    /// When the timer goes off.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// Whether the timer goes off now; then it is not set any more.
    pub(super) fn expire(&mut self, now: Instant) -> bool {
        self.deadline.take_if(|deadline| *deadline <= now).is_some()
    }
}
