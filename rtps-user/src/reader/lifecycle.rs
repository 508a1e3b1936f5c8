//! READER_DATA_LIFECYCLE: instances that are over are forgotten, taken or not (DDS 1.4 section 2.2.3.22).

use std::time::{Duration, Instant};

use super::InstanceState;
use super::cache::Cache;
use super::timers::Timers;
use crate::qos::ReaderDataLifecycle;
use crate::wire::KeyHash;

#[derive(Debug)]
pub(super) struct Lifecycle {
    no_writers: Option<Duration>,
    disposed: Option<Duration>,
    due: Timers<KeyHash>,
}

impl Lifecycle {
    pub(super) fn new(qos: ReaderDataLifecycle) -> Self {
        Self {
            no_writers: qos.autopurge_nowriter_samples_delay.to_std(),
            disposed: qos.autopurge_disposed_samples_delay.to_std(),
            due: Timers::default(),
        }
    }

    /// Takes over changed delays, for instances that end from now on.
    pub(super) fn set_qos(&mut self, qos: ReaderDataLifecycle) {
        let due = std::mem::take(&mut self.due);
        *self = Self {
            due,
            ..Self::new(qos)
        };
    }

    /// An instance has come into a state.
    pub(super) fn entered(&mut self, now: Instant, instance: KeyHash, state: InstanceState) {
        let delay = match state {
            InstanceState::Alive => None,
            InstanceState::NotAliveDisposed => self.disposed,
            InstanceState::NotAliveNoWriters => self.no_writers,
        };
        match delay.and_then(|delay| now.checked_add(delay)) {
            Some(at) => self.due.set(instance, at),
            None => self.due.cancel(instance),
        }
    }

    /// An instance is there no more.
    pub(super) fn forget(&mut self, instance: KeyHash) {
        self.due.cancel(instance);
    }

    /// When [`purge`](Cache::purge) has something to do.
    pub(super) fn next(&self) -> Option<Instant> {
        self.due.next()
    }
}

impl Cache {
    /// Drops the samples of instances that have been over for long enough.
    pub(super) fn purge(&mut self, now: Instant) {
        while let Some(key) = self.lifecycle.due.pop(now) {
            let Some(place) = self.instances.find(key) else {
                continue;
            };
            while let Some(oldest) = self.instances[place].samples.first() {
                self.remove(oldest);
            }
            self.review(place);
        }
    }
}
