//! Which endpoints want to be polled, and when their timers are due.

use std::collections::{BTreeSet, VecDeque};
use std::time::Instant;

/// A queue of endpoints that may have something to send, and one ordered set of their deadlines, so that nothing
/// ever looks at all endpoints. They are told apart by their places. Each endpoint keeps its own [`Mark`].
#[derive(Debug, Default)]
pub(super) struct Schedule {
    dirty: VecDeque<u32>,
    timers: BTreeSet<(Instant, u32)>,
}

/// What the schedule has of one endpoint.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mark {
    is_dirty: bool,
    armed: Option<Instant>,
}

impl Schedule {
    /// The endpoint was given something: it is to be polled.
    pub(super) fn touch(&mut self, place: u32, mark: &mut Mark) {
        if !mark.is_dirty {
            mark.is_dirty = true;
            self.dirty.push_back(place);
        }
    }

    /// The endpoint to be polled next.
    pub(super) fn front(&self) -> Option<u32> {
        self.dirty.front().copied()
    }

    /// Lets the others have their turn.
    pub(super) fn rotate(&mut self) {
        if let Some(place) = self.dirty.pop_front() {
            self.dirty.push_back(place);
        }
    }

    /// The endpoint at the front has nothing more to send.
    pub(super) fn settle_front(&mut self, mark: &mut Mark) {
        self.dirty.pop_front();
        mark.is_dirty = false;
    }

    /// How many endpoints are to be polled.
    pub(super) fn dirty_len(&self) -> usize {
        self.dirty.len()
    }

    /// One of the endpoints to be polled.
    pub(super) fn dirty_at(&self, index: usize) -> Option<u32> {
        self.dirty.get(index).copied()
    }

    /// All endpoints to be polled.
    pub(super) fn dirty(&self) -> impl Iterator<Item = u32> + '_ {
        self.dirty.iter().copied()
    }

    /// Sets or clears the endpoint's timer.
    pub(super) fn arm(&mut self, place: u32, mark: &mut Mark, deadline: Option<Instant>) {
        if mark.armed == deadline {
            return;
        }
        if let Some(old) = mark.armed.take() {
            self.timers.remove(&(old, place));
        }
        if let Some(new) = deadline {
            self.timers.insert((new, place));
            mark.armed = Some(new);
        }
    }

    /// The next deadline.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.timers.first().map(|(deadline, _)| *deadline)
    }

    /// Takes the next timer that is due; the endpoint has none then.
    pub(super) fn pop_due(&mut self, now: Instant) -> Option<u32> {
        self.timers.first().filter(|(due, _)| *due <= now)?;
        self.timers.pop_first().map(|(_, place)| place)
    }

    /// Says in the mark that the timer was taken by [`pop_due`](Self::pop_due).
    pub(super) fn popped(mark: &mut Mark) {
        mark.armed = None;
    }

    /// Forgets an endpoint.
    pub(super) fn forget(&mut self, place: u32, mark: &mut Mark) {
        self.arm(place, mark, None);
        self.dirty.retain(|dirty| *dirty != place);
    }
}
