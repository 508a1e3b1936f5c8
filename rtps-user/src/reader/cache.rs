//! The reader's HistoryCache: samples by arrival and by instance, within HISTORY and RESOURCE_LIMITS
//! (RTPS 2.5 section 8.2.2, DDS 1.4 sections 2.2.3.18 and 2.2.3.19).
//!
//! HISTORY and the limits count samples with data. News without data (disposed, no writers) never push data out
//! and are never refused; at most one of them stands between two samples of an instance.

use std::collections::VecDeque;
use std::time::Instant;

use super::change::Change;
use super::entries::{Entries, Entry, List};
use super::events::Events;
use super::instance::Instance;
use super::{InstanceState, ReaderEvent, RejectedReason};
use crate::deadline::Deadlines;
use crate::qos::{History, Qos};
use crate::table::Table;
use crate::wire::{Guid, KeyHash};

/// Instances that a reader without max_instances keeps.
const MAX_INSTANCES: usize = 1 << 20;

/// Where the cache will put a change that it has room for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Place {
    /// With an instance that is there.
    Instance(u32),
    /// With an instance yet to be made.
    NewInstance,
    /// Nowhere: it changes nothing.
    Nowhere,
}

#[derive(Debug)]
pub(super) struct Cache {
    limits: Limits,
    pub(super) entries: Entries,
    pub(super) instances: Table<KeyHash, Instance>,
    /// Instances that may be forgotten when there is no room for others, oldest first.
    idle: VecDeque<KeyHash>,
    deadlines: Deadlines,
    valid_count: usize,
    pub(super) unread_count: usize,
    /// Room for the places of the samples that are being handed out; empty in between.
    pub(super) chosen: Vec<u32>,
}

/// HISTORY and RESOURCE_LIMITS as numbers.
#[derive(Debug)]
struct Limits {
    depth: Option<usize>,
    samples: usize,
    instances: usize,
    samples_per_instance: usize,
}

impl Limits {
    fn new(qos: &Qos) -> Self {
        let number = |limit: Option<u32>| limit.map_or(usize::MAX, |limit| limit as usize);
        let samples_per_instance = number(qos.resource_limits.max_samples_per_instance);
        Self {
            depth: match qos.history {
                History::KeepLast(depth) => Some((depth as usize).min(samples_per_instance).max(1)),
                History::KeepAll => None,
            },
            samples: number(qos.resource_limits.max_samples),
            instances: number(qos.resource_limits.max_instances).min(MAX_INSTANCES),
            samples_per_instance,
        }
    }
}

impl Cache {
    pub(super) fn new(qos: &Qos) -> Self {
        let mut deadlines = Deadlines::default();
        deadlines.set_period(qos.deadline.0.to_std());
        Self {
            limits: Limits::new(qos),
            entries: Entries::default(),
            instances: Table::default(),
            idle: VecDeque::new(),
            deadlines,
            valid_count: 0,
            unread_count: 0,
            chosen: Vec::new(),
        }
    }

    /// Takes over changed policies for what arrives from now on.
    pub(super) fn set_qos(&mut self, qos: &Qos) {
        self.limits = Limits::new(qos);
        self.deadlines.set_period(qos.deadline.0.to_std());
    }

    /// Looks for room for a change.
    pub(super) fn admit(&mut self, change: &Change) -> Result<Place, RejectedReason> {
        let Some(instance) = self.instances.find(change.instance) else {
            return self.admit_instance(change);
        };
        if !change.valid_data {
            return Ok(Place::Instance(instance));
        }
        let count = self.instances[instance].valid_count;
        match self.limits.depth {
            Some(depth) if count >= depth => return Ok(Place::Instance(instance)),
            None if count >= self.limits.samples_per_instance => {
                return Err(RejectedReason::SamplesPerInstance);
            }
            _ => {}
        }
        self.admit_sample()?;
        Ok(Place::Instance(instance))
    }

    fn admit_sample(&self) -> Result<(), RejectedReason> {
        if self.valid_count >= self.limits.samples {
            return Err(RejectedReason::Samples);
        }
        Ok(())
    }

    fn admit_instance(&mut self, change: &Change) -> Result<Place, RejectedReason> {
        let only_unregisters = !change.valid_data && !change.status.disposed;
        if only_unregisters {
            return Ok(Place::Nowhere);
        }
        if change.valid_data {
            self.admit_sample()?;
        }
        if self.instances.len() >= self.limits.instances && !self.forget_idle() {
            return Err(RejectedReason::Instances);
        }
        Ok(Place::NewInstance)
    }

    /// Puts a change where [`admit`](Self::admit) found room for it.
    pub(super) fn store(&mut self, place: Place, change: Change, events: &mut Events) {
        let instance = match place {
            Place::Instance(instance) => instance,
            Place::NewInstance => self.instances.insert(
                change.instance,
                Instance::new(change.instance, change.reception),
            ),
            Place::Nowhere => return,
        };
        let (status, writer) = (change.status, change.writer);
        let mut news = change.valid_data;
        if change.valid_data {
            self.written(instance, writer, change.reception);
            self.make_room(instance);
            self.push(instance, change);
            self.settle(instance, status.disposed, status.unregistered, writer);
        } else if self.settle(instance, status.disposed, status.unregistered, writer) {
            self.push_news(instance, change);
            news = true;
        }
        if news {
            events.data_available();
        }
        self.review(instance);
    }

    fn written(&mut self, place: u32, writer: Guid, now: Instant) {
        let instance = &mut self.instances[place];
        instance.written(writer, now);
        if !instance.watched {
            instance.watched = self.deadlines.watch(instance.key, now);
        }
    }

    /// Applies a dispose, an unregister or both; returns whether the instance's state has changed.
    fn settle(&mut self, instance: u32, dispose: bool, unregister: bool, writer: Guid) -> bool {
        let instance = &mut self.instances[instance];
        let disposed = dispose && instance.dispose(writer);
        let orphaned = unregister && instance.unregister(writer);
        disposed || orphaned
    }

    /// A writer is gone, or not alive: it writes no instance any more.
    pub(super) fn writer_gone(&mut self, now: Instant, writer: Guid, events: &mut Events) {
        for place in self.instances.places() {
            let instance = &mut self.instances[place];
            if instance.unregister(writer) {
                let news = Change::orphaned(instance.key, writer, now);
                self.push_news(place, news);
                events.data_available();
            }
            self.review(place);
        }
    }

    /// Reports instances whose deadline has passed without data.
    pub(super) fn check_deadlines(&mut self, now: Instant, events: &mut Events) {
        while let Some(key) = self.deadlines.pop(now) {
            let Some(place) = self.instances.find(key) else {
                continue;
            };
            let instance = &mut self.instances[place];
            if instance.state != InstanceState::Alive {
                instance.watched = false;
                continue;
            }
            let since = if self.deadlines.is_missed(instance.updated, now) {
                events.push(ReaderEvent::DeadlineMissed { instance: key });
                now
            } else {
                instance.updated
            };
            instance.watched = self.deadlines.watch(key, since);
        }
    }

    pub(super) fn next_deadline(&self) -> Option<Instant> {
        self.deadlines.next()
    }

    /// The samples of an instance, oldest first.
    pub(super) fn samples_of(&self, key: KeyHash) -> List {
        self.instances
            .get(key)
            .map_or_else(List::default, |instance| instance.samples)
    }

    /// Removes a sample.
    pub(super) fn remove(&mut self, place: u32) -> Option<Entry> {
        let instance = &mut self.instances[self.entries.get(place).instance];
        let entry = self.entries.remove(&mut instance.samples, place)?;
        if entry.valid_data {
            instance.valid_count -= 1;
            self.valid_count -= 1;
        }
        if !entry.read {
            self.unread_count -= 1;
        }
        Some(entry)
    }

    /// Forgets an instance that is over, and lists one that is idle.
    pub(super) fn review(&mut self, place: u32) {
        let Some(instance) = self.instances.at_mut(place) else {
            return;
        };
        if instance.is_over() {
            let key = instance.key;
            self.instances.remove(key);
        } else if instance.is_idle() && !instance.listed_idle {
            instance.listed_idle = true;
            self.idle.push_back(instance.key);
        }
    }

    /// Forgets the instance that has been idle for longest; false when there is none.
    fn forget_idle(&mut self) -> bool {
        while let Some(key) = self.idle.pop_front() {
            let Some(place) = self.instances.find(key) else {
                continue;
            };
            self.instances[place].listed_idle = false;
            if self.instances[place].is_idle() {
                self.instances.remove(key);
                return true;
            }
        }
        false
    }

    /// KEEP_LAST: the oldest samples of an instance make room for one more, with the news before them.
    fn make_room(&mut self, instance: u32) {
        let Some(depth) = self.limits.depth else {
            return;
        };
        while self.instances[instance].valid_count >= depth
            && let Some(oldest) = self.instances[instance].samples.first()
        {
            self.remove(oldest);
        }
    }

    fn push(&mut self, place: u32, change: Change) {
        let instance = &mut self.instances[place];
        if change.valid_data {
            instance.valid_count += 1;
            self.valid_count += 1;
        }
        self.unread_count += 1;
        let entry = Entry {
            payload: change.payload,
            valid_data: change.valid_data,
            read: false,
            writer: change.writer,
            sequence: change.sequence,
            timestamp: change.timestamp,
            reception: change.reception,
            disposed_generation: instance.disposed_generation,
            no_writers_generation: instance.no_writers_generation,
            instance: place,
        };
        self.entries.push(&mut instance.samples, entry);
    }

    /// Adds a sample without data, in place of one that would stand right before it.
    fn push_news(&mut self, place: u32, change: Change) {
        if let Some(last) = self.instances[place].samples.last() {
            let last_entry = self.entries.get(last);
            if !last_entry.valid_data {
                self.remove(last);
            }
        }
        self.push(place, change);
    }
}
