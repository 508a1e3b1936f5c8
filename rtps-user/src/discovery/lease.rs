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
    /// Where it stands in the queue.
    queued: Option<Instant>,
}

impl Lease {
    /// What is shorter is hardly meant, and would keep us busy.
    const MIN: Duration = Duration::from_millis(100);

    fn end(&self) -> Option<Instant> {
        self.seen.checked_add(self.duration?)
    }
}

/// The ends of all leases in their order.
#[derive(Debug, Default)]
pub(super) struct LeaseQueue {
    ends: BTreeSet<(Instant, GuidPrefix)>,
    /// The last signs of life in their order.
    seen: BTreeSet<(Instant, GuidPrefix)>,
    /// When it was looked for leases that have ended.
    checked: Option<Instant>,
}

impl LeaseQueue {
    /// The time between two looks at the least, so that thousands of participants wake us no more than once a second.
    const PAUSE: Duration = Duration::from_millis(900);

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
        self.seen.remove(&(lease.seen, participant));
        if let Some(queued) = lease.queued {
            self.ends.remove(&(queued, participant));
        }
    }

    /// A sign of life, perhaps an old one.
    pub(super) fn renew(&mut self, at: Instant, participant: GuidPrefix, lease: &mut Lease) {
        if at > lease.seen {
            self.revoke(participant, lease);
            lease.seen = at;
            self.queue(participant, lease);
        }
    }

    /// The participants whose leases have ended, where it is time to look.
    pub(super) fn take_ended(&mut self, now: Instant) -> Vec<GuidPrefix> {
        let mut ended = Vec::new();
        if self.poll_timeout().is_none_or(|due| due > now) {
            return ended;
        }
        self.checked = Some(now);
        while self.ends.first().is_some_and(|(end, _)| *end <= now) {
            ended.extend(self.ends.pop_first().map(|(_, participant)| participant));
        }
        ended
    }

    /// When to look again.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let (end, _) = self.ends.first()?;
        let next = self.checked.map(|checked| checked + Self::PAUSE);
        Some(next.map_or(*end, |next| next.max(*end)))
    }

    /// The participants with leases that were last seen at `at` or before, the one that is silent for longest first.
    pub(super) fn silent_since(&self, at: Instant) -> impl Iterator<Item = GuidPrefix> {
        let silent = self.seen.iter().take_while(move |(seen, _)| *seen <= at);
        silent.map(|(_, participant)| *participant)
    }

    fn queue(&mut self, participant: GuidPrefix, lease: &mut Lease) {
        self.seen.insert((lease.seen, participant));
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
        queue.renew(start + 4 * second, PARTICIPANT, &mut lease);
        queue.renew(start + 2 * second, PARTICIPANT, &mut lease);
        assert_eq!(queue.poll_timeout(), Some(start + 14 * second));
        let silent_since = |at| queue.silent_since(start + at).collect::<Vec<_>>();
        assert_eq!(silent_since(3 * second), []);
        assert_eq!(silent_since(4 * second), [PARTICIPANT]);
        assert_eq!(queue.take_ended(start + 13 * second), []);
        assert_eq!(queue.take_ended(start + 14 * second), [PARTICIPANT]);
        assert_eq!(queue.poll_timeout(), None);
    }

    #[test]
    fn leases_that_end_one_after_the_other_are_noticed_together() {
        let start = Instant::now();
        let mut queue = LeaseQueue::default();
        let end = |number: u8| Duration::from_millis(1000 + 100 * u64::from(number));
        for number in 0..30 {
            queue.grant(start, GuidPrefix([number; 12]), Some(end(number)));
        }
        let mut looks = Vec::new();
        while let Some(due) = queue.poll_timeout() {
            let ended = queue.take_ended(due);
            for GuidPrefix([number, ..]) in &ended {
                let late = due - (start + end(*number));
                assert!(late <= Duration::from_secs(1));
            }
            looks.push(ended.len());
        }
        assert_eq!(looks, [1, 9, 9, 9, 2]);
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
