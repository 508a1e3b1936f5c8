//! What the driver knows of a writer or reader beside its protocol state.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::task::Waker;

use rtps_user::RemoteEndpoint;
use rtps_user::filter::PayloadFilter;
use rtps_user::layer::protocol::Endpoint;
use rtps_user::qos::{ContentFilter, Qos};
use rtps_user::wire::Guid;
use rtps_user::writer::BareKey;

use super::audience::{Audience, EntityListener, GroupId, Listener, Masked};
use super::topics::TopicListener;
use crate::status::{
    EntityEvent, InconsistentTopicStatus, StatusEvent, StatusKind, StatusMask, Statuses,
};

/// Status events kept for who asks; older ones give way.
const KEPT_EVENTS: usize = 256;

/// Understands the filter that a remote reader announces, if it can.
pub(crate) type MakeFilter = fn(&ContentFilter) -> Option<PayloadFilter>;

/// What an endpoint is created with.
pub(crate) struct Declaration {
    /// What the layer is told.
    pub(crate) endpoint: Endpoint,
    /// Its publisher or subscriber, if that is not its own.
    pub(crate) group: Option<GroupId>,
    /// What it has from there.
    pub(crate) inherits: Inherits,
    /// Whether the layer is told at once.
    pub(crate) is_enabled: bool,
    /// How a writer understands what remote readers want; without it they are sent everything.
    pub(crate) make_filter: Option<MakeFilter>,
    /// What a writer's keys become for readers that take no DHEADERs in them, where they have some.
    pub(crate) bare_key: Option<BareKey>,
}

/// The policies of a publisher or subscriber that hold for an endpoint, because it says nothing of them itself.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) struct Inherits {
    pub(crate) partition: bool,
    pub(crate) group_data: bool,
}

impl Inherits {
    /// Takes over the policies of the publisher or subscriber.
    pub(crate) fn apply(self, qos: &mut Qos, group: &Qos) {
        if self.partition {
            qos.partition.clone_from(&group.partition);
        }
        if self.group_data {
            qos.group_data.clone_from(&group.group_data);
        }
    }
}

/// See the module.
pub(crate) struct Entity {
    guid: Guid,
    topic: Arc<str>,
    type_name: Arc<str>,
    pub(super) declaration: Declaration,
    /// A reader whose coherent sets wait for their parts in others.
    pub(super) stages_groups: bool,
    matched: HashMap<Guid, Box<RemoteEndpoint>>,
    pub(crate) statuses: Statuses,
    events: VecDeque<StatusEvent>,
    listener: Option<Masked<Listener>>,
    wakers: Vec<Waker>,
}

/// What is to be called once the lock is free.
pub(super) enum Notice {
    Status(Listener, StatusEvent),
    Entity(EntityListener, Box<EntityEvent>),
    Topic(TopicListener, InconsistentTopicStatus),
    Wake(Waker),
    /// An endpoint is gone. What its listener owns may be other endpoints, which take the lock when they go.
    Gone(Box<Entity>),
    /// A listener was replaced: the same.
    Replaced(Listener),
    /// The same.
    ReplacedEntity(EntityListener),
    /// The same.
    ReplacedTopic(TopicListener),
}

impl Notice {
    pub(super) fn deliver(self) {
        match self {
            Self::Status(listener, event) => listener(event),
            Self::Entity(listener, event) => listener(*event),
            Self::Topic(listener, status) => listener(status),
            Self::Wake(waker) => waker.wake(),
            Self::Gone(entity) => drop(entity),
            Self::Replaced(listener) => drop(listener),
            Self::ReplacedEntity(listener) => drop(listener),
            Self::ReplacedTopic(listener) => drop(listener),
        }
    }
}

impl Entity {
    pub(super) fn new(guid: Guid, declaration: Declaration) -> Self {
        Self {
            guid,
            topic: declaration.endpoint.topic.as_str().into(),
            type_name: declaration.endpoint.type_name.as_str().into(),
            declaration,
            stages_groups: false,
            matched: HashMap::new(),
            statuses: Statuses::default(),
            events: VecDeque::new(),
            listener: None,
            wakers: Vec::new(),
        }
    }

    /// The topic's name.
    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    /// What it was created with, and what has changed of that.
    pub(crate) fn declaration(&self) -> &Declaration {
        &self.declaration
    }

    /// Remote endpoints that are matched now.
    pub(crate) fn matched(&self) -> impl ExactSizeIterator<Item = Guid> + '_ {
        self.matched.keys().copied()
    }

    /// What is known of one of them.
    pub(crate) fn matched_endpoint(&self, remote: Guid) -> Option<&RemoteEndpoint> {
        self.matched.get(&remote).map(Box::as_ref)
    }

    /// Events since the last call that no listener was told.
    pub(crate) fn take_events(&mut self) -> Vec<StatusEvent> {
        self.events.drain(..).collect()
    }

    /// Tells `listener` all further events of `mask`; gives those that wait, for it to be told first.
    pub(super) fn set_listener(
        &mut self,
        mask: StatusMask,
        listener: Listener,
        audience: &mut Audience,
    ) -> Vec<StatusEvent> {
        audience.note_mask(mask);
        let replaced = self.listener.replace(Masked { mask, listener });
        let replaced = replaced.map(|masked| Notice::Replaced(masked.listener));
        audience.notices.extend(replaced);
        let (told, kept) = self
            .events
            .drain(..)
            .partition(|event| mask.contains(event.kind()));
        self.events = kept;
        let told: VecDeque<StatusEvent> = told;
        told.iter()
            .for_each(|event| self.statuses.told(event.kind()));
        told.into()
    }

    /// A publisher, subscriber or participant has got a listener: it is told what waits.
    pub(super) fn tell_again(&mut self, audience: &mut Audience) {
        for event in std::mem::take(&mut self.events) {
            self.hand_out(event, audience);
        }
    }

    /// Wakes a task when the next thing happens.
    pub(crate) fn wake_later(&mut self, waker: &Waker) {
        if !self.wakers.iter().any(|known| known.will_wake(waker)) {
            self.wakers.push(waker.clone());
        }
    }

    /// Forgets a task that no longer waits.
    pub(super) fn wake_no_more(&mut self, waker: &Waker) {
        self.wakers.retain(|known| !known.will_wake(waker));
    }

    pub(super) fn wake(&mut self, audience: &mut Audience) {
        let wakers = self.wakers.drain(..);
        audience.notices.extend(wakers.map(Notice::Wake));
        audience.wake();
    }

    /// Samples have come.
    pub(super) fn data_available(&mut self, audience: &mut Audience) {
        self.wake(audience);
        if !audience.hears_data() {
            return;
        }
        let on_readers = StatusEvent::DataOnReaders;
        if !self.tell_above(&on_readers, audience) {
            self.tell(StatusEvent::DataAvailable, audience);
        }
    }

    /// A match, new or changed.
    pub(super) fn add_match(&mut self, remote: Box<RemoteEndpoint>, audience: &mut Audience) {
        let guid = remote.guid;
        if self.matched.insert(guid, remote).is_none() {
            self.report(self.matched_event(guid, 1), audience);
        }
    }

    /// The end of a match.
    pub(super) fn remove_match(&mut self, remote: Guid, audience: &mut Audience) {
        if self.matched.remove(&remote).is_some() {
            self.report(self.matched_event(remote, -1), audience);
        }
    }

    fn matched_event(&self, remote: Guid, change: isize) -> StatusEvent {
        let (current, total) = (0, 0);
        match self.guid.entity.is_writer() {
            true => StatusEvent::PublicationMatched {
                current,
                change,
                total,
                reader: remote,
            },
            false => StatusEvent::SubscriptionMatched {
                current,
                change,
                total,
                writer: remote,
            },
        }
    }

    /// Counts an event and hands it to whom it may concern.
    pub(super) fn report(&mut self, mut event: StatusEvent, audience: &mut Audience) {
        self.wake(audience);
        self.statuses.note(&mut event);
        self.hand_out(event, audience);
    }

    fn hand_out(&mut self, event: StatusEvent, audience: &mut Audience) {
        let kind = event.kind();
        match self.tell(event, audience) {
            None => self.statuses.told(kind),
            Some(event) => {
                if self.events.len() == KEPT_EVENTS {
                    self.events.pop_front();
                }
                self.events.push_back(event);
            }
        }
    }

    /// Tells the nearest listener; gives the event back when nobody listens to it.
    fn tell(&self, event: StatusEvent, audience: &mut Audience) -> Option<StatusEvent> {
        match &self.listener {
            Some(masked) if masked.mask.contains(event.kind()) => {
                let listener = Arc::clone(&masked.listener);
                audience.notices.push(Notice::Status(listener, event));
                None
            }
            _ => (!self.tell_above(&event, audience)).then_some(event),
        }
    }

    /// Tells those above it: of the topic where it is about that, else of the publisher, subscriber or participant.
    fn tell_above(&self, event: &StatusEvent, audience: &mut Audience) -> bool {
        let kind: StatusKind = event.kind();
        if kind == StatusKind::InconsistentTopic && audience.tell_topic(&self.topic) {
            return true;
        }
        audience.tell(self.declaration.group, kind, || EntityEvent {
            entity: self.guid,
            topic: Arc::clone(&self.topic),
            type_name: Arc::clone(&self.type_name),
            event: event.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use rtps_user::wire::{EntityId, EntityKind, GuidPrefix};

    use super::*;

    fn guid(prefix: u8, kind: EntityKind) -> Guid {
        Guid::new(GuidPrefix([prefix; 12]), EntityId::of_app(1, 1, kind))
    }

    fn writer(group: Option<GroupId>) -> Entity {
        let guid = guid(1, EntityKind::WriterNoKey);
        let endpoint = Endpoint {
            entity: guid.entity,
            topic: "Square".to_owned(),
            type_name: "ShapeType".to_owned(),
            type_information: Vec::new(),
            type_objects: Vec::new(),
            content_filter: None,
            qos: Qos::default(),
        };
        let declaration = Declaration {
            endpoint,
            group,
            inherits: Inherits::default(),
            is_enabled: true,
            make_filter: None,
            bare_key: None,
        };
        Entity::new(guid, declaration)
    }

    fn lost() -> StatusEvent {
        StatusEvent::LivelinessLost { total: 0 }
    }

    #[test]
    fn a_match_counts_once() {
        let (mut entity, mut audience) = (writer(None), Audience::default());
        let remote = Box::new(RemoteEndpoint {
            guid: guid(7, EntityKind::ReaderNoKey),
            unicast: Vec::new(),
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            takes_bare_keys: false,
            qos: Qos::default(),
            topic: "Square".to_owned(),
            type_name: "ShapeType".to_owned(),
            type_information: Vec::new(),
            content_filter: None,
        });
        let guid = remote.guid;
        entity.add_match(remote.clone(), &mut audience);
        entity.add_match(remote, &mut audience);
        assert_eq!(
            entity.matched_endpoint(guid).map(|remote| remote.guid),
            Some(guid)
        );
        entity.remove_match(guid, &mut audience);
        entity.remove_match(guid, &mut audience);
        let changes: Vec<_> = entity
            .take_events()
            .into_iter()
            .map(|event| match event {
                StatusEvent::PublicationMatched {
                    current,
                    change,
                    total,
                    ..
                } => (current, change, total),
                other => panic!("unexpected {other:?}"),
            })
            .collect();
        assert_eq!(changes, [(1, 1, 1), (0, -1, 1)]);
        assert!(audience.notices.is_empty());
    }

    #[test]
    fn events_that_nobody_takes_are_bounded() {
        let (mut entity, mut audience) = (writer(None), Audience::default());
        for _ in 0..3 * KEPT_EVENTS {
            entity.report(lost(), &mut audience);
        }
        assert_eq!(entity.take_events().len(), KEPT_EVENTS);
    }

    #[test]
    fn the_nearest_listener_that_wants_an_event_is_told() {
        let mut audience = Audience::default();
        let group = audience.add_group();
        let mut entity = writer(Some(group));
        let told = Arc::new(Mutex::new(Vec::new()));
        let note = |name: &'static str| {
            let told = Arc::clone(&told);
            move || told.lock().unwrap().push(name)
        };
        let deliver = |entity: &mut Entity, audience: &mut Audience| {
            entity.report(lost(), audience);
            audience.notices.drain(..).for_each(Notice::deliver);
            std::mem::take(&mut *told.lock().unwrap())
        };
        assert!(deliver(&mut entity, &mut audience).is_empty());
        let participant = note("participant");
        audience.set_listener(None, StatusMask::ALL, Arc::new(move |_| participant()));
        entity.tell_again(&mut audience);
        assert!(
            !entity
                .statuses
                .changed()
                .contains(StatusKind::LivelinessLost)
        );
        // The one that waited, and a new one.
        assert_eq!(deliver(&mut entity, &mut audience), ["participant"; 2]);
        let publisher = note("publisher");
        let mask = StatusKind::LivelinessLost.into();
        audience.set_listener(Some(group), mask, Arc::new(move |_| publisher()));
        assert_eq!(deliver(&mut entity, &mut audience), ["publisher"]);
        let own = note("own");
        let mask = StatusKind::PublicationMatched.into();
        entity.set_listener(mask, Arc::new(move |_| own()), &mut audience);
        assert_eq!(deliver(&mut entity, &mut audience), ["publisher"]);
        let own = note("own");
        entity.set_listener(StatusMask::ALL, Arc::new(move |_| own()), &mut audience);
        assert_eq!(deliver(&mut entity, &mut audience), ["own"]);
    }
}
