//! Looking again and again instead of sleeping: a wake-up costs more than most round trips take, and the one who wakes
//! pays for it as well.
//!
//! The app says for how long, or whether at all. If it says nothing, a thread that was woken soon after it fell asleep
//! looks for a moment before it sleeps again, and lets other processes run between two looks: who is to answer may be
//! waiting for the very same CPU. Where that is in vain it is tried ever more rarely. Where a third process wants the
//! CPU, that one runs for as long as the scheduler likes, and no wake-up helps; then it is not tried for a while.
//! In a stream the thread naps between two looks, see `inflow`.

use std::sync::MutexGuard;
use std::thread;
use std::time::{Duration, Instant};

use super::descriptors::Looks;
use super::inflow::Inflow;
use super::{Core, Shared};

/// How long a thread looks that nobody told to.
const MOMENT: Duration = Duration::from_micros(100);
/// A sleep that was not worth it.
const SHORT: Duration = Duration::from_micros(200);
/// Waits without a look after many in vain.
const MOST_SKIPPED: u32 = 4096;
/// For how long nobody looks after a third process took the CPU, at first and at most.
const REST_MIN: Duration = Duration::from_millis(100);
const REST_MAX: Duration = Duration::from_secs(2);
/// Other threads may have given the protocol something to do by then, and discovery may want to be read.
const GLANCE: Duration = Duration::from_millis(1);
/// Looks between two looks at the clock.
const LOOKS: usize = 16;
/// The system adds some 50 us, unless the thread is of a real-time class.
const NAP: Duration = Duration::from_micros(20);

/// What a thread does between two looks.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Pause {
    /// Nothing: the app has told it to look.
    Spin,
    /// It lets others run.
    Yield,
    /// It gives what arrives time to add up.
    Nap,
}

/// Whether looking for a moment has paid lately.
#[derive(Debug, Default)]
pub(super) struct Eagerness {
    was_short: bool,
    penalty: u32,
    skip: u32,
    /// Disturbed for the first time: the hypervisor, or the system itself, may take the CPU once in a while.
    is_suspicious: bool,
    rest: Duration,
    rests_until: Option<Instant>,
}

/// What came of looking.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Look {
    Found,
    InVain,
    /// Another process had the CPU for long.
    Disturbed,
}

impl Eagerness {
    /// How long to look in the wait that begins now.
    fn patience(&mut self, now: Instant) -> Duration {
        let rests = self.rests_until.is_some_and(|end| now < end);
        if self.was_short && self.skip == 0 && !rests {
            return MOMENT;
        }
        self.skip = self.skip.saturating_sub(1);
        Duration::ZERO
    }

    /// A sleep has ended because something arrived, or for another reason.
    pub(super) fn slept(&mut self, time: Duration) {
        self.was_short = time < SHORT;
    }

    fn looked(&mut self, look: Look, now: Instant) {
        let was_suspicious = std::mem::replace(&mut self.is_suspicious, look == Look::Disturbed);
        self.penalty = match look {
            Look::Found => 0,
            Look::InVain => (self.penalty * 2).clamp(1, MOST_SKIPPED),
            Look::Disturbed => self.penalty,
        };
        self.skip = self.penalty;
        if look == Look::Disturbed && was_suspicious {
            self.rest(now);
        }
    }

    fn rest(&mut self, now: Instant) {
        let is_again = self.rests_until.is_some_and(|end| now < end + REST_MAX);
        self.rest = match is_again {
            true => (self.rest * 2).min(REST_MAX),
            false => REST_MIN,
        };
        self.rests_until = Some(now + self.rest);
    }
}

/// How long a thread in one wait goes on looking.
pub(super) struct Spinning {
    patience: Duration,
    end: Option<Instant>,
    is_told: bool,
    /// Something has come, but not what is waited for, which may be right behind it.
    has_found: bool,
}

impl Spinning {
    /// As long as the app says, `None` if it says nothing.
    pub(super) fn new(
        busy_poll: Option<Duration>,
        eagerness: &mut Eagerness,
        now: Instant,
    ) -> Self {
        Self {
            patience: busy_poll.unwrap_or_else(|| eagerness.patience(now)),
            end: None,
            is_told: busy_poll.is_some(),
            has_found: false,
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

    fn pause(&self, inflow: &Inflow) -> Pause {
        match self.is_told {
            true => Pause::Spin,
            false if inflow.is_stream() => Pause::Nap,
            false => Pause::Yield,
        }
    }

    fn ended(&mut self, look: Look, eagerness: &mut Eagerness, now: Instant) {
        self.end = None;
        self.has_found |= look == Look::Found;
        if !self.is_told {
            eagerness.looked(look, now);
            if look != Look::Found {
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
    ) -> (MutexGuard<'a, Core>, Instant) {
        let Some(end) = spinning.goes_on(now) else {
            if spinning.end.is_some() {
                spinning.ended(Look::InVain, &mut core.seat.eagerness, now);
            }
            return self.sleep_in_seat(core, now, deadline);
        };
        let timeouts = [core.poll_timeout(), deadline];
        let end = timeouts
            .into_iter()
            .flatten()
            .fold(end.min(now + GLANCE), Instant::min);
        let pause = spinning.pause(&core.seat.inflow);
        let arrivals = core.arrivals();
        let skips = pause == Pause::Yield && !spinning.has_found;
        let mut looks = Looks::new(core.likely(), skips);
        self.release(core);
        let outcome = match arrivals {
            Some(arrivals) => look_until(now, end, pause, |_| arrivals.has_arrived()),
            None => look_until(now, end, pause, |now| looks.look(self, now)),
        };
        self.take_in(looks.count, outcome, spinning)
    }

    /// Takes in what is there beside the `count` datagrams that were taken in already.
    fn take_in(
        &self,
        count: usize,
        (is_disturbed, now): (bool, Instant),
        spinning: &mut Spinning,
    ) -> (MutexGuard<'_, Core>, Instant) {
        let mut core = self.lock();
        let wakeups = self.look_in_time(&mut core, now, GLANCE);
        let mut has_found = count > 0;
        if !has_found || !wakeups.is_empty() {
            has_found |= core.receive(now, wakeups) > 0;
        }
        if is_disturbed {
            spinning.ended(Look::Disturbed, &mut core.seat.eagerness, now);
        } else if has_found {
            spinning.ended(Look::Found, &mut core.seat.eagerness, now);
        }
        (core, now)
    }
}

/// Looks until something has arrived or `end` has come. Whether another process had the CPU for long, and the time.
fn look_until(
    start: Instant,
    end: Instant,
    pause: Pause,
    mut has_arrived: impl FnMut(Instant) -> bool,
) -> (bool, Instant) {
    let mut now = start;
    loop {
        let looks = if pause == Pause::Spin { LOOKS } else { 1 };
        for look in 0..looks {
            if has_arrived(now) {
                // What had arrived at the first look was there when the clock was read.
                return (false, if look == 0 { now } else { Instant::now() });
            }
            std::hint::spin_loop();
        }
        match pause {
            Pause::Spin => {}
            Pause::Yield => thread::yield_now(),
            Pause::Nap => thread::sleep(NAP),
        }
        let before = std::mem::replace(&mut now, Instant::now());
        let is_disturbed = pause == Pause::Yield && now >= before + MOMENT;
        if is_disturbed || now >= end {
            return (is_disturbed, now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The waits of `count` in which a thread looks, when all looks have the same result and each sleep is short.
    fn looks(count: usize, look: Look) -> usize {
        let mut eagerness = Eagerness::default();
        let now = Instant::now();
        let wait = |_: &usize| {
            let mut spinning = Spinning::new(None, &mut eagerness, now);
            let looks = spinning.goes_on(now).is_some();
            if looks {
                spinning.ended(look, &mut eagerness, now);
            }
            eagerness.slept(Duration::from_micros(10));
            looks
        };
        (0..count).filter(wait).count()
    }

    #[test]
    fn looking_goes_on_as_long_as_it_pays() {
        assert_eq!(looks(1000, Look::Found), 999);
    }

    #[test]
    fn looking_in_vain_becomes_rare() {
        let count = looks(1000, Look::InVain);
        assert!((5..15).contains(&count), "{count}");
    }

    #[test]
    fn next_to_a_third_process_nobody_looks_for_a_while() {
        let (mut eagerness, mut now) = (Eagerness::default(), Instant::now());
        eagerness.slept(Duration::ZERO);
        eagerness.looked(Look::Disturbed, now);
        assert_eq!(eagerness.patience(now), MOMENT, "that may happen once");
        for rest in [100, 200, 400, 800, 1600, 2000, 2000] {
            eagerness.looked(Look::Disturbed, now);
            let end = now + Duration::from_millis(rest);
            let before = end - Duration::from_millis(1);
            assert_eq!(eagerness.patience(before), Duration::ZERO);
            assert_eq!(eagerness.patience(end), MOMENT);
            now = end;
        }
        eagerness.looked(Look::Found, now);
        now += Duration::from_secs(5);
        eagerness.looked(Look::Disturbed, now);
        eagerness.looked(Look::Disturbed, now);
        assert_eq!(eagerness.rests_until, Some(now + REST_MIN));
    }

    #[test]
    fn who_sleeps_long_does_not_look() {
        let mut eagerness = Eagerness::default();
        eagerness.slept(Duration::from_millis(1));
        assert_eq!(eagerness.patience(Instant::now()), Duration::ZERO);
    }

    #[test]
    fn the_app_may_say_how_long() {
        let (mut eagerness, now) = (Eagerness::default(), Instant::now());
        eagerness.slept(Duration::ZERO);
        let mut never = Spinning::new(Some(Duration::ZERO), &mut eagerness, now);
        assert_eq!(never.goes_on(now), None);
        let long = Duration::from_secs(1);
        let mut spinning = Spinning::new(Some(long), &mut eagerness, now);
        assert_eq!(spinning.goes_on(now), Some(now + long));
        assert_eq!(spinning.goes_on(now + long), None);
        spinning.ended(Look::InVain, &mut eagerness, now);
        assert_eq!(spinning.goes_on(now), Some(now + long), "from now on again");
    }
}
