//! Waiting in the foreground: the waiting thread drives.

use std::sync::atomic::Ordering;
use std::sync::{MutexGuard, PoisonError};
use std::time::Instant;

use super::seat::Holder;
use super::{Core, Shared, clear, signal};
use crate::link::INTERRUPT;
use crate::sys::Wakeups;

impl Shared {
    /// Waits until `look` finds something; `None` when `deadline` passes before, or the participant is gone. `look`
    /// is called whenever something has happened, and at least once.
    pub(crate) fn wait_until<R>(
        &self,
        deadline: Option<Instant>,
        mut look: impl FnMut(&mut Core, Instant) -> Option<R>,
    ) -> Option<R> {
        self.waits.fetch_add(1, Ordering::Relaxed);
        let mut core = self.lock();
        let mut has_seat = false;
        let mut now = Instant::now();
        core.receive(now, Wakeups::default());
        let found = loop {
            let found = look(&mut core, now);
            let is_over = deadline.is_some_and(|deadline| deadline <= now) || core.seat.is_closed;
            if found.is_some() || is_over {
                core.settle(now);
                break found;
            }
            core = if has_seat || self.take_seat(&mut core, now) {
                has_seat = true;
                self.sleep_in_seat(core, now, deadline)
            } else {
                self.follow(core, now, deadline)
            };
            now = Instant::now();
        };
        if has_seat {
            self.leave_seat(&mut core);
        }
        self.release(core);
        found
    }

    /// Runs the protocol with what costs no system call to take in.
    pub(crate) fn poll<R>(&self, look: impl FnOnce(&mut Core, Instant) -> R) -> R {
        self.with(|core, now| {
            core.receive(now, Wakeups::default());
            look(core, now)
        })
    }

    /// Takes the seat unless another foreground thread has it.
    fn take_seat(&self, core: &mut Core, now: Instant) -> bool {
        match core.seat.holder {
            Holder::Foreground => return false,
            // It sleeps, and would compete for what arrives.
            Holder::Background => signal(&self.dismissal),
            Holder::Nobody => {}
        }
        core.seat.holder = Holder::Foreground;
        core.seat.since = Some(now);
        true
    }

    fn sleep_in_seat<'a>(
        &'a self,
        mut core: MutexGuard<'a, Core>,
        now: Instant,
        deadline: Option<Instant>,
    ) -> MutexGuard<'a, Core> {
        let Some(timeout) = core.prepare_sleep(now, deadline) else {
            core.receive(now, Wakeups::default());
            return core;
        };
        self.release(core);
        let wakeups = self.epoll.wait(timeout).unwrap_or_default();
        let mut core = self.lock();
        core.awake();
        if wakeups.contains(INTERRUPT) {
            clear(&self.interrupt);
        }
        core.receive(Instant::now(), wakeups);
        core
    }

    fn leave_seat(&self, core: &mut Core) {
        core.seat.holder = Holder::Nobody;
        core.seat.since = None;
        if core.seat.followers > 0 {
            // One of them takes the seat.
            core.seat.news = true;
        }
        if core.seat.background_rests {
            self.wake_background();
        }
    }

    /// Waits for the thread in the seat to find something.
    fn follow<'a>(
        &'a self,
        mut core: MutexGuard<'a, Core>,
        now: Instant,
        deadline: Option<Instant>,
    ) -> MutexGuard<'a, Core> {
        core.seat.followers += 1;
        let mut core = match deadline {
            None => self
                .followers
                .wait(core)
                .unwrap_or_else(PoisonError::into_inner),
            Some(deadline) => {
                let timeout = deadline.saturating_duration_since(now);
                let result = self.followers.wait_timeout(core, timeout);
                result.unwrap_or_else(PoisonError::into_inner).0
            }
        };
        core.seat.followers -= 1;
        core
    }
}
