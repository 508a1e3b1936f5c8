//! Everything of a participant that is under its lock: endpoints, link, and who waits for what.

use std::collections::HashMap;
use std::sync::Arc;
use std::task::Waker;
use std::time::{Duration, Instant, SystemTime};

use rtps_user::OwnKeys;
use rtps_user::endpoints::{EndpointEvent, Endpoints};
use rtps_user::layer::protocol::{Endpoint, FromLayer, ToLayer};
use rtps_user::qos::PolicyId;
use rtps_user::wire::{EntityId, EntityKind, Guid};

use super::batching::{Batching, Patience};
use super::entity::{Entity, Listener, Notice};
use super::outgoing::Outgoing;
use super::seat::{Holder, SLACK, Seat, Sleep, WRITING};
use super::wall_clock::WallClock;
use crate::link::{Arrivals, Burst, Identity, LayerKind, Link};
use crate::status::StatusEvent;
use crate::sys::Wakeups;

/// See the module.
pub(crate) struct Core {
    /// Writers and readers.
    pub(crate) endpoints: Endpoints,
    link: Box<dyn Link>,
    entities: HashMap<EntityId, Entity, OwnKeys>,
    pub(super) seat: Seat,
    identity: Identity,
    next_serial: u16,
    outgoing: Outgoing,
    notices: Vec<Notice>,
    pub(super) batching: Batching,
    wall_clock: WallClock,
    is_lost: bool,
}

impl Core {
    pub(super) fn new(link: Box<dyn Link>) -> Self {
        let identity = link.identity();
        Self {
            endpoints: Endpoints::new(identity.prefix),
            link,
            entities: HashMap::default(),
            seat: Seat::default(),
            identity,
            next_serial: 1,
            outgoing: Outgoing::new(),
            notices: Vec::new(),
            batching: Batching::default(),
            wall_clock: WallClock::default(),
            is_lost: false,
        }
    }

    /// Which layer the participant uses.
    pub(crate) fn layer(&self) -> LayerKind {
        self.link.kind()
    }

    /// Whether the participant is no longer part of the domain, because its layer was set up anew.
    pub(crate) fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// The most bytes of a datagram.
    pub(crate) fn datagram_size(&self) -> usize {
        self.identity.datagram_size.into()
    }

    /// A name for a new endpoint; `None` when the app has 65,535 of them.
    pub(crate) fn new_guid(&mut self, kind: EntityKind) -> Option<Guid> {
        for _ in 0..u16::MAX {
            let entity = EntityId::of_app(self.identity.slot, self.next_serial, kind);
            self.next_serial = self.next_serial.checked_add(1).unwrap_or(1);
            if !self.entities.contains_key(&entity) {
                return Some(Guid::new(self.identity.prefix, entity));
            }
        }
        None
    }

    /// Makes an endpoint, which the caller has added to `endpoints`, known to the layer.
    pub(crate) fn declare(&mut self, now: Instant, endpoint: Endpoint) {
        let id = endpoint.entity;
        self.entities.insert(id, Entity::new(id, &endpoint.topic));
        self.link.request(now, ToLayer::Declare(Box::new(endpoint)));
    }

    /// Removes an endpoint, which has sent everything by then.
    pub(crate) fn withdraw(&mut self, now: Instant, id: EntityId) {
        if let Some(writer) = self.endpoints.writer_mut(id) {
            writer.hurry();
        }
        self.transmit(now);
        self.endpoints.remove(id);
        self.link.request(now, ToLayer::Withdraw(id));
        if let Some(mut entity) = self.entities.remove(&id) {
            entity.wake(&mut self.notices);
            self.notices.push(Notice::Gone(Box::new(entity)));
        }
    }

    /// Calls `listener` with all further events of an endpoint; returns those that wait.
    pub(crate) fn set_listener(&mut self, id: EntityId, listener: Listener) -> Vec<StatusEvent> {
        let entity = self.entities.get_mut(&id);
        entity.map_or_else(Vec::new, |entity| {
            entity.set_listener(listener, &mut self.notices)
        })
    }

    /// Has others see USER_DATA of the participant.
    pub(crate) fn describe(&mut self, now: Instant, user_data: Vec<u8>) {
        self.link.request(now, ToLayer::Describe(user_data));
    }

    /// Asserts the liveliness of all writers that want the app to do so.
    pub(crate) fn assert_liveliness(&mut self, now: Instant) {
        self.link.request(now, ToLayer::AssertLiveliness);
    }

    /// An endpoint that has been declared.
    pub(crate) fn entity(&self, id: EntityId) -> Option<&Entity> {
        self.entities.get(&id)
    }

    /// An endpoint that has been declared.
    pub(crate) fn entity_mut(&mut self, id: EntityId) -> Option<&mut Entity> {
        self.entities.get_mut(&id)
    }

    /// Wakes a task when something happens to an entity, which somebody has to notice.
    pub(crate) fn wake_later(&mut self, id: EntityId, waker: &Waker) {
        if let Some(entity) = self.entities.get_mut(&id) {
            entity.wake_later(waker);
            self.seat.is_wanted = !self.seat.is_external && self.seat.holder == Holder::Nobody;
        }
    }

    /// Reports what the typed API finds out.
    pub(crate) fn report(&mut self, id: EntityId, event: StatusEvent) {
        if let Some(entity) = self.entities.get_mut(&id) {
            entity.report(event, &mut self.notices);
        }
    }

    /// The time of day.
    pub(crate) fn wall_time(&mut self, now: Instant) -> SystemTime {
        self.wall_clock.at(now)
    }

    /// The app has written `len` bytes: timers will be short for a while. Whether they wait for more.
    pub(super) fn note_write(&mut self, now: Instant, len: usize, patience: Patience) -> bool {
        self.batching.holds(now, len, patience)
    }

    /// Takes in what has arrived and follows up on it; gives the number of datagrams.
    pub(crate) fn receive(&mut self, now: Instant, wakeups: Wakeups) -> usize {
        let mut count = 0;
        let endpoints = &mut self.endpoints;
        self.link.receive(now, wakeups, &mut |source, datagram| {
            count += 1;
            if let Err(error) = endpoints.handle_datagram(now, source, datagram) {
                tracing::debug!(%source, len = datagram.len(), %error, "malformed datagram");
            }
        });
        self.settle(now);
        count
    }

    /// Where what has arrived can be seen.
    pub(super) fn arrivals(&self) -> Option<Arc<dyn Arrivals>> {
        self.link.arrivals()
    }

    /// Does what is due, sends what is to be sent, and notes what has happened. Most of the time there is nothing.
    pub(crate) fn settle(&mut self, now: Instant) {
        if self.link.has_news(now) {
            self.settle_link(now);
        }
        if self.batching.due().is_some() || !self.endpoints.is_settled(now) {
            self.settle_endpoints(now);
        }
    }

    fn settle_link(&mut self, now: Instant) {
        if self.link.poll_timeout().is_some_and(|due| due <= now) {
            self.link.handle_timeout(now);
        }
        while let Some(message) = self.link.poll_message() {
            self.handle_message(now, message);
        }
        if self.link.is_lost() && !self.is_lost {
            self.lose_layer(now);
        }
    }

    fn settle_endpoints(&mut self, now: Instant) {
        let is_holding = self.batching.is_holding(now);
        if !is_holding {
            self.transmit(now);
        }
        if self.endpoints.poll_timeout().is_some_and(|due| due <= now) {
            self.endpoints.handle_timeout(now);
            if !is_holding {
                self.transmit(now);
            }
        }
        while let Some(event) = self.endpoints.poll_event() {
            self.handle_event(event);
        }
    }

    /// Sends what there is to send.
    fn transmit(&mut self, now: Instant) {
        loop {
            let buffer = self.outgoing.buffer();
            let start = buffer.len();
            let Some(transmit) = self.endpoints.poll_transmit(now, buffer) else {
                break;
            };
            let send = |burst: &Burst<'_>| self.link.send(burst);
            self.outgoing.appended(start, transmit, send);
        }
        self.outgoing.flush(|burst| self.link.send(burst));
        self.batching.sent();
    }

    /// When something is due.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let timeouts = [
            self.endpoints.poll_timeout(),
            self.link.poll_timeout(),
            self.batching.due(),
        ];
        timeouts.into_iter().flatten().min()
    }

    /// Gets ready for a sleep until something arrives or is due, or until `deadline`. `None`: something has arrived.
    pub(super) fn prepare_sleep(
        &mut self,
        now: Instant,
        deadline: Option<Instant>,
    ) -> Option<Option<Duration>> {
        if !self.link.prepare_sleep() {
            return None;
        }
        let last_write = self.batching.last_write();
        let is_writing = last_write.is_some_and(|write| now < write + WRITING);
        let look_again = is_writing.then(|| now + SLACK);
        let end = [self.poll_timeout(), deadline, look_again]
            .into_iter()
            .flatten()
            .min();
        self.seat.sleeps_until = Some(end.map_or(Sleep::Open, Sleep::Until));
        Some(end.map(|end| end.saturating_duration_since(now)))
    }

    /// Gets ready for the short sleep after which what is held back is to be sent: until then whoever writes takes in
    /// what arrives, and need not be helped. `None`: nothing is held back.
    pub(super) fn prepare_nap(&mut self, now: Instant) -> Option<Option<Duration>> {
        self.batching.due()?;
        let end = self.poll_timeout()?;
        self.seat.sleeps_until = Some(Sleep::Until(end));
        self.seat.naps = true;
        Some(Some(end.saturating_duration_since(now)))
    }

    /// The sleep is over.
    pub(super) fn awake(&mut self) {
        self.seat.sleeps_until = None;
        self.seat.naps = false;
        self.link.awake();
    }

    /// Leaves the domain.
    pub(super) fn shutdown(&mut self, now: Instant) {
        self.transmit(now);
        self.link.shutdown(now);
    }

    pub(super) fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    fn handle_message(&mut self, now: Instant, message: FromLayer) {
        match message {
            FromLayer::Matched { local, remote } => {
                self.endpoints.match_remote(now, local, &remote);
                self.on_entity(local, |entity, notices| {
                    entity.add_match(remote.guid, notices)
                });
            }
            FromLayer::Unmatched { local, remote } => {
                self.endpoints.unmatch(now, local, remote);
                self.on_entity(local, |entity, notices| {
                    entity.remove_match(remote, notices)
                });
            }
            FromLayer::IncompatibleQos {
                local,
                remote,
                policy,
            } => {
                self.report_incompatible(local, remote, policy);
            }
            FromLayer::InconsistentTopic { local, remote } => {
                self.report_inconsistent(local, remote)
            }
            FromLayer::Liveliness {
                participant,
                manual,
            } => {
                self.endpoints.handle_liveliness(now, participant, manual);
            }
            FromLayer::Refused { reason } => {
                tracing::error!("the layer refuses: {reason}");
                self.report_all(&StatusEvent::Refused { reason });
            }
            // These are for the link.
            FromLayer::Welcome(_)
            | FromLayer::FanOut { .. }
            | FromLayer::Channel { .. }
            | FromLayer::ChannelClosed { .. } => {}
        }
    }

    /// Ends all matches, which nobody would end any more, and says so.
    fn lose_layer(&mut self, now: Instant) {
        self.is_lost = true;
        for (id, entity) in &mut self.entities {
            let matched: Vec<_> = entity.matched().iter().copied().collect();
            for remote in matched {
                self.endpoints.unmatch(now, *id, remote);
                entity.remove_match(remote, &mut self.notices);
            }
        }
        self.report_all(&StatusEvent::LayerLost);
    }

    /// Reports what concerns the participant to all its endpoints.
    fn report_all(&mut self, event: &StatusEvent) {
        self.seat.news = true;
        for entity in self.entities.values_mut() {
            entity.report(event.clone(), &mut self.notices);
        }
    }

    fn handle_event(&mut self, event: EndpointEvent) {
        let (id, event) = match event {
            EndpointEvent::DataAvailable(id) => {
                self.batching.expect_answer();
                return self.on_entity(id, |entity, notices| entity.wake(notices));
            }
            EndpointEvent::Acknowledged(id) => {
                return self.on_entity(id, |entity, notices| entity.wake(notices));
            }
            EndpointEvent::LivelinessLost(writer) => (writer, StatusEvent::LivelinessLost),
            EndpointEvent::SampleLost {
                reader,
                writer,
                count,
            } => (reader, StatusEvent::SampleLost { count, writer }),
            EndpointEvent::SampleRejected {
                reader,
                writer,
                instance,
                reason,
            } => (
                reader,
                StatusEvent::SampleRejected {
                    reason,
                    instance,
                    writer,
                },
            ),
            EndpointEvent::DeadlineMissed { reader, instance } => {
                (reader, StatusEvent::DeadlineMissed { instance })
            }
            EndpointEvent::LivelinessChanged {
                reader,
                writer,
                alive_count,
                alive_change,
                not_alive_count,
                not_alive_change,
            } => (
                reader,
                StatusEvent::LivelinessChanged {
                    alive: alive_count,
                    alive_change,
                    not_alive: not_alive_count,
                    not_alive_change,
                    writer,
                },
            ),
        };
        self.on_entity(id, |entity, notices| entity.report(event, notices));
    }

    fn report_incompatible(&mut self, local: EntityId, remote: Guid, policy: PolicyId) {
        let is_writer = local.is_writer();
        self.on_entity(local, |entity, notices| {
            let topic = &entity.topic;
            let event = if is_writer {
                tracing::warn!(
                    "writer of {topic:?} does not match reader {remote}: it requests more than is offered, {policy:?}"
                );
                StatusEvent::OfferedIncompatibleQos { policy, reader: remote }
            } else {
                tracing::warn!(
                    "reader of {topic:?} does not match writer {remote}: it offers less than is requested, {policy:?}"
                );
                StatusEvent::RequestedIncompatibleQos { policy, writer: remote }
            };
            entity.report(event, notices);
        });
    }

    fn report_inconsistent(&mut self, local: EntityId, remote: Guid) {
        self.on_entity(local, |entity, notices| {
            let topic = &entity.topic;
            tracing::warn!("topic {topic:?} has another type at {remote}: the two do not match");
            entity.report(StatusEvent::InconsistentTopic { remote }, notices);
        });
    }

    /// Whatever happens to an entity, somebody may wait for it.
    fn on_entity(&mut self, id: EntityId, act: impl FnOnce(&mut Entity, &mut Vec<Notice>)) {
        self.seat.news = true;
        if let Some(entity) = self.entities.get_mut(&id) {
            act(entity, &mut self.notices);
        }
    }
}
