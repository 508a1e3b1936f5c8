//! LIVELINESS of matched writers: their leases, and how many are alive (DDS 1.4 section 2.2.3.11).

use std::time::{Duration, Instant};

use super::ReaderEvent;
use super::events::Events;
use super::timers::Timers;
use crate::qos::{Liveliness, LivelinessKind};
use crate::wire::Guid;

/// What has been heard of a writer, by how much of it asserts liveliness.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Sign {
    /// Its layer lives.
    Protocol,
    /// Its participant's application says so.
    Participant,
    /// It has written, or says so itself.
    Writer,
}

/// The lease that one writer offers.
#[derive(Debug)]
pub(super) struct Lease {
    kind: LivelinessKind,
    duration: Option<Duration>,
    asserted: Instant,
    pub(super) alive: bool,
}

impl Lease {
    pub(super) fn new(now: Instant, offered: Liveliness) -> Self {
        Self {
            kind: offered.kind,
            duration: offered.lease.to_std(),
            asserted: now,
            alive: true,
        }
    }

    /// Takes over changed terms.
    pub(super) fn update(&mut self, offered: Liveliness) {
        self.kind = offered.kind;
        self.duration = offered.lease.to_std();
    }

    /// Renews the lease where `sign` is enough for its kind.
    pub(super) fn renew(&mut self, now: Instant, sign: Sign) -> bool {
        let enough = match self.kind {
            LivelinessKind::Automatic => true,
            LivelinessKind::ManualByParticipant => sign != Sign::Protocol,
            LivelinessKind::ManualByTopic => sign == Sign::Writer,
        };
        if enough {
            self.asserted = now;
        }
        enough
    }

    /// When it ends, if ever.
    pub(super) fn expiry(&self) -> Option<Instant> {
        self.asserted.checked_add(self.duration?)
    }
}

/// The watch over all matched writers, with the counts of LivelinessChangedStatus.
#[derive(Debug, Default)]
pub(super) struct Watch {
    expiries: Timers<Guid>,
    alive: u32,
    not_alive: u32,
}

impl Watch {
    /// A writer has been matched.
    pub(super) fn begin(&mut self, writer: Guid, lease: &Lease, events: &mut Events) {
        self.follow(writer, lease);
        self.count(writer, None, Some(true), events);
    }

    /// Follows a lease whose terms have changed, or that has been renewed after it had ended.
    pub(super) fn follow(&mut self, writer: Guid, lease: &Lease) {
        match lease.expiry() {
            Some(at) => self.expiries.set(writer, at),
            None => self.expiries.cancel(writer),
        }
    }

    /// A writer is not matched any more.
    pub(super) fn end(&mut self, writer: Guid, lease: &Lease, events: &mut Events) {
        self.expiries.cancel(writer);
        self.count(writer, Some(lease.alive), None, events);
    }

    /// Something has been heard of a writer.
    pub(super) fn heard(
        &mut self,
        now: Instant,
        writer: Guid,
        lease: &mut Lease,
        sign: Sign,
        events: &mut Events,
    ) {
        if !lease.renew(now, sign) || lease.alive {
            return;
        }
        lease.alive = true;
        self.follow(writer, lease);
        self.count(writer, Some(false), Some(true), events);
    }

    pub(super) fn next(&self) -> Option<Instant> {
        self.expiries.next()
    }

    /// Takes a writer whose lease may have ended: renewals do not move the timer.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Guid> {
        self.expiries.pop(now)
    }

    /// Ends a lease that has not been renewed; returns whether it has ended.
    pub(super) fn check(
        &mut self,
        now: Instant,
        writer: Guid,
        lease: &mut Lease,
        events: &mut Events,
    ) -> bool {
        let ended = lease.alive && lease.expiry().is_some_and(|at| at <= now);
        if ended {
            lease.alive = false;
            self.count(writer, Some(true), Some(false), events);
        } else if lease.alive {
            self.follow(writer, lease);
        }
        ended
    }

    /// Counts a writer that was and is alive (`Some(true)`), not alive, or not matched (`None`).
    fn count(&mut self, writer: Guid, was: Option<bool>, is: Option<bool>, events: &mut Events) {
        let delta = |state: bool| i32::from(is == Some(state)) - i32::from(was == Some(state));
        let (alive_change, not_alive_change) = (delta(true), delta(false));
        self.alive = self.alive.saturating_add_signed(alive_change);
        self.not_alive = self.not_alive.saturating_add_signed(not_alive_change);
        events.push(ReaderEvent::LivelinessChanged {
            writer,
            alive_count: self.alive,
            alive_change,
            not_alive_count: self.not_alive,
            not_alive_change,
        });
    }
}
