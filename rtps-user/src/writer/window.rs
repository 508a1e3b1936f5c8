//! Flow control: how far a writer may run ahead of its slowest reader.
//!
//! The window has two watermarks. Full, it is closed until half of it has been acknowledged, so that a writer that
//! waits for room wakes up for many changes and not for one. Its size follows what the readers can take: half of it is
//! given up when something gets lost, at most once for all that was on its way then, and what is acknowledged without a
//! loss while the writer was waiting widens it step by step.

use super::WriterTiming;
use crate::wire::SequenceNumber;

/// The bytes that may be unacknowledged.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    size: usize,
    min: usize,
    max: usize,
    is_closed: bool,
    /// Whether the size kept the writer waiting in this round.
    was_closed: bool,
    /// The round ends when everything below this has been acknowledged.
    round_end: SequenceNumber,
    /// What is below this was on its way when the last loss was noticed: it may be lost for the same reason.
    loss_end: SequenceNumber,
}

impl Window {
    /// The first size, as a part of the largest.
    const START: usize = 4;
    /// So many steps lead from nothing to the largest size.
    const STEPS: usize = 64;

    pub(super) fn new(timing: &WriterTiming) -> Self {
        // One change is always admitted.
        let max = timing.max_unacknowledged_bytes.max(1);
        let min = timing.min_unacknowledged_bytes.min(max);
        Self {
            size: (max / Self::START).max(min),
            min,
            max,
            is_closed: false,
            was_closed: false,
            round_end: SequenceNumber::ZERO,
            loss_end: SequenceNumber::ZERO,
        }
    }

    /// Its size in bytes.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Whether one more change may be taken while changes of that `weight` are unacknowledged.
    pub(super) fn admits(&mut self, weight: u64) -> bool {
        let size = self.size as u64;
        self.is_closed = match self.is_closed {
            true => weight > size / 2,
            false => weight >= size,
        };
        self.was_closed |= self.is_closed;
        !self.is_closed
    }

    /// A change alone fills it, and its fragments have to wait.
    pub(super) fn note_wait(&mut self) {
        self.was_closed = true;
    }

    /// A reader has lost a change; those from `end` on have not been sent yet.
    pub(super) fn handle_loss(&mut self, lost: SequenceNumber, end: SequenceNumber) {
        if lost >= self.loss_end {
            self.size = (self.size / 2).max(self.min);
            self.loss_end = end;
            self.begin_round(end);
        }
    }

    /// All readers have what is below `base`; what is from `end` on has not been sent yet.
    pub(super) fn handle_acknowledged(&mut self, base: SequenceNumber, end: SequenceNumber) {
        if base >= self.round_end {
            if self.was_closed {
                self.size = (self.size + self.max / Self::STEPS).min(self.max);
            }
            self.begin_round(end);
        }
    }

    fn begin_round(&mut self, end: SequenceNumber) {
        self.round_end = end;
        self.was_closed = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window() -> Window {
        Window::new(&WriterTiming {
            max_unacknowledged_bytes: 1600,
            min_unacknowledged_bytes: 150,
            ..WriterTiming::default()
        })
    }

    /// Rounds in which the writer had to wait and nothing got lost.
    fn widen(window: &mut Window, rounds: i64) {
        for _ in 0..rounds {
            assert!(!window.admits(u64::MAX));
            let end = window.round_end;
            window.handle_acknowledged(end, end.plus(10));
        }
    }

    #[test]
    fn once_closed_it_opens_when_half_is_acknowledged() {
        let mut window = window();
        assert_eq!(window.size(), 400);
        assert!(window.admits(399));
        assert!(!window.admits(400));
        assert!(!window.admits(201));
        assert!(window.admits(200));
        assert!(window.admits(399));
    }

    #[test]
    fn it_grows_up_to_its_limit_while_the_writer_waits() {
        let mut window = window();
        window.handle_acknowledged(SequenceNumber(10), SequenceNumber(20));
        assert_eq!(window.size(), 400, "nobody needed more");
        widen(&mut window, 1);
        assert_eq!(window.size(), 425);
        window.admits(u64::MAX);
        window.handle_acknowledged(window.round_end.previous(), SequenceNumber(40));
        assert_eq!(window.size(), 425, "not all of the round is acknowledged");
        widen(&mut window, 100);
        assert_eq!(window.size(), 1600);
    }

    #[test]
    fn losses_of_one_round_count_once() {
        let mut window = window();
        window.handle_acknowledged(SequenceNumber(4), SequenceNumber(20));
        window.handle_loss(SequenceNumber(5), SequenceNumber(20));
        window.handle_loss(SequenceNumber(6), SequenceNumber(30));
        window.handle_loss(SequenceNumber(19), SequenceNumber(30));
        assert_eq!(window.size(), 200);
        window.handle_loss(SequenceNumber(20), SequenceNumber(30));
        assert_eq!(window.size(), 150, "the least");
    }

    #[test]
    fn limits_that_contradict_each_other_do_no_harm() {
        for max in [0, 1, 100] {
            let mut window = Window::new(&WriterTiming {
                max_unacknowledged_bytes: max,
                ..WriterTiming::default()
            });
            assert!(window.admits(0));
            assert!(!window.admits(max.max(1) as u64));
        }
    }
}
