//! Looking again and again instead of sleeping: a wake-up costs more than most round trips take, and the one who wakes
//! pays for it as well.
//!
//! The app says for how long, or whether at all. If it says nothing, a thread that was woken soon after it fell asleep
//! looks for a moment before it sleeps again. Where that is in vain, because who would send shares the CPU or has
//! nothing more to say, it is tried again ever more rarely.

use std::sync::MutexGuard;
use std::time::{Duration, Instant};

use super::{Core, Shared, clear};
use crate::link::INTERRUPT;
use crate::sys::Wakeups;

/// How long a thread looks that nobody told to.
const MOMENT: Duration = Duration::from_micros(50);
/// A sleep that was not worth it.
const SHORT: Duration = Duration::from_micros(100);
/// Waits without a look after many in vain.
const MOST_SKIPPED: u32 = 4096;
/// Other threads may have given the protocol something to do by then.
const GLANCE: Duration = Duration::from_millis(1);
/// Looks between two looks at the clock.
const LOOKS: usize = 16;

/// Whether looking for a moment has paid lately.
#[derive(Debug, Default)]
pub(super) struct Eagerness {
    was_short: bool,
    penalty: u32,
    skip: u32,
}

impl Eagerness {
    /// How long to look in the wait that begins now.
    fn patience(&mut self) -> Duration {
        if self.was_short && self.skip == 0 {
            return MOMENT;
        }
        self.skip = self.skip.saturating_sub(1);
        Duration::ZERO
    }

    /// A sleep has ended because something arrived, or for another reason.
    pub(super) fn slept(&mut self, time: Duration) {
        self.was_short = time < SHORT;
    }

    fn looked(&mut self, in_vain: bool) {
        self.penalty = match in_vain {
            false => 0,
            true => (self.penalty * 2).clamp(1, MOST_SKIPPED),
        };
        self.skip = self.penalty;
    }
}

/// How long a thread in one wait goes on looking.
pub(super) struct Spinning {
    patience: Duration,
    end: Option<Instant>,
    is_told: bool,
}

impl Spinning {
    /// As long as the app says, `None` if it says nothing.
    pub(super) fn new(busy_poll: Option<Duration>, eagerness: &mut Eagerness) -> Self {
        Self {
            patience: busy_poll.unwrap_or_else(|| eagerness.patience()),
            end: None,
            is_told: busy_poll.is_some(),
        }
    }

    /// Until when to look rather than to sleep; `None` when it has been long enough.
    fn goes_on(&mut self, now: Instant) -> Option<Instant> {
        if self.patience.is_zero() {
            return None;
        }
        let end = *self.end.get_or_insert(now + self.patience);
        (now < end).then_some(end)
    }

    /// Something arrived while looking, or it was in vain.
    fn ended(&mut self, in_vain: bool, eagerness: &mut Eagerness) {
        self.end = None;
        if !self.is_told {
            eagerness.looked(in_vain);
            if in_vain {
                self.patience = Duration::ZERO;
            }
        }
    }
}

impl Shared {
    /// Looks for what arrives, for a while; then it sleeps in the seat.
    pub(super) fn wait_in_seat<'a>(
        &'a self,
        mut core: MutexGuard<'a, Core>,
        now: Instant,
        deadline: Option<Instant>,
        spinning: &mut Spinning,
    ) -> MutexGuard<'a, Core> {
        let Some(end) = spinning.goes_on(now) else {
            if spinning.end.is_some() {
                spinning.ended(true, &mut core.seat.eagerness);
            }
            return self.sleep_in_seat(core, now, deadline);
        };
        let timeouts = [core.poll_timeout(), deadline];
        let end = timeouts
            .into_iter()
            .flatten()
            .fold(end.min(now + GLANCE), Instant::min);
        let arrivals = core.arrivals();
        self.release(core);
        let wakeups = match arrivals {
            Some(arrivals) => {
                look_until(end, || arrivals.has_arrived());
                Wakeups::default()
            }
            None => self.look_at_descriptors(end),
        };
        self.take_in(wakeups, spinning)
    }

    fn take_in(&self, wakeups: Wakeups, spinning: &mut Spinning) -> MutexGuard<'_, Core> {
        let mut core = self.lock();
        let now = Instant::now();
        let wakeups = match wakeups.is_empty() {
            true => self.look_in_time(&mut core, now),
            false => wakeups,
        };
        if core.receive(now, wakeups) > 0 {
            spinning.ended(false, &mut core.seat.eagerness);
        }
        core
    }

    fn look_at_descriptors(&self, end: Instant) -> Wakeups {
        let mut wakeups = Wakeups::default();
        look_until(end, || {
            wakeups = self.epoll.wait(Some(Duration::ZERO)).unwrap_or_default();
            !wakeups.is_empty()
        });
        if wakeups.contains(INTERRUPT) {
            clear(&self.interrupt);
        }
        wakeups
    }
}

fn look_until(end: Instant, mut has_arrived: impl FnMut() -> bool) {
    let mut look = || {
        std::hint::spin_loop();
        has_arrived()
    };
    while !(0..LOOKS).any(|_| look()) && Instant::now() < end {}
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The waits of `count` in which a thread looks, when each look is in vain or not and each sleep is short.
    fn looks(count: usize, in_vain: bool) -> usize {
        let mut eagerness = Eagerness::default();
        let now = Instant::now();
        let wait = |_: &usize| {
            let mut spinning = Spinning::new(None, &mut eagerness);
            let looks = spinning.goes_on(now).is_some();
            if looks {
                spinning.ended(in_vain, &mut eagerness);
            }
            eagerness.slept(Duration::from_micros(10));
            looks
        };
        (0..count).filter(wait).count()
    }

    #[test]
    fn looking_goes_on_as_long_as_it_pays() {
        assert_eq!(looks(1000, false), 999);
    }

    #[test]
    fn looking_in_vain_becomes_rare() {
        assert!(
            (5..15).contains(&looks(1000, true)),
            "{}",
            looks(1000, true)
        );
    }

    #[test]
    fn who_sleeps_long_does_not_look() {
        let mut eagerness = Eagerness::default();
        eagerness.slept(Duration::from_millis(1));
        assert_eq!(eagerness.patience(), Duration::ZERO);
    }

    #[test]
    fn the_app_may_say_how_long() {
        let (mut eagerness, now) = (Eagerness::default(), Instant::now());
        eagerness.slept(Duration::ZERO);
        let mut never = Spinning::new(Some(Duration::ZERO), &mut eagerness);
        assert_eq!(never.goes_on(now), None);
        let long = Duration::from_secs(1);
        let mut spinning = Spinning::new(Some(long), &mut eagerness);
        assert_eq!(spinning.goes_on(now), Some(now + long));
        assert_eq!(spinning.goes_on(now + long), None);
        spinning.ended(true, &mut eagerness);
        assert_eq!(spinning.goes_on(now), Some(now + long), "from now on again");
    }
}
