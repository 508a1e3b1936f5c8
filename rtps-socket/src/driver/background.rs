//! The thread that drives when nobody waits.

use std::os::fd::AsFd;
use std::sync::MutexGuard;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use super::seat::{Holder, LOOK_PERIOD};
use super::{Core, Shared, clear};
use crate::link::INTERRUPT;
use crate::sys::{Wakeups, wait_readable};

/// How often it looks whether it is needed while others drive: the longest time that the protocol stands still when
/// an app that used to wait does something else.
const GLANCE: Duration = Duration::from_millis(10);
/// How much later it may look: no timer of its own interrupts those who drive then, a tick of the system does.
const GLANCE_SLACK: Duration = Duration::from_millis(5);
/// The pause after an error of the system, which none of the calls is expected to give.
const ERROR_PAUSE: Duration = Duration::from_millis(100);

/// Drives until the participant is closed.
pub(super) fn run(shared: &Shared) {
    // Nobody else sets it.
    shared.background.get_or_init(thread::current);
    let mut waits_seen = 0;
    let mut core = shared.lock();
    while !core.seat.is_closed {
        let is_busy = shared.waits.load(Ordering::Relaxed) != waits_seen;
        core = match core.seat.holder {
            _ if core.seat.is_external => rest(shared, core),
            Holder::Foreground if core.seat.rests() => rest(shared, core),
            Holder::Nobody if !is_busy || core.seat.is_wanted => take_seat(shared, core),
            Holder::Background => drive(shared, core),
            Holder::Nobody | Holder::Foreground => {
                drop(core);
                waits_seen = glance(shared);
                shared.lock()
            }
        };
    }
}

fn take_seat<'a>(shared: &'a Shared, mut core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    core.seat.holder = Holder::Background;
    core.seat.is_wanted = false;
    drive(shared, core)
}

/// Sleeps once in the seat and follows up on what comes.
fn drive<'a>(shared: &'a Shared, mut core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    let now = Instant::now();
    core.settle(now);
    let sleep = core
        .prepare_nap(now)
        .or_else(|| core.prepare_sleep(now, None));
    let Some(timeout) = sleep else {
        let wakeups = shared.look_in_time(&mut core, now, LOOK_PERIOD);
        core.receive(now, wakeups);
        shared.release(core);
        return shared.lock();
    };
    // Who naps is woken by the interrupt alone.
    let descriptors = match core.seat.naps {
        true => shared.interrupt.as_fd(),
        false => shared.epoll.as_fd(),
    };
    shared.release(core);
    let fds = [descriptors, shared.dismissal.as_fd()];
    let [has_arrived, is_dismissed] = wait_readable(fds, timeout).unwrap_or_else(|error| {
        tracing::error!(%error, "the background thread cannot wait");
        thread::sleep(ERROR_PAUSE);
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
    core.seat.looked = Some(Instant::now());
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

/// Looks now and then, without the lock, whether others still drive. Returns when there was no wait in between, or
/// when somebody wants something.
fn glance(shared: &Shared) -> u64 {
    let mut waits = shared.waits.load(Ordering::Relaxed);
    set_timer_slack(GLANCE_SLACK);
    loop {
        let start = Instant::now();
        thread::park_timeout(GLANCE);
        let before = std::mem::replace(&mut waits, shared.waits.load(Ordering::Relaxed));
        if waits == before || start.elapsed() < GLANCE {
            break;
        }
    }
    set_timer_slack(Duration::ZERO);
    waits
}

/// Lets timers of this thread be late (PR_SET_TIMERSLACK(2const)); zero is for what they are allowed to be usually.
fn set_timer_slack(slack: Duration) {
    let slack = u64::try_from(slack.as_nanos()).unwrap_or_default();
    if let Err(error) = nix::sys::prctl::set_timerslack(slack) {
        tracing::debug!(%error, "timers cannot be late");
    }
}

/// Sleeps until the thread in the seat leaves it.
fn rest<'a>(shared: &'a Shared, mut core: MutexGuard<'a, Core>) -> MutexGuard<'a, Core> {
    core.seat.background_rests = true;
    drop(core);
    thread::park();
    let mut core = shared.lock();
    core.seat.background_rests = false;
    core
}
