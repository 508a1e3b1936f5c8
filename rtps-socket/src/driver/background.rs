//! The thread that drives when nobody waits.

use std::os::fd::AsFd;
use std::sync::{MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::seat::Holder;
use super::{Core, Shared, clear};
use crate::link::INTERRUPT;
use crate::sys::{Wakeups, wait_readable};

/// How often it looks whether it is needed while others drive: the longest time that the protocol stands still when
/// an app that used to wait does something else.
const GLANCE: Duration = Duration::from_millis(10);
/// After a foreground thread has slept for so long, it does not even look any more.
const REST_AFTER: Duration = Duration::from_millis(100);
/// The pause after an error of the system, which none of the calls is expected to give.
const ERROR_PAUSE: Duration = Duration::from_millis(100);

/// Drives until the participant is closed.
pub(super) fn run(shared: &Shared) {
    let mut waits_seen = 0;
    let mut core = shared.lock();
    while !core.seat.is_closed {
        core = match core.seat.holder {
            _ if core.seat.is_external => rest(shared, core),
            Holder::Foreground => glance_or_rest(shared, core),
            Holder::Nobody if core.seat.waits != waits_seen && !core.seat.is_wanted => {
                waits_seen = core.seat.waits;
                glance(shared, core)
            }
            Holder::Nobody | Holder::Background => {
                core.seat.holder = Holder::Background;
                core.seat.is_wanted = false;
                drive(shared, core)
            }
        };
    }
}

/// Sleeps once in the seat and follows up on what comes.
fn drive<'a>(shared: &'a Shared, mut core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    let now = Instant::now();
    core.settle(now);
    let Some(timeout) = core.prepare_sleep(now, None) else {
        core.receive(now, Wakeups::default());
        shared.release(core);
        return shared.lock();
    };
    shared.release(core);
    let fds = [shared.epoll.as_fd(), shared.dismissal.as_fd()];
    let [has_arrived, is_dismissed] = wait_readable(fds, timeout).unwrap_or_else(|error| {
        tracing::error!(%error, "the background thread cannot wait");
        std::thread::sleep(ERROR_PAUSE);
        [false, false]
    });
    let mut core = shared.lock();
    if is_dismissed {
        clear(&shared.dismissal);
    }
    if core.seat.holder != Holder::Background {
        return core;
    }
    core.awake();
    let mut wakeups = Wakeups::default();
    if has_arrived {
        wakeups = shared.epoll.wait(Some(Duration::ZERO)).unwrap_or_default();
    }
    if wakeups.contains(INTERRUPT) {
        clear(&shared.interrupt);
    }
    core.receive(Instant::now(), wakeups);
    shared.release(core);
    shared.lock()
}

fn glance_or_rest<'a>(shared: &'a Shared, core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    match core.seat.since {
        Some(since) if since.elapsed() >= REST_AFTER => rest(shared, core),
        _ => glance(shared, core),
    }
}

fn glance<'a>(shared: &'a Shared, core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    let result = shared.background.wait_timeout(core, GLANCE);
    result.unwrap_or_else(PoisonError::into_inner).0
}

/// Sleeps until the thread in the seat leaves it.
fn rest<'a>(shared: &'a Shared, mut core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    core.seat.background_rests = true;
    let mut core = shared
        .background
        .wait(core)
        .unwrap_or_else(PoisonError::into_inner);
    core.seat.background_rests = false;
    core
}
