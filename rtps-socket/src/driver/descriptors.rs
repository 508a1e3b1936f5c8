//! Looking at descriptors, where samples come through them: each look costs a system call.

use std::time::Instant;

use super::Shared;
use crate::sys::Wakeups;

/// The looks of a thread that looks again and again.
pub(super) struct Looks {
    /// Through which samples have come of late.
    likely: Wakeups,
    /// Who is to answer may not have had the CPU yet: the first look is left out.
    skips: bool,
    /// The next look is at the likely ones alone.
    tries: bool,
    /// The datagrams that the last look has taken in.
    pub(super) count: usize,
}

impl Looks {
    pub(super) fn new(likely: Wakeups, skips: bool) -> Self {
        Self {
            likely,
            skips,
            tries: !likely.is_empty(),
            count: 0,
        }
    }

    /// Takes in what has come; whether that was anything. Every other look is at all descriptors, so that discovery is
    /// not left behind samples.
    pub(super) fn look(&mut self, shared: &Shared, now: Instant) -> bool {
        if std::mem::take(&mut self.skips) {
            return false;
        }
        let found = match self.tries {
            true => shared.try_descriptors(now, self.likely),
            false => shared.look_at_descriptors(now),
        };
        self.tries = !self.tries && !self.likely.is_empty();
        self.count = found.unwrap_or_default();
        found.is_some()
    }
}

impl Shared {
    /// Takes in what has come through these descriptors, without asking first whether they are readable: that saves a
    /// system call for each. The number of datagrams, if there were any.
    fn try_descriptors(&self, now: Instant, likely: Wakeups) -> Option<usize> {
        let count = self.lock().receive(now, likely);
        (count > 0).then_some(count)
    }

    /// Takes in what has come through any descriptor. The number of datagrams with samples, if there was anything.
    fn look_at_descriptors(&self, now: Instant) -> Option<usize> {
        let mut core = self.lock();
        let wakeups = self.look(&mut core, now);
        (!wakeups.is_empty()).then(|| core.receive(now, wakeups))
    }
}
