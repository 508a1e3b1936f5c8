//! Flow control within a large change: how far its fragments may run ahead of the readers.
//!
//! One change may be larger than all inboxes. So its fragments are sent a window at a time. Readers that answer each
//! HEARTBEAT_FRAG, and say so how far they have got, move the window (ours do: a NACK_FRAG that asks for nothing, whose
//! base is the first fragment that they neither have nor have asked for). The standard does not ask for that; for
//! others time moves it. Where question or answer may be lost, the question is repeated; who does not answer then is not
//! waited for until it does.

use std::time::{Duration, Instant};

use crate::wire::SequenceNumber;

/// So long a window is on its way to readers that don't say how far they have got.
const BLIND: Duration = Duration::from_millis(1);
/// When readers that do are asked again.
const REPEAT: Duration = Duration::from_millis(1);
/// When they are taken not to have heard.
const PATIENCE: Duration = Duration::from_millis(20);

/// The window of the change that is being sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct FragmentWindow {
    sequence: SequenceNumber,
    /// Fragments up to this one may be sent.
    limit: u32,
    /// When the window moves by itself; it holds the stream up then.
    moves_at: Option<Instant>,
    /// When the readers are asked again.
    asks_at: Option<Instant>,
    /// Whether they are to be asked again now.
    asks: bool,
    is_open: bool,
}

impl FragmentWindow {
    pub(super) fn new() -> Self {
        Self {
            sequence: SequenceNumber::ZERO,
            limit: 0,
            moves_at: None,
            asks_at: None,
            asks: false,
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
        if !self.is_closed() {
            let can_tell = can_tell();
            self.moves_at = Some(now + if can_tell { PATIENCE } else { BLIND });
            self.asks_at = can_tell.then(|| now + REPEAT);
        }
        false
    }

    /// All readers have what is below `fragment` or have asked for it, as far as they tell, or want to go on from there.
    pub(super) fn advance(&mut self, sequence: SequenceNumber, fragment: u32, size: u32) {
        if sequence == self.sequence {
            self.move_to(fragment.saturating_sub(1).saturating_add(size));
        }
    }

    /// Does what is due; gives whether the window has moved by itself.
    pub(super) fn expire(&mut self, now: Instant, size: u32) -> bool {
        if self.moves_at.is_some_and(|at| at <= now) {
            self.move_to(self.limit.saturating_add(size));
            return true;
        }
        if self.asks_at.is_some_and(|at| at <= now) {
            self.asks_at = Some(now + REPEAT);
            self.asks = true;
        }
        false
    }

    /// Whether the readers are to be asked again how far they have got; once for each time that it is due.
    pub(super) fn take_question(&mut self) -> bool {
        std::mem::take(&mut self.asks)
    }

    /// Nothing is held up any more.
    pub(super) fn open(&mut self) {
        self.is_open = true;
        self.wait_no_more();
    }

    /// Whether the readers are waited for.
    pub(super) fn is_closed(&self) -> bool {
        self.moves_at.is_some()
    }

    /// When [`expire`](Self::expire) is due.
    pub(super) fn deadline(&self) -> Option<Instant> {
        [self.moves_at, self.asks_at].into_iter().flatten().min()
    }

    fn move_to(&mut self, limit: u32) {
        if limit > self.limit {
            self.limit = limit;
            self.wait_no_more();
        }
    }

    fn wait_no_more(&mut self) {
        self.moves_at = None;
        self.asks_at = None;
        self.asks = false;
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
        assert_eq!(window.deadline(), Some(now + REPEAT));
        window.advance(SequenceNumber(6), 100, 10);
        window.advance(CHANGE, 1, 10);
        assert!(!admits(&mut window, 11));
        window.advance(CHANGE, 6, 10);
        assert!(!window.is_closed());
        assert!(admits(&mut window, 15));
        assert!(!admits(&mut window, 16));
    }

    #[test]
    fn they_are_asked_again_and_then_given_up() {
        let (mut window, start) = (FragmentWindow::new(), Instant::now());
        assert!(!window.admits(start, (CHANGE, 11), 10, || true));
        assert!(!window.take_question(), "they were just asked");
        let mut asked = 0;
        while let Some(due) = window.deadline() {
            window.expire(due, 10);
            asked += u32::from(window.take_question());
            assert!(!window.take_question());
        }
        assert_eq!(asked, 19);
        assert!(window.admits(start + PATIENCE, (CHANGE, 20), 10, || true));
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
