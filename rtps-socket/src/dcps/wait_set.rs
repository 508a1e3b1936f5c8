//! WaitSet (DDS 1.4 section 2.2.2.1.6).
//!
//! Where all conditions are of one participant, the waiting thread drives it, as a thread does that waits for one
//! reader. Where they are of several, their background threads drive, and wake the one that waits.

use std::fmt;
use std::future::poll_fn;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Wake, Waker};
use std::time::{Duration, Instant};

use super::Condition;
use super::condition::Source;
use crate::driver::Shared;

/// Waits until one of several conditions is true. May be shared by threads.
#[derive(Default)]
pub struct WaitSet {
    conditions: Mutex<Vec<Condition>>,
    bell: Arc<Bell>,
}

/// Wakes threads that wait for participants which others drive.
#[derive(Default)]
struct Bell {
    rings: Mutex<u64>,
    heard: Condvar,
}

impl Wake for Bell {
    fn wake(self: Arc<Self>) {
        *self.lock() += 1;
        self.heard.notify_all();
    }
}

impl Bell {
    /// Waits until it has rung after `seen`; false when `deadline` passes before.
    fn wait(&self, seen: u64, deadline: Option<Instant>) -> bool {
        let mut rings = self.lock();
        while *rings == seen {
            rings = match deadline {
                None => self
                    .heard
                    .wait(rings)
                    .unwrap_or_else(PoisonError::into_inner),
                Some(deadline) => {
                    let left = deadline.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return false;
                    }
                    let result = self.heard.wait_timeout(rings, left);
                    result.unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
        true
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.rings.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Has the thread that drives a participant look again.
struct Nudge(Arc<Shared>);

impl Wake for Nudge {
    fn wake(self: Arc<Self>) {
        self.0.nudge();
    }
}

impl WaitSet {
    /// One without conditions.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a condition; one that is there already is not added again. A wait that goes on does not heed it.
    pub fn attach(&self, condition: &impl AsRef<Condition>) {
        let mut conditions = self.lock();
        if !conditions.contains(condition.as_ref()) {
            conditions.push(condition.as_ref().clone());
        }
    }

    /// Takes a condition out.
    pub fn detach(&self, condition: &impl AsRef<Condition>) {
        self.lock().retain(|known| known != condition.as_ref());
    }

    /// The conditions.
    pub fn conditions(&self) -> Vec<Condition> {
        self.lock().clone()
    }

    /// Waits until conditions are true, and says which; none when `timeout` passes before.
    pub fn wait(&self, timeout: Duration) -> Vec<Condition> {
        let conditions = self.conditions();
        let deadline = Instant::now().checked_add(timeout);
        match only_participant(&conditions) {
            Some(shared) => drive(&shared, &conditions, deadline),
            None => self.listen(&conditions, deadline),
        }
    }

    /// Waits for `async` code with any runtime, until conditions are true, and says which.
    pub async fn wait_async(&self) -> Vec<Condition> {
        let conditions = self.conditions();
        poll_fn(|context| {
            let found = look(&conditions, context.waker());
            match found.is_empty() {
                true => Poll::Pending,
                false => Poll::Ready(found),
            }
        })
        .await
    }

    /// Waits until those who drive have news.
    fn listen(&self, conditions: &[Condition], deadline: Option<Instant>) -> Vec<Condition> {
        let waker = Waker::from(Arc::clone(&self.bell));
        loop {
            let seen = *self.bell.lock();
            let found = look(conditions, &waker);
            if !found.is_empty() || !self.bell.wait(seen, deadline) {
                return found;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Condition>> {
        self.conditions
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for WaitSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.conditions()).finish()
    }
}

/// The participant that all conditions of entities are of.
fn only_participant(conditions: &[Condition]) -> Option<Arc<Shared>> {
    let mut participants = conditions
        .iter()
        .filter_map(|condition| match condition.source() {
            Source::Entity(watched) => Some(watched.shared()),
            Source::Guard(_) => None,
        });
    let first = participants.next()?;
    let is_only = participants.all(|other| Arc::ptr_eq(first, other));
    is_only.then(|| Arc::clone(first))
}

/// Drives the participant until a condition is true.
fn drive(
    shared: &Arc<Shared>,
    conditions: &[Condition],
    deadline: Option<Instant>,
) -> Vec<Condition> {
    let guards = conditions
        .iter()
        .filter_map(|condition| match condition.source() {
            Source::Guard(guard) => Some(guard),
            Source::Entity(_) => None,
        });
    let nudge = Waker::from(Arc::new(Nudge(Arc::clone(shared))));
    guards.clone().for_each(|guard| guard.wake_later(&nudge));
    let found = shared.wait_until(deadline, |core, _| {
        let is_true = |condition: &&Condition| match condition.source() {
            Source::Guard(guard) => guard.is_true(),
            Source::Entity(watched) => watched.is_true(core),
        };
        let found: Vec<_> = conditions.iter().filter(is_true).cloned().collect();
        (!found.is_empty()).then_some(found)
    });
    guards.for_each(|guard| guard.wake_no_more(&nudge));
    found.unwrap_or_default()
}

/// The conditions that are true; without any, has `waker` woken when there may be one.
fn look(conditions: &[Condition], waker: &Waker) -> Vec<Condition> {
    let is_true = |condition: &&Condition| match condition.source() {
        Source::Guard(guard) => {
            // Before the look, so that nothing is missed.
            guard.wake_later(waker);
            guard.is_true()
        }
        Source::Entity(watched) => watched.shared().poll(|core, _| {
            core.wake_later(watched.scope(), waker);
            watched.is_true(core)
        }),
    };
    let found: Vec<_> = conditions.iter().filter(is_true).cloned().collect();
    if !found.is_empty() {
        conditions
            .iter()
            .for_each(|condition| forget(condition, waker));
    }
    found
}

/// Nobody waits any more.
fn forget(condition: &Condition, waker: &Waker) {
    match condition.source() {
        Source::Guard(guard) => guard.wake_no_more(waker),
        Source::Entity(watched) => watched
            .shared()
            .with(|core, _| core.wake_no_more(watched.scope(), waker)),
    }
}
