//! The instances that a writer has registered, and their offered DEADLINE (DDS 1.4 sections 2.2.2.4.2.5 and 2.2.3.7).
//!
//! Only max_instances and DEADLINE need to know them; writers without either keep no book.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::{WriteError, Writer};
use crate::deadline::Deadlines;
use crate::history::ChangeKind;
use crate::own_keys::OwnKeys;
use crate::qos::Qos;
use crate::wire::KeyHash;

/// The instances.
#[derive(Debug, Default)]
pub(super) struct Registry {
    instances: HashMap<KeyHash, Registered, OwnKeys>,
    /// How many are registered; others are only waiting for their deadline to pass.
    len: usize,
    deadlines: Deadlines,
}

/// An instance.
#[derive(Clone, Copy, Debug)]
struct Registered {
    updated: Instant,
    is_registered: bool,
    /// Whether samples are due: not once it has been disposed.
    is_alive: bool,
    /// Whether it has an entry among the deadlines.
    is_watched: bool,
}

impl Registry {
    /// The one that such a writer needs.
    pub(super) fn new(qos: &Qos) -> Option<Box<Self>> {
        let period = qos.deadline.0.to_std();
        if period.is_none() && qos.resource_limits.max_instances.is_none() {
            return None;
        }
        let mut registry = Self::default();
        registry.deadlines.set_period(period);
        Some(Box::new(registry))
    }

    /// Takes on another DEADLINE. What should have been written by now if it had been in force is missed at once.
    pub(super) fn set_period(&mut self, period: Option<Duration>) {
        self.deadlines.set_period(None);
        self.deadlines.set_period(period);
        for (key, instance) in &mut self.instances {
            instance.is_watched = instance.is_alive && self.deadlines.watch(*key, instance.updated);
        }
        self.instances
            .retain(|_, instance| instance.is_registered || instance.is_watched);
    }

    fn contains(&self, key: KeyHash) -> bool {
        let instance = self.instances.get(&key);
        instance.is_some_and(|instance| instance.is_registered)
    }

    /// Whether one more instance would be too many.
    pub(super) fn is_full_for(&self, key: KeyHash, max: Option<u32>) -> bool {
        max.is_some_and(|max| self.len >= max as usize) && !self.contains(key)
    }

    /// A change of an instance is written.
    pub(super) fn note(&mut self, now: Instant, key: KeyHash, kind: ChangeKind) {
        let instance = self.instances.entry(key).or_insert(Registered {
            updated: now,
            is_registered: false,
            is_alive: false,
            is_watched: false,
        });
        let was_registered = instance.is_registered;
        instance.updated = now;
        instance.is_alive = kind == ChangeKind::Alive;
        instance.is_registered = !kind.status_info().unregistered;
        self.len += usize::from(instance.is_registered);
        self.len -= usize::from(was_registered);
        if instance.is_alive && !instance.is_watched {
            instance.is_watched = self.deadlines.watch(key, now);
        }
        if !instance.is_registered && !instance.is_watched {
            self.instances.remove(&key);
        }
    }

    /// When the next deadline passes.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadlines.next()
    }

    /// The next instance whose deadline has passed.
    pub(super) fn poll_missed(&mut self, now: Instant) -> Option<KeyHash> {
        while let Some(key) = self.deadlines.pop(now) {
            let Some(instance) = self.instances.get_mut(&key) else {
                continue;
            };
            instance.is_watched = false;
            if !instance.is_alive {
                if !instance.is_registered {
                    self.instances.remove(&key);
                }
                continue;
            }
            let is_missed = self.deadlines.is_missed(instance.updated, now);
            let since = if is_missed { now } else { instance.updated };
            instance.is_watched = self.deadlines.watch(key, since);
            if is_missed {
                return Some(key);
            }
        }
        None
    }
}

impl Writer {
    /// Registers an instance before its first sample (DDS 1.4 section 2.2.2.4.2.5). To write it does the same.
    ///
    /// # Errors
    /// Where max_instances forbids it.
    pub fn register_instance(&mut self, now: Instant, instance: KeyHash) -> Result<(), WriteError> {
        let max = self.config.qos.resource_limits.max_instances;
        let Some(registry) = &mut self.registry else {
            return Ok(());
        };
        if registry.is_full_for(instance, max) {
            return Err(WriteError::OutOfResources);
        }
        if !registry.contains(instance) {
            registry.note(now, instance, ChangeKind::Alive);
        }
        Ok(())
    }

    /// Whether an instance has been registered and not been unregistered since. A writer with neither max_instances nor
    /// DEADLINE, which keeps no book, knows those that have changes in its history.
    pub fn is_registered(&self, instance: KeyHash) -> bool {
        match &self.registry {
            Some(registry) => registry.contains(instance),
            None => self.history.instance(instance).is_some(),
        }
    }
}
