//! Whether to let other processes run before going to sleep.
//!
//! Two apps that answer each other on one CPU need no wake-ups: each only has to let the other run. Where that does
//! not bring an answer at once, because the other app is on another CPU or does something else, or where a third
//! process takes the CPU instead, it is tried more and more rarely.

use std::thread;
use std::time::{Duration, Instant};

/// How often others are let run in a row. The system may choose the same process again.
const ROUNDS: u32 = 2;
/// An answer that takes longer had better been slept for.
const MOMENT: Duration = Duration::from_micros(50);
/// The most occasions that are let pass before it is tried again.
const MAX_PAUSE: u32 = 4096;
/// While it is worth it, one of so many times is measured: to look at the clock takes as long as all else here.
const MEASURED: u32 = 8;

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patience {
    /// Something was sent since the last occasion.
    has_traffic: bool,
    /// Occasions that are left to let pass.
    skip: u32,
    /// How many were let pass last time; 0 while it is worth it.
    pause: u32,
    /// Answers since the last one that was measured.
    answers: u32,
}

impl Patience {
    /// Something was sent that may be answered.
    pub(super) fn note_traffic(&mut self) {
        self.has_traffic = true;
    }

    /// An occasion: lets others run until `has_come` says that there is an answer, or there is no use.
    pub(super) fn wait(&mut self, has_come: impl Fn() -> bool) -> bool {
        if !std::mem::take(&mut self.has_traffic) {
            return false;
        }
        if self.skip > 0 {
            self.skip -= 1;
            return false;
        }
        let is_measured = self.pause > 0 || self.answers >= MEASURED;
        let start = is_measured.then(Instant::now);
        let answered = (0..ROUNDS).any(|_| {
            thread::yield_now();
            has_come()
        });
        let took_long = start.is_some_and(|start| start.elapsed() >= MOMENT);
        self.answers = if is_measured { 0 } else { self.answers + 1 };
        self.judge(answered && !took_long);
        answered
    }

    fn judge(&mut self, was_worth_it: bool) {
        self.pause = match was_worth_it {
            true => 0,
            false => (2 * self.pause).clamp(1, MAX_PAUSE),
        };
        self.skip = self.pause;
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// How often others were let run on so many occasions.
    fn tries(patience: &mut Patience, occasions: u32, has_come: impl Fn() -> bool) -> u32 {
        let tries = Cell::new(0);
        for _ in 0..occasions {
            patience.note_traffic();
            patience.wait(|| {
                tries.set(tries.get() + 1);
                has_come()
            });
        }
        tries.get()
    }

    #[test]
    fn answers_keep_it_going() {
        assert_eq!(tries(&mut Patience::default(), 6, || true), 6);
    }

    #[test]
    fn without_answers_it_gets_rare() {
        let mut patience = Patience::default();
        assert!(tries(&mut patience, 1_000, || false) <= 10 * ROUNDS);
        assert!(tries(&mut patience, 100_000, || false) <= 32 * ROUNDS);
    }

    #[test]
    fn slow_answers_are_slept_for() {
        let slowly = || {
            thread::sleep(2 * MOMENT);
            true
        };
        assert!(tries(&mut Patience::default(), 200, slowly) <= MEASURED + 10);
    }

    #[test]
    fn who_sends_nothing_expects_nothing() {
        let mut patience = Patience::default();
        assert!(!patience.wait(|| panic!("nobody would answer")));
        patience.note_traffic();
        assert!(patience.wait(|| true));
        assert!(!patience.wait(|| panic!("that was answered")));
    }
}
