//! Looking again and again instead of sleeping: a wake-up costs more than most round trips take.

use std::sync::MutexGuard;
use std::time::{Duration, Instant};

use super::{Core, Shared};
use crate::link::INTERRUPT;
use crate::sys::Wakeups;

/// Other threads may have given the protocol something to do by then.
const GLANCE: Duration = Duration::from_millis(1);
/// Looks between two looks at the clock.
const LOOKS: usize = 32;

/// How long a waiting thread goes on looking.
pub(super) struct Spinning {
    patience: Duration,
    end: Option<Instant>,
}

impl Spinning {
    /// Until `patience` has passed without an arrival.
    pub(super) fn new(patience: Duration) -> Self {
        Self {
            patience,
            end: None,
        }
    }

    /// Whether to look rather than to sleep.
    fn goes_on(&mut self, now: Instant) -> bool {
        let end = *self.end.get_or_insert(now + self.patience);
        now < end
    }
}

impl Shared {
    /// Looks for what arrives, for a while; then it sleeps in the seat.
    pub(super) fn wait_in_seat<'a>(
        &'a self,
        core: MutexGuard<'a, Core>,
        now: Instant,
        deadline: Option<Instant>,
        spinning: &mut Spinning,
    ) -> MutexGuard<'a, Core> {
        if spinning.patience.is_zero() || !spinning.goes_on(now) {
            spinning.end = None;
            return self.sleep_in_seat(core, now, deadline);
        }
        let timeouts = [core.poll_timeout(), deadline, spinning.end];
        let end = timeouts
            .into_iter()
            .flatten()
            .fold(now + GLANCE, Instant::min);
        let arrivals = core.arrivals();
        self.release(core);
        let wakeups = match arrivals {
            Some(arrivals) => {
                look_until(end, || arrivals.has_arrived());
                Wakeups::default()
            }
            None => self.look_at_descriptors(end),
        };
        let now = Instant::now();
        let mut core = self.lock();
        let wakeups = match wakeups.is_empty() {
            true => self.look_in_time(&mut core, now),
            false => wakeups,
        };
        if core.receive(now, wakeups) > 0 {
            spinning.end = None;
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
            super::clear(&self.interrupt);
        }
        wakeups
    }
}

fn look_until(end: Instant, mut has_arrived: impl FnMut() -> bool) {
    while !(0..LOOKS).any(|_| has_arrived()) && Instant::now() < end {
        std::hint::spin_loop();
    }
}
