//! Who drives at the moment.

use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use super::inflow::Inflow;
use super::spin::Eagerness;

/// A timer may be late by this much when the thread in the seat sleeps: writing in a steady rhythm then never has to
/// wake it, because it looks that often by itself while there is writing.
pub(super) const SLACK: Duration = Duration::from_millis(10);
/// For how long after a write the thread in the seat looks so often.
pub(super) const WRITING: Duration = Duration::from_millis(100);

/// How long the descriptors may go unseen while there is always something else to do: in a flood of samples that
/// are found in memory, matching and the layer's messages must not stand still.
pub(super) const LOOK_PERIOD: Duration = Duration::from_millis(10);

/// What counts as a long wait.
const REST_AFTER: Duration = Duration::from_millis(100);

thread_local! {
    /// To ask for it anew would be to count references.
    static THIS_THREAD: ThreadId = thread::current().id();
}

/// The thread that asks.
pub(super) fn this_thread() -> ThreadId {
    THIS_THREAD.with(|id| *id)
}

/// Who has the seat.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) enum Holder {
    /// Nobody.
    #[default]
    Nobody,
    /// A thread that waits for something.
    Foreground,
    /// The background thread.
    Background,
}

/// The state of driving, under the core's lock.
#[derive(Debug, Default)]
pub(crate) struct Seat {
    pub(super) holder: Holder,
    /// Since when a foreground thread has held it.
    pub(super) since: Option<Instant>,
    /// The foreground thread that holds it.
    pub(super) thread: Option<ThreadId>,
    /// When somebody looked at the descriptors last.
    pub(super) looked: Option<Instant>,
    /// Until when the holder sleeps at the latest, while it sleeps.
    pub(super) sleeps_until: Option<Sleep>,
    /// The holder sleeps without looking at the descriptors: others may.
    pub(super) naps: bool,
    /// Whether a waiting thread looks for a moment before it sleeps.
    pub(super) eagerness: Eagerness,
    /// Whether it naps between two looks.
    pub(super) inflow: Inflow,
    /// Threads that wait for the holder to find something for them.
    pub(super) followers: usize,
    /// Something happened that a follower may wait for.
    pub(super) news: bool,
    /// A task waits: the background thread is to take the free seat at once.
    pub(super) is_wanted: bool,
    /// The background thread rests without a timeout.
    pub(super) background_rests: bool,
    /// The caller drives from an event loop of its own.
    pub(super) is_external: bool,
    /// For when the caller's timer is set.
    pub(super) timer: Option<Instant>,
    /// The participant is gone.
    pub(super) is_closed: bool,
}

/// The end of a sleep.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Sleep {
    /// At a time.
    Until(Instant),
    /// Only when something arrives.
    Open,
}

impl Seat {
    /// Whether this thread holds it already: it then is in a listener, which itself waits for something.
    pub(super) fn is_mine(&self) -> bool {
        self.thread.is_some_and(|held| held == this_thread())
    }

    /// Whether nobody else looks at the descriptors.
    pub(super) fn is_free(&self) -> bool {
        !self.is_external && (self.holder == Holder::Nobody || self.naps)
    }

    /// Whether nobody has looked at the descriptors for `period`.
    pub(super) fn is_unseen(&self, now: Instant, period: Duration) -> bool {
        self.looked.is_none_or(|looked| looked + period <= now)
    }

    /// Whether the holder is one who waits for long: the background thread need not even look any more.
    pub(super) fn rests(&self) -> bool {
        self.since
            .is_some_and(|since| since.elapsed() >= REST_AFTER)
    }

    /// Whether the holder sleeps until something arrives or is due.
    pub(super) fn sleeps(&self) -> bool {
        self.sleeps_until.is_some()
    }

    /// Whether the holder would sleep through a deadline that is not exact.
    pub(super) fn sleeps_beyond(&self, deadline: Option<Instant>) -> bool {
        self.sleeps_through(deadline.map(|deadline| deadline + SLACK))
    }

    /// Whether the holder would sleep through a deadline.
    pub(super) fn sleeps_through(&self, deadline: Option<Instant>) -> bool {
        match (self.sleeps_until, deadline) {
            (None, _) | (_, None) => false,
            (Some(Sleep::Open), Some(_)) => true,
            (Some(Sleep::Until(end)), Some(deadline)) => end > deadline,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_sleep_that_is_much_too_long_is_interrupted() {
        let now = Instant::now();
        let mut seat = Seat::default();
        assert!(!seat.sleeps_beyond(Some(now)), "nobody sleeps");
        seat.sleeps_until = Some(Sleep::Open);
        assert!(seat.sleeps_beyond(Some(now)));
        assert!(!seat.sleeps_beyond(None));
        seat.sleeps_until = Some(Sleep::Until(now + SLACK));
        assert!(!seat.sleeps_beyond(Some(now)));
        seat.sleeps_until = Some(Sleep::Until(now + SLACK * 2));
        assert!(seat.sleeps_beyond(Some(now)));
    }
}
