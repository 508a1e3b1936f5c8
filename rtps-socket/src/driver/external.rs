//! Driving from an event loop of the caller's own.
//!
//! The loop waits for one descriptor, the participant's epoll instance, and calls [`Shared::drive`] whenever it is
//! readable. A timer in the epoll set stands for the timeout that the loop is not told.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::{Duration, Instant};

use nix::sys::timer::TimerSetTimeFlags;
use nix::sys::timerfd::Expiration;

use super::{Core, Shared, clear, signal};
use crate::link::{INTERRUPT, TIMER};
use crate::sys::{Interest, Wakeups};

/// How often what arrives meanwhile is taken in before the caller gets its turn.
const ROUNDS: usize = 4;

impl Shared {
    /// The descriptor to wait for; from the first call on it is the caller who drives.
    pub(crate) fn external_fd(&self) -> BorrowedFd<'_> {
        let mut core = self.lock();
        if !core.seat.is_external {
            core.seat.is_external = true;
            if let Err(error) = self.epoll.add(self.timer.as_fd(), TIMER, Interest::Level) {
                tracing::error!(%error, "the timer cannot be watched");
            }
            signal(&self.dismissal);
        }
        self.release(core);
        self.epoll.as_fd()
    }

    /// Takes in what has arrived and does what is due, without waiting.
    pub(crate) fn drive(&self) {
        let wakeups = self.epoll.wait(Some(Duration::ZERO)).unwrap_or_default();
        let mut core = self.lock();
        core.awake();
        if wakeups.contains(INTERRUPT) {
            clear(&self.interrupt);
        }
        if wakeups.contains(TIMER) {
            // Reading it only makes it unreadable.
            let _ = self.timer.wait();
            core.seat.timer = None;
        }
        core.receive(Instant::now(), wakeups);
        self.release(core);
    }

    /// Asks to be woken, now that the caller goes back to its loop.
    pub(super) fn prepare_external_sleep(&self, core: &mut Core) {
        let now = Instant::now();
        if !(0..ROUNDS).any(|_| core.is_quiet(now)) {
            // There is more: the descriptor stays readable, and the caller's loop gets its turn before.
            signal(&self.interrupt);
        }
        let Some(due) = core.poll_timeout() else {
            return;
        };
        // A timer that fires too early does no harm; setting it at every step would.
        if core.seat.timer.is_none_or(|timer| timer > due) {
            core.seat.timer = Some(due);
            // Zero would switch the timer off.
            let delay = due
                .saturating_duration_since(now)
                .max(Duration::from_nanos(1));
            let expiration = Expiration::OneShot(delay.into());
            if let Err(error) = self.timer.set(expiration, TimerSetTimeFlags::empty()) {
                tracing::error!(%error, "the timer cannot be set");
            }
        }
    }
}

impl Core {
    /// Asks to be woken, or takes in what has arrived.
    fn is_quiet(&mut self, now: Instant) -> bool {
        let is_quiet = self.prepare_sleep(now, None).is_some();
        if !is_quiet {
            self.receive(now, Wakeups::default());
        }
        is_quiet
    }
}
