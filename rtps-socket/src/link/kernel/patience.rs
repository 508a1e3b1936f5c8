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

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patience {
    /// Something was sent since the last occasion.
    has_traffic: bool,
    /// Occasions that are left to let pass.
    skip: u32,
    /// How many were let pass last time; 0 while it is worth it.
    pause: u32,
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
        let start = Instant::now();
        let answered = (0..ROUNDS).any(|_| {
            thread::yield_now();
            has_come()
        });
        self.judge(answered && start.elapsed() < MOMENT);
        answered
    }

    fn judge(&mut self, was_worth_it: bool) {
        self.pause = match (was_worth_it, self.pause) {
            (true, _) => 0,
            (false, pause) => (2 * pause).clamp(1, MAX_PAUSE),
        };
        self.skip = self.pause;
    }
}
