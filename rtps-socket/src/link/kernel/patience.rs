//! Whether to let other processes run before going to sleep.
//!
//! Two apps that answer each other on one CPU need no wake-ups: each only has to let the other run. Where that does
//! not bring an answer at once, because the other app is on another CPU or does something else, it is tried more and
//! more rarely. Where a third process wants the CPU, that runs instead, for as long as the scheduler likes and no
//! wake-up helps; then it is not tried for a while.

use std::thread;
use std::time::{Duration, Instant};

/// How often others are let run in a row. The system may choose the same process again.
const ROUNDS: u32 = 2;
/// The most occasions without an answer that are let pass before it is tried again.
const MAX_PAUSE: u32 = 4096;
/// When others have run for longer, the answer had better been slept for.
const MOMENT: Duration = Duration::from_micros(50);
/// For how long it is not tried after that, at first and at most.
const REST_MIN: Duration = Duration::from_millis(100);
const REST_MAX: Duration = Duration::from_secs(2);

/// See the module.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patience {
    /// Something was sent since the last occasion.
    has_traffic: bool,
    /// Occasions that are left to let pass.
    skip: u32,
    /// How many were let pass last time; 0 while it is worth it.
    pause: u32,
    /// When others had run last.
    last: Option<Instant>,
    /// They may have run for too long: the next time is measured. To look at the clock twice each time takes too long.
    is_suspicious: bool,
    /// Until when it is or was not tried, and for how long that is.
    rests_until: Option<Instant>,
    rest: Duration,
    is_resting: bool,
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
        if self.rests() {
            return false;
        }
        let start = self.is_suspicious.then(Instant::now);
        let answered = (0..ROUNDS).any(|_| {
            thread::yield_now();
            has_come()
        });
        self.note_time(start, Instant::now());
        self.pause = match answered {
            true => 0,
            false => (2 * self.pause).clamp(1, MAX_PAUSE),
        };
        self.skip = self.pause;
        answered
    }

    fn rests(&mut self) -> bool {
        if self.is_resting && self.rests_until.is_none_or(|end| end <= Instant::now()) {
            self.is_resting = false;
            self.is_suspicious = true;
        }
        self.is_resting
    }

    /// Others have run, from `start` on where that was measured.
    fn note_time(&mut self, start: Option<Instant>, now: Instant) {
        let last = self.last.replace(now);
        let is_long = |since: Option<Instant>| since.is_some_and(|since| now - since >= MOMENT);
        if is_long(start) {
            let is_again = self.rests_until.is_some_and(|end| now < end + REST_MAX);
            self.rest = match is_again {
                true => (2 * self.rest).min(REST_MAX),
                false => REST_MIN,
            };
            self.rests_until = Some(now + self.rest);
            self.is_resting = true;
        }
        self.is_suspicious = start.is_none() && is_long(last);
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
        let mut patience = Patience::default();
        assert!(tries(&mut patience, 200, slowly) <= 3);
        thread::sleep(REST_MIN);
        assert_eq!(tries(&mut patience, 200, slowly), 1, "once more");
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
