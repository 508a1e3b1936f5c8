//! Readers of the built-in topics (DDS 1.4 section 2.2.5): what is known of the domain, as samples.
//!
//! They keep the newest sample of each instance, and find out what has changed when they are looked into. What came and
//! went in between is not seen.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rtps_user::reader::{InstanceState, SampleInfo, SampleState, Selection, ViewState};
use rtps_user::wire::{EntityId, Guid, KeyHash, SequenceNumber};

use super::access::Form;
use super::builtin::topics_of;
use super::{
    EndpointBuiltinTopicData, ParticipantBuiltinTopicData, ReadCondition, Sample,
    TopicBuiltinTopicData,
};
use crate::driver::{Browser, Core, Scope};
use crate::socket::{RtpsSocket, Trigger, Watched};

/// Finds every instance of a topic, with its value where that has changed since `seen`, or may have.
pub(super) type Look<D> = fn(core: &Core, seen: u64) -> Vec<(KeyHash, Option<D>)>;

/// A reader of a built-in topic.
///
/// A participant, topic or endpoint that has gone is an instance that is NOT_ALIVE_DISPOSED; its last sample has no data but
/// a `key`, which is all that was known, and stays until it is taken. Samples do not name their writer.
pub struct BuiltinReader<D> {
    socket: RtpsSocket,
    look: Look<D>,
    instances: Arc<Mutex<Instances<D>>>,
}

/// What a reader has.
struct Instances<D> {
    /// The changes that it knows.
    seen: u64,
    known: BTreeMap<KeyHash, Instance<D>>,
}

struct Instance<D> {
    data: D,
    /// The changes up to which it was there.
    seen: u64,
    info: SampleInfo,
    /// Whether its newest sample was taken.
    is_taken: bool,
}

impl<D: Clone + PartialEq + Send + 'static> BuiltinReader<D> {
    pub(super) fn new(socket: RtpsSocket, look: Look<D>) -> Self {
        let instances = Instances {
            seen: 0,
            known: BTreeMap::new(),
        };
        Self {
            socket,
            look,
            instances: Arc::new(Mutex::new(instances)),
        }
    }

    /// Takes up to `max` samples of a selection, without waiting.
    pub fn take(&self, max: usize, selection: &Selection) -> Vec<Sample<D>> {
        self.access(max, selection, Form::Take)
    }

    /// Reads up to `max` samples of a selection, which stay and count as read then.
    pub fn read(&self, max: usize, selection: &Selection) -> Vec<Sample<D>> {
        self.access(max, selection, Form::Read)
    }

    /// Waits until there is a sample that has not been read; false when `timeout` passes before.
    pub fn wait(&self, timeout: Duration) -> bool {
        let selection = Selection::not_read();
        let found = self.socket.shared().wait_until(timeout, |core, now| {
            let mut instances = lock(&self.instances);
            instances.refresh(core, self.look, now);
            instances.has(&selection).then_some(())
        });
        found.is_some()
    }

    /// A condition that is true while there are samples of a selection.
    pub fn read_condition(&self, selection: Selection) -> ReadCondition {
        let (instances, look) = (Arc::clone(&self.instances), self.look);
        let is_true = move |core: &Core| {
            let mut instances = lock(&instances);
            instances.refresh(core, look, Instant::now());
            instances.has(&selection)
        };
        let trigger = Trigger::Holds(Box::new(is_true));
        let watched = Watched::new(self.socket.shared(), Scope::Participant, trigger);
        ReadCondition::new(watched, selection)
    }

    fn access(&self, max: usize, selection: &Selection, form: Form) -> Vec<Sample<D>> {
        self.socket.shared().poll(|core, now| {
            let mut instances = lock(&self.instances);
            instances.refresh(core, self.look, now);
            instances.hand_out(max, selection, form)
        })
    }
}

impl<D: Clone + PartialEq> Instances<D> {
    /// Takes in what has changed.
    fn refresh(&mut self, core: &Core, look: Look<D>, now: Instant) {
        let browser = core.browser().filter(|browser| browser.is_complete());
        let Some(changes) = browser.map(Browser::changes) else {
            return;
        };
        if changes == self.seen {
            return;
        }
        for (key, data) in look(core, self.seen) {
            self.take_in(key, data, changes, now);
        }
        for instance in self.known.values_mut() {
            if instance.seen != changes && instance.info.instance_state == InstanceState::Alive {
                instance.end(changes, now);
            }
        }
        self.seen = changes;
    }

    fn take_in(&mut self, key: KeyHash, data: Option<D>, changes: u64, now: Instant) {
        match (self.known.get_mut(&key), data) {
            (Some(instance), data) => {
                instance.seen = changes;
                let was_alive = instance.info.instance_state == InstanceState::Alive;
                if let Some(data) = data
                    && !(was_alive && instance.data == data)
                {
                    instance.update(data, changes, now);
                }
            }
            (None, Some(data)) => {
                let instance = Instance::new(key, data, changes, now);
                self.known.insert(key, instance);
            }
            (None, None) => {}
        }
    }

    fn has(&self, selection: &Selection) -> bool {
        let mut known = self.known.values();
        known.any(|instance| instance.is_selected(selection))
    }

    fn hand_out(&mut self, max: usize, selection: &Selection, form: Form) -> Vec<Sample<D>> {
        let known = self.known.values_mut();
        let selected = known.filter(|instance| instance.is_selected(selection));
        let samples = selected
            .take(max)
            .map(|instance| instance.hand_out(form))
            .collect();
        self.known.retain(|_, instance| {
            !instance.is_taken || instance.info.instance_state == InstanceState::Alive
        });
        samples
    }
}

impl<D: Clone> Instance<D> {
    fn new(key: KeyHash, data: D, changes: u64, now: Instant) -> Self {
        let info = SampleInfo {
            valid_data: true,
            instance: key,
            writer: Guid::UNKNOWN,
            sequence: SequenceNumber::ZERO,
            group_sequence: None,
            source_timestamp: None,
            reception: now,
            sample_state: SampleState::NotRead,
            view_state: ViewState::New,
            instance_state: InstanceState::Alive,
            disposed_generation_count: 0,
            no_writers_generation_count: 0,
            sample_rank: 0,
            generation_rank: 0,
            absolute_generation_rank: 0,
        };
        let mut instance = Self {
            data,
            seen: changes,
            info,
            is_taken: false,
        };
        instance.note(changes, now);
        instance
    }

    /// It has another value, or is back.
    fn update(&mut self, data: D, changes: u64, now: Instant) {
        self.data = data;
        self.info.valid_data = true;
        if self.info.instance_state != InstanceState::Alive {
            self.info.instance_state = InstanceState::Alive;
            self.info.view_state = ViewState::New;
            self.info.disposed_generation_count += 1;
        }
        self.note(changes, now);
    }

    /// It is gone.
    fn end(&mut self, changes: u64, now: Instant) {
        self.info.valid_data = false;
        self.info.instance_state = InstanceState::NotAliveDisposed;
        self.note(changes, now);
    }

    /// There is a new sample.
    fn note(&mut self, changes: u64, now: Instant) {
        self.info.sequence = SequenceNumber(changes.cast_signed());
        self.info.reception = now;
        self.info.sample_state = SampleState::NotRead;
        self.is_taken = false;
    }

    fn is_selected(&self, selection: &Selection) -> bool {
        let info = &self.info;
        !self.is_taken
            && selection.sample_states.contains(info.sample_state)
            && selection.view_states.contains(info.view_state)
            && selection.instance_states.contains(info.instance_state)
            && selection.instance.is_none_or(|key| key == info.instance)
    }

    fn hand_out(&mut self, form: Form) -> Sample<D> {
        let info = self.info;
        self.is_taken = form == Form::Take;
        self.info.sample_state = SampleState::Read;
        self.info.view_state = ViewState::NotNew;
        let (data, key) = match info.valid_data {
            true => (Some(self.data.clone()), None),
            false => (None, Some(self.data.clone())),
        };
        Sample { data, key, info }
    }
}

pub(super) fn participants(
    core: &Core,
    seen: u64,
) -> Vec<(KeyHash, Option<ParticipantBuiltinTopicData>)> {
    let known = core.known_participants();
    let known = known.map(|(changed, participant)| {
        let guid = Guid::new(participant.prefix, EntityId::PARTICIPANT);
        (handle(guid), (changed > seen).then(|| participant.into()))
    });
    known.collect()
}

pub(super) fn topics(core: &Core, _seen: u64) -> Vec<(KeyHash, Option<TopicBuiltinTopicData>)> {
    let topics = topics_of(core).into_iter();
    let topics = topics.map(|topic| (topic.handle(), Some(topic)));
    topics.collect()
}

pub(super) fn publications(
    core: &Core,
    seen: u64,
) -> Vec<(KeyHash, Option<EndpointBuiltinTopicData>)> {
    endpoints(core, seen, EntityId::is_writer)
}

pub(super) fn subscriptions(
    core: &Core,
    seen: u64,
) -> Vec<(KeyHash, Option<EndpointBuiltinTopicData>)> {
    endpoints(core, seen, EntityId::is_reader)
}

fn endpoints(
    core: &Core,
    seen: u64,
    is_wanted: fn(EntityId) -> bool,
) -> Vec<(KeyHash, Option<EndpointBuiltinTopicData>)> {
    let known = core.known_endpoints();
    let known = known.filter(|(_, endpoint)| is_wanted(endpoint.guid.entity));
    let known = known.map(|(changed, endpoint)| {
        let data = (changed > seen).then(|| endpoint.into());
        (handle(endpoint.guid), data)
    });
    known.collect()
}

/// Of what has a GUID.
fn handle(guid: Guid) -> KeyHash {
    KeyHash(guid.to_bytes())
}

fn lock<D>(instances: &Mutex<Instances<D>>) -> MutexGuard<'_, Instances<D>> {
    instances.lock().unwrap_or_else(PoisonError::into_inner)
}
