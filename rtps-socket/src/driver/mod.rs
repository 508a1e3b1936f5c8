//! Who runs the protocol: whoever waits.
//!
//! A participant has one [`Core`] behind one lock. A thread that waits for data takes the [`Seat`]: it sleeps on the
//! participant's descriptors itself, and when it wakes it reads, runs the protocol, sends what comes out, and finds
//! its sample, with no thread in between. Threads that come later wait for the one in the seat. A background thread
//! takes the seat when nobody has slept in it for a while, so that the protocol stands still for some twenty
//! milliseconds at most; while others drive it only looks now and then, and not even that when the one in the seat
//! sleeps for long. Calls that find or do not find something at once do not count as driving where samples come
//! through descriptors: they look at those once, and leave the rest to the background thread.
//!
//! Listeners and wakers are called, and dropped, by the driving thread after it let go of the lock. A listener that
//! waits drives on in the seat of its thread.

mod audience;
mod background;
mod batching;
mod browser;
mod core;
mod descriptors;
mod entity;
mod external;
mod group_sets;
mod ignored;
mod inflow;
mod news;
mod outgoing;
mod scope;
mod seat;
mod spin;
mod topics;
mod wait;
mod wall_clock;

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::{self, JoinHandle, Thread};
use std::time::{Duration, Instant};

use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::timerfd::{ClockId, TimerFd, TimerFlags};

pub(crate) use self::audience::{EntityListener, GroupId, Listener};
pub(crate) use self::batching::{Patience, PatienceCell};
pub(crate) use self::browser::Browser;
pub(crate) use self::core::Core;
pub(crate) use self::entity::{Declaration, Inherits, MakeFilter};
pub(crate) use self::ignored::Ignore;
pub(crate) use self::scope::Scope;
pub(crate) use self::topics::TopicId;
pub(crate) use self::wait::Limit;

use self::entity::Notice;
use self::seat::Holder;
use crate::link::{self, INTERRUPT, Link, OpenError, Settings};
use crate::sys::{Epoll, Interest, Wakeups};

/// What the driving threads share.
pub(crate) struct Shared {
    core: Mutex<Core>,
    epoll: Arc<Epoll>,
    /// Ends the sleep of whoever has the seat.
    interrupt: EventFd,
    /// Tells the background thread that its seat was taken.
    dismissal: EventFd,
    /// For callers who drive by themselves; they cannot be told a timeout.
    timer: TimerFd,
    /// The background thread, which is parked while others drive.
    background: OnceLock<Thread>,
    /// How often others have driven: the background thread looks at it without taking the lock.
    waits: AtomicU64,
    /// Where threads wait while another has the seat.
    followers: Condvar,
    /// For how long a waiting thread looks for itself before it sleeps, if the app says so.
    busy_poll: Option<Duration>,
}

/// A participant: the last handle that goes leaves the domain.
pub(crate) struct Driver {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Driver {
    /// Connects to a layer and starts the background thread.
    pub(crate) fn open(settings: &Settings) -> Result<Self, OpenError> {
        let epoll = Arc::new(Epoll::new()?);
        let link = link::open(settings, &epoll)?;
        Self::start(link, epoll, settings.busy_poll)
    }

    /// Starts driving a link, whose descriptors are in `epoll`.
    fn start(
        link: Box<dyn Link>,
        epoll: Arc<Epoll>,
        busy_poll: Option<Duration>,
    ) -> Result<Self, OpenError> {
        let interrupt = event()?;
        epoll.add(
            std::os::fd::AsFd::as_fd(&interrupt),
            INTERRUPT,
            Interest::Level,
        )?;
        let timer = TimerFd::new(
            ClockId::CLOCK_MONOTONIC,
            TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC,
        )
        .map_err(std::io::Error::from)?;
        let shared = Arc::new(Shared {
            core: Mutex::new(Core::new(link)),
            epoll,
            interrupt,
            dismissal: event()?,
            timer,
            background: OnceLock::new(),
            waits: AtomicU64::new(0),
            followers: Condvar::new(),
            busy_poll,
        });
        let driven = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("rtps-background".to_owned())
            .spawn(move || background::run(&driven))?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// What the participant's entities work with.
    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.shared.with(|core, now| {
            core.shutdown(now);
            core.seat.is_closed = true;
        });
        self.shared.wake_background();
        self.shared.followers.notify_all();
        signal(&self.shared.dismissal);
        signal(&self.shared.interrupt);
        if let Some(thread) = self.thread.take() {
            // A listener, which the background thread calls, may hold the last handle.
            if thread.thread().id() != thread::current().id() && thread.join().is_err() {
                tracing::error!("the background thread has panicked");
            }
        }
    }
}

impl Shared {
    /// Runs `act` on the core, then whatever follows from it: sending, waking, calling listeners.
    pub(crate) fn with<R>(&self, act: impl FnOnce(&mut Core, Instant) -> R) -> R {
        let mut core = self.lock();
        core.batching.interrupt();
        let now = Instant::now();
        let result = act(&mut core, now);
        core.settle(now);
        self.release(core);
        result
    }

    /// Writes `len` bytes with `act`, and sends them unless they wait for more.
    pub(crate) fn write<R>(
        &self,
        len: usize,
        patience: Patience,
        act: impl FnOnce(&mut Core, Instant) -> R,
    ) -> R {
        let mut core = self.lock();
        let now = Instant::now();
        let result = act(&mut core, now);
        let was_holding = core.batching.due().is_some();
        if !core.note_write(now, len, patience) {
            core.batching.sent();
            core.receive(now, Wakeups::default());
            let is_alone = core.seat.holder == Holder::Nobody;
            self.look_briefly(&mut core, now, is_alone);
            core.batching.wrote(Instant::now);
            self.release(core);
        } else if !was_holding {
            core.seat.is_wanted |= !core.seat.is_external && core.seat.holder == Holder::Nobody;
            self.release(core);
        }
        result
    }

    fn wake_background(&self) {
        if let Some(thread) = self.background.get() {
            thread.unpark();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Core> {
        // A panic of a listener does not happen under the lock, and the core has no state half changed.
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets go of a settled core and tells everybody who has to know.
    fn release(&self, mut core: MutexGuard<'_, Core>) {
        if core.seat.is_external && core.seat.holder != Holder::Foreground {
            self.prepare_external_sleep(&mut core);
        } else if core.seat.sleeps()
            && (core.seat.sleeps_beyond(core.poll_timeout())
                || core.seat.sleeps_through(core.batching.relief()))
        {
            core.seat.sleeps_until = None;
            signal(&self.interrupt);
        }
        // Preparing a sleep may have received something.
        let notices = core.take_notices();
        if core.seat.followers > 0 && core.seat.news {
            self.followers.notify_all();
        }
        core.seat.news = false;
        if core.seat.is_wanted && core.seat.holder == Holder::Nobody {
            self.wake_background();
        }
        drop(core);
        if !notices.is_empty() {
            notices.into_iter().for_each(Notice::deliver);
        }
    }
}

fn event() -> std::io::Result<EventFd> {
    Ok(EventFd::from_flags(
        EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK,
    )?)
}

fn signal(event: &EventFd) {
    // Fails only when 2^64 - 2 signals are pending, and then the reader wakes anyway.
    let _ = event.write(1);
}

fn clear(event: &EventFd) {
    // Fails only when there is nothing to clear.
    let _ = event.read();
}

#[cfg(test)]
mod tests;
