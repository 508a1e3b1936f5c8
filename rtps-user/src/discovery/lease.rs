//! Leases of remote participants: who has given no sign of life for too long (RTPS 2.5 section 8.5.3.2.1).

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use crate::wire::GuidPrefix;

/// One participant's lease.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lease {
    /// The last sign of life.
    seen: Instant,
    /// How long that holds; `None` for ever.
    duration: Option<Duration>,
    /// Where it stands in the queue: at or before its end, because renewing leaves the queue alone.
    queued: Option<Instant>,
}

impl Lease {
    /// What is shorter is hardly meant, and would keep us busy.
    const MIN: Duration = Duration::from_millis(100);

    fn end(&self) -> Option<Instant> {
        self.seen.checked_add(self.duration?)
    }

    /// A sign of life, perhaps an old one.
    pub(super) fn renew(&mut self, at: Instant) {
        self.seen = self.seen.max(at);
    }
}

/// The ends of all leases in their order.
#[derive(Debug, Default)]
pub(super) struct LeaseQueue {
    ends: BTreeSet<(Instant, GuidPrefix)>,
}

impl LeaseQueue {
    /// Begins a lease.
    pub(super) fn grant(
        &mut self,
        now: Instant,
        participant: GuidPrefix,
        duration: Option<Duration>,
    ) -> Lease {
        let mut lease = Lease {
            seen: now,
            duration: duration.map(|duration| duration.max(Lease::MIN)),
            queued: None,
        };
        self.queue(participant, &mut lease);
        lease
    }

    /// Ends a lease.
    pub(super) fn revoke(&mut self, participant: GuidPrefix, lease: &Lease) {
        if let Some(queued) = lease.queued {
            self.ends.remove(&(queued, participant));
        }
    }

    /// The next that may have ended; the caller asks [`has_ended`](Self::has_ended).
    pub(super) fn pop_due(&mut self, now: Instant) -> Option<GuidPrefix> {
        self.ends.first().filter(|(end, _)| *end <= now)?;
        self.ends.pop_first().map(|(_, participant)| participant)
    }

    /// Whether the lease that was popped has ended; if it was renewed since it was queued, it is queued again.
    pub(super) fn has_ended(
        &mut self,
        now: Instant,
        participant: GuidPrefix,
        lease: &mut Lease,
    ) -> bool {
        lease.queued = None;
        match lease.end() {
            Some(end) if end <= now => true,
            _ => {
                self.queue(participant, lease);
                false
            }
        }
    }

    /// When to look again.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.ends.first().map(|(end, _)| *end)
    }

    fn queue(&mut self, participant: GuidPrefix, lease: &mut Lease) {
        lease.queued = lease.end();
        if let Some(end) = lease.queued {
            self.ends.insert((end, participant));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTICIPANT: GuidPrefix = GuidPrefix([1; 12]);

    #[test]
    fn renewed_leases_end_later() {
        let start = Instant::now();
        let second = Duration::from_secs(1);
        let mut queue = LeaseQueue::default();
        let mut lease = queue.grant(start, PARTICIPANT, Some(10 * second));
        lease.renew(start + 4 * second);
        lease.renew(start + 2 * second);
        assert_eq!(queue.pop_due(start + 9 * second), None);
        let now = start + 10 * second;
        assert_eq!(queue.pop_due(now), Some(PARTICIPANT));
        assert!(!queue.has_ended(now, PARTICIPANT, &mut lease));
        assert_eq!(queue.poll_timeout(), Some(start + 14 * second));
        let now = start + 14 * second;
        assert_eq!(queue.pop_due(now), Some(PARTICIPANT));
        assert!(queue.has_ended(now, PARTICIPANT, &mut lease));
        assert_eq!(queue.poll_timeout(), None);
    }

    #[test]
    fn infinite_and_revoked_leases_do_not_end() {
        let start = Instant::now();
        let mut queue = LeaseQueue::default();
        queue.grant(start, PARTICIPANT, None);
        assert_eq!(queue.poll_timeout(), None);
        let lease = queue.grant(start, PARTICIPANT, Some(Duration::ZERO));
        assert_eq!(queue.poll_timeout(), Some(start + Lease::MIN));
        queue.revoke(PARTICIPANT, &lease);
        assert_eq!(queue.poll_timeout(), None);
    }
}
