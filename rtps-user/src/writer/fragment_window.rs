//! Flow control within a large change: how far its fragments may run ahead of the readers.
//!
//! One change may be larger than all inboxes. So its fragments are sent a window at a time. Readers that answer each
//! HEARTBEAT_FRAG, and say so how far they have got, move the window (ours do: a NACK_FRAG that asks for nothing). The
//! standard does not ask for that; for others, and where an answer is lost, time moves it.

use std::time::{Duration, Instant};

use crate::wire::SequenceNumber;

/// So long a window is on its way to readers that don't say how far they have got.
const BLIND: Duration = Duration::from_millis(1);
/// When readers that do are taken not to have heard.
const PATIENCE: Duration = Duration::from_millis(20);

/// The window of the change that is being sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct FragmentWindow {
    sequence: SequenceNumber,
    /// Fragments up to this one may be sent.
    limit: u32,
    /// When the window moves by itself; it holds the stream up then.
    moves_at: Option<Instant>,
    is_open: bool,
}

impl FragmentWindow {
    pub(super) fn new() -> Self {
        Self {
            sequence: SequenceNumber::ZERO,
            limit: 0,
            moves_at: None,
            is_open: false,
        }
    }

    /// Whether a fragment may be sent now; `size` is that of the window, in fragments. If not, the readers are waited
    /// for, `can_tell` says whether all of them tell how far they have got.
    pub(super) fn admits(
        &mut self,
        now: Instant,
        (sequence, fragment): (SequenceNumber, u32),
        size: u32,
        can_tell: impl FnOnce() -> bool,
    ) -> bool {
        if sequence != self.sequence {
            self.sequence = sequence;
            self.limit = 0;
            self.move_to(size);
        }
        if fragment <= self.limit || self.is_open {
            return true;
        }
        self.moves_at
            .get_or_insert_with(|| now + if can_tell() { PATIENCE } else { BLIND });
        false
    }

    /// All readers have what is below `fragment`, as far as they tell, or want to go on from there.
    pub(super) fn advance(&mut self, sequence: SequenceNumber, fragment: u32, size: u32) {
        if sequence == self.sequence {
            self.move_to(fragment.saturating_sub(1).saturating_add(size));
        }
    }

    /// Does what is due.
    pub(super) fn expire(&mut self, now: Instant, size: u32) {
        if self.moves_at.is_some_and(|at| at <= now) {
            self.move_to(self.limit.saturating_add(size));
        }
    }

    /// Nothing is held up any more.
    pub(super) fn open(&mut self) {
        self.is_open = true;
        self.moves_at = None;
    }

    /// Whether the readers are waited for.
    pub(super) fn is_closed(&self) -> bool {
        self.moves_at.is_some()
    }

    /// When the stream goes on without a word of the readers.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.moves_at
    }

    fn move_to(&mut self, limit: u32) {
        if limit > self.limit {
            self.limit = limit;
            self.moves_at = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANGE: SequenceNumber = SequenceNumber(7);

    #[test]
    fn readers_that_tell_move_it() {
        let (mut window, now) = (FragmentWindow::new(), Instant::now());
        let admits = |window: &mut FragmentWindow, fragment| {
            window.admits(now, (CHANGE, fragment), 10, || true)
        };
        assert!(admits(&mut window, 1) && admits(&mut window, 10));
        assert!(!admits(&mut window, 11));
        assert_eq!(window.deadline(), Some(now + PATIENCE));
        window.advance(SequenceNumber(6), 100, 10);
        window.advance(CHANGE, 1, 10);
        assert!(!admits(&mut window, 11));
        window.advance(CHANGE, 6, 10);
        assert!(!window.is_closed());
        assert!(admits(&mut window, 15));
        assert!(!admits(&mut window, 16));
    }

    #[test]
    fn time_moves_it_for_the_others() {
        let (mut window, now) = (FragmentWindow::new(), Instant::now());
        assert!(!window.admits(now, (CHANGE, 11), 10, || false));
        let soon = now + BLIND;
        assert_eq!(window.deadline(), Some(soon));
        window.expire(soon - Duration::from_nanos(1), 10);
        assert!(!window.admits(now, (CHANGE, 11), 10, || false));
        window.expire(soon, 10);
        assert_eq!(window.deadline(), None);
        assert!(window.admits(soon, (CHANGE, 20), 10, || false));
        assert!(!window.admits(soon, (CHANGE, 21), 10, || false));
    }

    #[test]
    fn each_change_begins_with_a_whole_one() {
        let (mut window, now) = (FragmentWindow::new(), Instant::now());
        assert!(!window.admits(now, (CHANGE, 11), 10, || true));
        let next = CHANGE.next();
        assert!(window.admits(now, (next, 1), 10, || true));
        assert!(!window.is_closed());
        assert!(!window.admits(now, (next, 11), 10, || true));
        window.open();
        assert!(window.admits(now, (next, 1000), 10, || true));
    }
}
