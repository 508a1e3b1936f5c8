//! Waiting in the foreground: the waiting thread drives.

use std::sync::atomic::Ordering;
use std::sync::{MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rtps_user::wire::EntityId;

use super::seat::{Holder, LOOK_PERIOD, this_thread};
use super::spin::Spinning;
use super::{Core, Shared, clear, signal};
use crate::link::{INTERRUPT, LayerKind};
use crate::sys::Wakeups;

/// How long a call may wait.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Limit {
    /// For so long from its beginning on, so that it reads the clock only once.
    For(Duration),
    /// Until then; `None` is for ever.
    Until(Option<Instant>),
}

impl Limit {
    /// When the wait ends that begins now, if this is its first.
    fn end(&mut self, now: Instant) -> Option<Instant> {
        let end = match *self {
            // The clock may have no such time.
            Self::For(timeout) => now.checked_add(timeout),
            Self::Until(end) => end,
        };
        *self = Self::Until(end);
        end
    }
}

impl From<Duration> for Limit {
    fn from(timeout: Duration) -> Self {
        Self::For(timeout)
    }
}

impl From<Option<Instant>> for Limit {
    fn from(end: Option<Instant>) -> Self {
        Self::Until(end)
    }
}

impl Shared {
    /// Waits until `look` finds something; `None` when `limit` is over before, or the participant is gone. `look`
    /// is called whenever something has happened, and at least once.
    pub(crate) fn wait_until<R>(
        &self,
        limit: impl Into<Limit>,
        look: impl FnMut(&mut Core, Instant) -> Option<R>,
    ) -> Option<R> {
        self.wait_with(|core, now| core.take_in(now), &mut limit.into(), look)
    }

    /// As [`wait_until`](Self::wait_until), for something in a reader, and for one of several waits that share a limit.
    pub(crate) fn wait_in_reader<R>(
        &self,
        id: EntityId,
        limit: &mut Limit,
        look: impl FnMut(&mut Core, Instant) -> Option<R>,
    ) -> Option<R> {
        let take_in = |core: &mut Core, now| {
            if !core.has_backlog(now, id) {
                core.take_in(now);
            }
        };
        self.wait_with(take_in, limit, look)
    }

    fn wait_with<R>(
        &self,
        take_in: impl FnOnce(&mut Core, Instant),
        limit: &mut Limit,
        mut look: impl FnMut(&mut Core, Instant) -> Option<R>,
    ) -> Option<R> {
        let mut core = self.lock();
        let is_nested = core.seat.is_mine();
        let mut has_seat = is_nested;
        let mut has_looked = false;
        let mut now = Instant::now();
        let deadline = limit.end(now);
        let mut spinning = Spinning::new(self.busy_poll, &mut core.seat.eagerness, now);
        core.batching.sent();
        take_in(&mut core, now);
        let found = loop {
            let found = look(&mut core, now);
            // A wait without a deadline would never end in a participant that lost its layer.
            let is_over = deadline.map_or_else(|| core.is_lost(), |deadline| deadline <= now)
                || core.seat.is_closed;
            if found.is_some() || is_over {
                if !has_seat && !has_looked {
                    has_looked = true;
                    let has_news = self.look_briefly(&mut core, now, found.is_some());
                    if has_news && found.is_none() {
                        continue;
                    }
                }
                core.settle(now);
                break found;
            }
            (core, now) = if has_seat || self.take_seat(&mut core, now) {
                has_seat = true;
                self.wait_in_seat(core, now, deadline, &mut spinning)
            } else {
                self.follow(core, now, deadline)
            };
        };
        if is_nested {
            // The sleep that was prepared before the listener was called is out of date.
            signal(&self.interrupt);
        } else if has_seat {
            self.leave_seat(&mut core);
        }
        self.release(core);
        found
    }

    /// Has all waiting threads look again for what they wait for.
    pub(crate) fn nudge(&self) {
        let mut core = self.lock();
        core.seat.news = true;
        signal(&self.interrupt);
        self.release(core);
    }

    /// Runs the protocol with what costs no system call to take in.
    pub(crate) fn poll<R>(&self, look: impl FnOnce(&mut Core, Instant) -> R) -> R {
        self.with(|core, now| {
            core.take_in(now);
            self.look_briefly(core, now, false);
            look(core, now)
        })
    }

    /// As [`poll`](Self::poll), for something in a reader.
    pub(crate) fn poll_reader<R>(
        &self,
        id: EntityId,
        look: impl FnOnce(&mut Core, Instant) -> R,
    ) -> R {
        self.with(|core, now| {
            if core.has_backlog(now, id) {
                self.send_background_away(core);
            } else {
                core.take_in(now);
                self.look_briefly(core, now, false);
            }
            look(core, now)
        })
    }

    /// Looks at the descriptors in a call that does not wait: a caller who only ever polls gets all the same what comes
    /// through them. Whether it was time to, and something was there.
    pub(super) fn look_briefly(&self, core: &mut Core, now: Instant, is_busy: bool) -> bool {
        let period = match core.layer() {
            LayerKind::InProcess if !is_busy => Duration::ZERO,
            LayerKind::InProcess | LayerKind::Kernel => LOOK_PERIOD,
        };
        if !core.seat.is_free() || !core.seat.is_unseen(now, period) {
            return false;
        }
        let wakeups = self.look(core, now);
        core.receive(now, wakeups);
        !wakeups.is_empty()
    }

    /// Asks for what is readable, without waiting.
    pub(super) fn look(&self, core: &mut Core, now: Instant) -> Wakeups {
        core.seat.looked = Some(now);
        // Where samples come through descriptors, a look now and then is not enough to keep up with them, and the
        // background thread has to help.
        if core.layer() == LayerKind::Kernel {
            self.waits.fetch_add(1, Ordering::Relaxed);
        }
        let wakeups = self.epoll.wait(Some(Duration::ZERO)).unwrap_or_default();
        if wakeups.contains(INTERRUPT) {
            clear(&self.interrupt);
        }
        wakeups
    }

    /// What is readable, where nobody has looked for `period`, for who finds no time to sleep.
    pub(super) fn look_in_time(&self, core: &mut Core, now: Instant, period: Duration) -> Wakeups {
        match core.seat.is_unseen(now, period) {
            true => self.look(core, now),
            false => Wakeups::default(),
        }
    }

    /// Takes the seat unless another foreground thread has it.
    fn take_seat(&self, core: &mut Core, now: Instant) -> bool {
        match core.seat.holder {
            Holder::Foreground => return false,
            Holder::Background => self.dismiss_background(core),
            Holder::Nobody => {}
        }
        core.seat.holder = Holder::Foreground;
        core.seat.since = Some(now);
        core.seat.thread = Some(this_thread());
        true
    }

    /// Nobody takes in anything for a while, and the background thread glances whether that goes on.
    fn send_background_away(&self, core: &mut Core) {
        self.waits.fetch_add(1, Ordering::Relaxed);
        if core.seat.holder == Holder::Background {
            self.dismiss_background(core);
        }
    }

    /// Takes the seat from the background thread. It sleeps, would compete for what arrives, and has asked to be woken.
    fn dismiss_background(&self, core: &mut Core) {
        signal(&self.dismissal);
        core.awake();
        core.seat.holder = Holder::Nobody;
    }

    pub(super) fn sleep_in_seat<'a>(
        &'a self,
        mut core: MutexGuard<'a, Core>,
        now: Instant,
        deadline: Option<Instant>,
    ) -> (MutexGuard<'a, Core>, Instant) {
        let Some(timeout) = core.prepare_sleep(now, deadline) else {
            let now = Instant::now();
            let wakeups = self.look_in_time(&mut core, now, LOOK_PERIOD);
            core.receive(now, wakeups);
            return (core, now);
        };
        self.release(core);
        let wakeups = self.epoll.wait(timeout).unwrap_or_default();
        self.waits.fetch_add(1, Ordering::Relaxed);
        let asleep = now;
        let now = Instant::now();
        let mut core = self.lock();
        core.awake();
        core.seat.eagerness.slept(now - asleep);
        core.seat.looked = Some(now);
        if wakeups.contains(INTERRUPT) {
            clear(&self.interrupt);
        }
        core.receive(now, wakeups);
        (core, now)
    }

    fn leave_seat(&self, core: &mut Core) {
        core.seat.holder = Holder::Nobody;
        core.seat.since = None;
        core.seat.thread = None;
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
    ) -> (MutexGuard<'a, Core>, Instant) {
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
        (core, Instant::now())
    }
}
