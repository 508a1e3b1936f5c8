//! The reader's HistoryCache: samples by arrival and by instance, within HISTORY and RESOURCE_LIMITS
//! (RTPS 2.5 section 8.2.2, DDS 1.4 sections 2.2.3.18 and 2.2.3.19).
//!
//! HISTORY and the limits count samples with data. News without data (disposed, no writers) never push data out
//! and are never refused; at most one of them stands between two samples of an instance.

use std::collections::{BTreeSet, VecDeque};
use std::time::Instant;

use super::admission::{Limits, Place};
use super::change::Change;
use super::entries::{Entries, Entry, List};
use super::events::Events;
use super::groups::Groups;
use super::instance::Instance;
use super::lifecycle::Lifecycle;
use super::ownership::Strengths;
use super::rules::Rules;
use super::timers::Timers;
use super::{InstanceState, ReaderConfig, ReaderEvent};
use crate::deadline::Deadlines;
use crate::qos::{Ownership, Presentation, PresentationScope, Qos};
use crate::table::Table;
use crate::wire::{Guid, KeyHash, StatusInfo};

#[derive(Debug)]
pub(super) struct Cache {
    pub(super) limits: Limits,
    pub(super) entries: Entries,
    pub(super) instances: Table<KeyHash, Instance>,
    /// Instances that may be forgotten when there is no room for others, oldest first.
    pub(super) idle: VecDeque<KeyHash>,
    deadlines: Deadlines,
    pub(super) lifecycle: Lifecycle,
    /// Whether anything may ever be due.
    is_timed: bool,
    pub(super) rules: Option<Box<Rules>>,
    /// When samples expire, by their places (LIFESPAN).
    expiries: Timers<u32>,
    pub(super) valid_count: usize,
    pub(super) unread_count: usize,
    /// Changes of coherent sets that wait, for which room is kept.
    pub(super) staged: usize,
    /// Parts of the sets of publishers, where somebody releases them.
    pub(super) groups: Option<Groups>,
    /// Whether a content filter keeps samples out, so that there are instances that nothing is known of.
    pub(super) is_filtered: bool,
    /// Whether samples that are handed out together are in the order of their instances first (PRESENTATION).
    pub(super) groups_instances: bool,
    /// Samples that have come before so many others are visible.
    pub(super) horizon: u64,
    /// The instances with samples, by their keys, once somebody walks over them.
    pub(super) walked: Option<BTreeSet<KeyHash>>,
    /// Room for the places of the samples that are being handed out; empty in between.
    pub(super) chosen: Vec<u32>,
}

/// Whether a reader with these policies has something to do as time passes, whatever its writers offer.
fn is_timed(qos: &Qos) -> bool {
    let lifecycle = qos.reader_data_lifecycle;
    !qos.deadline.0.is_infinite()
        || !lifecycle.autopurge_nowriter_samples_delay.is_infinite()
        || !lifecycle.autopurge_disposed_samples_delay.is_infinite()
        || qos.time_based_filter.0 != crate::wire::Duration::ZERO
}

/// INSTANCE scope is the default, too; only who asks for a kind of access means it.
fn groups_instances(presentation: Presentation) -> bool {
    let is_asked_for = presentation.coherent || presentation.ordered;
    is_asked_for && presentation.scope == PresentationScope::Instance
}

impl Cache {
    pub(super) fn new(config: &ReaderConfig) -> Self {
        let qos = &config.qos;
        let mut deadlines = Deadlines::default();
        deadlines.set_period(qos.deadline.0.to_std());
        Self {
            limits: Limits::new(qos),
            entries: Entries::default(),
            instances: Table::default(),
            idle: VecDeque::new(),
            deadlines,
            lifecycle: Lifecycle::new(qos.reader_data_lifecycle),
            is_timed: is_timed(qos),
            rules: Rules::new(qos),
            expiries: Timers::default(),
            valid_count: 0,
            unread_count: 0,
            staged: 0,
            groups: None,
            is_filtered: config.content_filter.is_some(),
            groups_instances: groups_instances(qos.presentation),
            horizon: u64::MAX,
            walked: None,
            chosen: Vec::new(),
        }
    }

    /// Takes over changed policies for what arrives from now on.
    pub(super) fn set_qos(&mut self, qos: &Qos) {
        self.limits = Limits::new(qos);
        self.is_timed |= is_timed(qos);
        self.lifecycle.set_qos(qos.reader_data_lifecycle);
        match &mut self.rules {
            Some(rules) => rules.set_qos(qos),
            None => self.rules = Rules::new(qos),
        }
        self.deadlines.set_period(qos.deadline.0.to_std());
    }

    /// Puts a change where [`admit`](Self::admit) found room for it.
    pub(super) fn store(&mut self, place: Place, change: Change, events: &mut Events) {
        let instance = match place {
            Place::Instance(instance) => instance,
            Place::NewInstance => self.instances.insert(
                change.instance,
                Instance::new(change.instance, change.reception),
            ),
            Place::Late(instance) => return self.store_late(instance, change, events),
            Place::Withheld(instance) => return self.withhold(instance, change),
            Place::Overlooked(instance) => return self.overlook(instance, &change, events),
            Place::Set | Place::Nowhere => return,
        };
        if self.rules.is_some() {
            self.apply_rules(instance, &change, events);
        }
        let (status, writer, at) = (change.status, change.writer, change.reception);
        if change.valid_data {
            self.store_sample(instance, change);
            events.data_available();
            if !status.is_alive() {
                self.settle(instance, status, writer, at);
            }
            return;
        }
        if self.settle(instance, status, writer, at) {
            self.push_news(instance, change);
            events.data_available();
        }
        self.review(instance);
    }

    /// Adds a sample as the newest of its instance, which is alive then.
    #[inline]
    pub(super) fn store_sample(&mut self, instance: u32, change: Change) {
        self.written(instance, change.writer, change.reception);
        self.make_room(instance);
        self.push(instance, change);
    }

    #[inline]
    fn written(&mut self, place: u32, writer: Guid, now: Instant) {
        let instance = &mut self.instances[place];
        if instance.state != InstanceState::Alive {
            self.lifecycle
                .entered(now, instance.key, InstanceState::Alive);
        }
        instance.written(writer, now);
        if !instance.watched {
            instance.watched = self.deadlines.watch(instance.key, now);
        }
    }

    /// What a change that counts is to the rules.
    fn apply_rules(&mut self, place: u32, change: &Change, events: &mut Events) {
        if change.valid_data || change.status.disposed {
            self.take_withheld(place);
        } else {
            self.give_out(change.reception, place, events);
        }
        let instance = &mut self.instances[place];
        if let Some(rules) = &self.rules {
            rules.note(instance, change);
        }
        if change.valid_data {
            let precedents = instance.precedents.get_or_insert_default();
            precedents.passed = Some(change.reception);
        }
    }

    /// Adds a sample before others of its instance, whose state is not its business.
    fn store_late(&mut self, place: u32, change: Change, events: &mut Events) {
        let instance = &mut self.instances[place];
        instance.register(change.writer);
        instance.updated = change.reception;
        self.make_room(place);
        self.push(place, change);
        events.data_available();
    }

    /// Of a change that does not count it does who writes the instance.
    fn overlook(&mut self, place: u32, change: &Change, events: &mut Events) {
        let status = change.status;
        if change.valid_data || status.disposed {
            self.instances[place].register(change.writer);
        }
        if status.unregistered {
            self.unregister(change.reception, place, change.writer, events);
        }
    }

    /// Applies a dispose, an unregister or both; returns whether the instance's state has changed.
    #[inline]
    fn settle(&mut self, place: u32, status: StatusInfo, writer: Guid, now: Instant) -> bool {
        let instance = &mut self.instances[place];
        let disposed = status.disposed && instance.dispose(writer);
        let orphaned = status.unregistered && instance.unregister(writer);
        if let Some(rules) = &self.rules
            && status.unregistered
        {
            rules.give_up(instance, writer);
        }
        if disposed || orphaned {
            self.lifecycle.entered(now, instance.key, instance.state);
        }
        disposed || orphaned
    }

    /// A writer does not write an instance any more, without a change that says so.
    fn unregister(&mut self, now: Instant, place: u32, writer: Guid, events: &mut Events) {
        if !self.instances[place].writers().contains(&writer) {
            return;
        }
        if self.rules.is_some() {
            self.give_out(now, place, events);
        }
        let news = Change::orphaned(self.instances[place].key, writer, now);
        if self.settle(place, news.status, writer, now) {
            self.push_news(place, news);
            events.data_available();
        }
        self.review(place);
    }

    /// A writer is matched, or offers something else than before.
    pub(super) fn writer_known(&mut self, writer: Guid, ownership: Ownership) {
        if let Some(strengths) = self.strengths() {
            strengths.set(writer, ownership);
        }
    }

    /// A writer is matched no more.
    pub(super) fn writer_unknown(&mut self, now: Instant, writer: Guid, events: &mut Events) {
        self.writer_gone(now, writer, events);
        if let Some(strengths) = self.strengths() {
            strengths.remove(writer);
        }
    }

    /// A writer is gone, or not alive: it writes no instance any more.
    pub(super) fn writer_gone(&mut self, now: Instant, writer: Guid, events: &mut Events) {
        for place in self.instances.places() {
            self.unregister(now, place, writer, events);
        }
    }

    fn strengths(&mut self) -> Option<&mut Strengths> {
        self.rules.as_mut()?.strengths.as_mut()
    }

    /// Does what is due: reports missed deadlines and drops what is worth nothing any more.
    pub(super) fn handle_timeout(&mut self, now: Instant, events: &mut Events) {
        self.check_deadlines(now, events);
        self.drop_expired(now);
        self.purge(now);
        self.give_out_due(now, events);
    }

    /// When [`handle_timeout`](Self::handle_timeout) has something to do.
    #[inline]
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        if !self.is_timed {
            return None;
        }
        [
            self.deadlines.next(),
            self.expiries.next(),
            self.lifecycle.next(),
            self.next_due(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// LIFESPAN (DDS 1.4 section 2.2.3.16): samples that are over go, read or not.
    fn drop_expired(&mut self, now: Instant) {
        while let Some(place) = self.expiries.pop(now) {
            let instance = self.entries.get(place).instance;
            self.remove(place);
            self.review(instance);
        }
    }

    /// Reports instances whose deadline has passed without data.
    fn check_deadlines(&mut self, now: Instant, events: &mut Events) {
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
                if let Some(precedents) = &mut instance.precedents {
                    precedents.owner = None;
                }
                now
            } else {
                instance.updated
            };
            instance.watched = self.deadlines.watch(key, since);
        }
    }

    /// The samples of an instance, oldest first.
    pub(super) fn samples_of(&self, key: KeyHash) -> List {
        self.instances
            .get(key)
            .map_or_else(List::default, |instance| instance.samples)
    }

    /// Removes a sample.
    pub(super) fn remove(&mut self, place: u32) {
        let entry = self.entries.get(place);
        let instance = &mut self.instances[entry.instance];
        if entry.valid_data {
            instance.valid_count -= 1;
            self.valid_count -= 1;
        }
        if !entry.read {
            self.unread_count -= 1;
        }
        if entry.extras.is_some() {
            self.expiries.cancel(place);
        }
        self.entries.remove(&mut instance.samples, place);
        if let Some(walked) = &mut self.walked
            && instance.samples.is_empty()
        {
            walked.remove(&instance.key);
        }
    }

    /// Forgets an instance that is over, and lists one that is idle.
    pub(super) fn review(&mut self, place: u32) {
        let Some(instance) = self.instances.at_mut(place) else {
            return;
        };
        if instance.is_over() {
            let key = instance.key;
            self.forget(key);
        } else if instance.is_idle() && !instance.listed_idle {
            instance.listed_idle = true;
            self.idle.push_back(instance.key);
        }
    }

    pub(super) fn forget(&mut self, key: KeyHash) {
        self.instances.remove(key);
        self.lifecycle.forget(key);
    }

    /// KEEP_LAST: the oldest samples of an instance make room for one more, with the news before them.
    #[inline]
    fn make_room(&mut self, instance: u32) {
        let Some(depth) = self.limits.depth else {
            return;
        };
        while self.instances[instance].valid_count >= depth
            && let Some(oldest) = self.instances[instance].samples.first()
        {
            self.seen(oldest);
            self.remove(oldest);
        }
    }

    /// The application has seen a sample, or will not see it any more.
    pub(super) fn seen(&mut self, place: u32) {
        if let Some(rules) = &self.rules {
            let entry = self.entries.get(place);
            rules.note_seen(&mut self.instances[entry.instance], entry);
        }
    }

    #[inline]
    fn push(&mut self, place: u32, change: Change) {
        let instance = &mut self.instances[place];
        if change.valid_data {
            instance.valid_count += 1;
            self.valid_count += 1;
        }
        self.unread_count += 1;
        if let Some(walked) = &mut self.walked
            && instance.samples.is_empty()
        {
            walked.insert(instance.key);
        }
        let expiry = change.expiry();
        let entry = Entry {
            extras: change.extras,
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
            arrival: 0,
        };
        let place = match self
            .rules
            .as_ref()
            .and_then(|rules| rules.source_order.as_ref())
        {
            None => self.entries.push(&mut instance.samples, entry),
            Some(order) => order.insert(&mut self.entries, &mut instance.samples, entry),
        };
        if let Some(at) = expiry {
            self.expiries.set(place, at);
            self.is_timed = true;
        }
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
