//! Everything of a participant that is under its lock: endpoints, link, and who waits for what.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use rtps_user::OwnKeys;
use rtps_user::endpoints::Endpoints;
use rtps_user::layer::protocol::{Discovered, ToLayer};
use rtps_user::qos::{ContentFilter, Qos};
use rtps_user::reader::Reader;
use rtps_user::wire::{EntityId, EntityKind, Guid};
use rtps_user::writer::FRAGMENT_OVERHEAD;

use super::audience::{Audience, EntityListener, GroupId, Listener};
use super::batching::{Batching, Patience};
use super::browser::Browser;
use super::entity::{Declaration, Entity, Notice};
use super::ignored::Ignored;
use super::outgoing::Outgoing;
use super::seat::{SLACK, Seat, Sleep, WRITING};
use super::wall_clock::WallClock;
use crate::link::{Arrivals, Burst, Identity, LayerKind, Link};
use crate::status::{StatusEvent, StatusMask};
use crate::sys::Wakeups;

/// See the module.
pub(crate) struct Core {
    /// Writers and readers.
    pub(crate) endpoints: Endpoints,
    link: Box<dyn Link>,
    pub(super) entities: HashMap<EntityId, Entity, OwnKeys>,
    pub(super) seat: Seat,
    identity: Identity,
    next_serial: u16,
    outgoing: Outgoing,
    /// When it was last looked for what has arrived.
    received: Option<Instant>,
    /// Publishers and subscribers, and who listens.
    pub(crate) audience: Audience,
    pub(super) batching: Batching,
    wall_clock: WallClock,
    /// Whether any reader has coherent sets that wait for their parts in others.
    pub(super) stages_groups: bool,
    /// What is known of the domain, where the app wants to know.
    pub(super) browser: Option<Box<Browser>>,
    pub(super) ignored: Ignored,
    pub(super) is_lost: bool,
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
            received: None,
            audience: Audience::default(),
            batching: Batching::default(),
            wall_clock: WallClock::default(),
            stages_groups: false,
            browser: None,
            ignored: Ignored::default(),
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

    /// Whether an endpoint is one of this app; other apps of the host are of the same participant.
    pub(crate) fn is_own(&self, guid: Guid) -> bool {
        guid.prefix == self.identity.prefix && guid.entity.slot() == self.identity.slot
    }

    /// The most bytes of a datagram.
    pub(crate) fn datagram_size(&self) -> usize {
        self.identity.datagram_size.into()
    }

    /// Has samples sent in fragments of no more than `size` bytes, by writers that are created from now on.
    pub(crate) fn limit_fragments(&mut self, size: u16) {
        let datagram =
            u16::try_from(FRAGMENT_OVERHEAD).map_or(size, |more| size.saturating_add(more));
        self.identity.datagram_size = self.identity.datagram_size.min(datagram);
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

    /// Makes an endpoint, which the caller has added to `endpoints`, known to the layer, at once or when it is enabled.
    pub(crate) fn declare(&mut self, now: Instant, declaration: Declaration) {
        let id = declaration.endpoint.entity;
        self.audience.join(declaration.group, id);
        if declaration.is_enabled {
            let endpoint = Box::new(declaration.endpoint.clone());
            self.link.request(now, ToLayer::Declare(endpoint));
        }
        let guid = Guid::new(self.identity.prefix, id);
        self.entities.insert(id, Entity::new(guid, declaration));
    }

    /// Makes an endpoint known that is not yet.
    pub(crate) fn enable(&mut self, now: Instant, id: EntityId) {
        if let Some(entity) = self.entities.get_mut(&id)
            && !std::mem::replace(&mut entity.declaration.is_enabled, true)
        {
            let endpoint = Box::new(entity.declaration.endpoint.clone());
            self.link.request(now, ToLayer::Declare(endpoint));
        }
    }

    /// Changes the policies of an endpoint.
    pub(crate) fn change_qos(&mut self, now: Instant, id: EntityId, qos: Qos) {
        let Some(entity) = self.entities.get_mut(&id) else {
            return;
        };
        let declaration = &mut entity.declaration;
        declaration.endpoint.qos.clone_from(&qos);
        if let Some(writer) = self.endpoints.writer_mut(id) {
            writer.set_qos(qos);
        } else if let Some(reader) = self.endpoints.reader_mut(id) {
            reader.set_qos(qos);
        }
        self.declare_again(now, id);
    }

    /// Announces another content filter of a reader.
    pub(crate) fn change_filter(&mut self, now: Instant, id: EntityId, filter: ContentFilter) {
        let Some(entity) = self.entities.get_mut(&id) else {
            return;
        };
        let announced = &mut entity.declaration.endpoint.content_filter;
        if announced.replace(filter.clone()) != Some(filter) {
            self.declare_again(now, id);
        }
    }

    /// Tells the layer what has changed of an endpoint.
    fn declare_again(&mut self, now: Instant, id: EntityId) {
        if let Some(entity) = self.entities.get(&id)
            && entity.declaration.is_enabled
        {
            let endpoint = Box::new(entity.declaration.endpoint.clone());
            self.link.request(now, ToLayer::Declare(endpoint));
        }
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
            self.audience.leave(entity.declaration.group, id);
            entity.wake(&mut self.audience);
            self.audience.notices.push(Notice::Gone(Box::new(entity)));
        }
    }

    /// Calls `listener` with all further events of an endpoint that `mask` holds; returns those that wait.
    pub(crate) fn set_listener(
        &mut self,
        id: EntityId,
        mask: StatusMask,
        listener: Listener,
    ) -> Vec<StatusEvent> {
        let entity = self.entities.get_mut(&id);
        entity.map_or_else(Vec::new, |entity| {
            entity.set_listener(mask, listener, &mut self.audience)
        })
    }

    /// Calls `listener` with the events that `mask` holds of the endpoints of a publisher or subscriber, or of all
    /// where there is no `group`, that have no listener for them; also with those that wait.
    pub(crate) fn set_entity_listener(
        &mut self,
        group: Option<GroupId>,
        mask: StatusMask,
        listener: EntityListener,
    ) {
        self.audience.set_listener(group, mask, listener);
        for entity in self.entities.values_mut() {
            entity.tell_again(&mut self.audience);
        }
    }

    /// Asks the layer what there is in the domain, and to be told of changes; once is enough.
    pub(crate) fn browse(&mut self, now: Instant) {
        if self.browser.is_none() {
            self.browser = Some(Box::default());
            self.link.request(now, ToLayer::Browse { after: None });
        }
    }

    /// What there is in the domain, after the app has asked for it.
    pub(crate) fn browser(&self) -> Option<&Browser> {
        self.browser.as_deref()
    }

    /// Takes what the layer tells of the domain.
    pub(super) fn handle_discovered(&mut self, now: Instant, news: Discovered) {
        self.seat.news = true;
        self.audience.wake();
        if let Some(last) = self.browser.as_mut().and_then(|browser| browser.take(news)) {
            self.link
                .request(now, ToLayer::Browse { after: Some(last) });
        }
    }

    /// Has others see USER_DATA of the participant.
    pub(crate) fn describe(&mut self, now: Instant, user_data: Vec<u8>) {
        self.link.request(now, ToLayer::Describe(user_data));
    }

    /// Asserts the liveliness of all writers that want the app to do so.
    pub(crate) fn assert_liveliness(&mut self, now: Instant) {
        self.endpoints.assert_liveliness(now);
        self.tell_assertion(now);
    }

    /// Has readers of others learn that the writers are alive.
    pub(super) fn tell_assertion(&mut self, now: Instant) {
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

    /// Reports what the typed API finds out.
    pub(crate) fn report(&mut self, id: EntityId, event: StatusEvent) {
        if let Some(entity) = self.entities.get_mut(&id) {
            entity.report(event, &mut self.audience);
        }
    }

    /// The time of day.
    pub(crate) fn wall_time(&mut self, now: Instant) -> SystemTime {
        self.wall_clock.at(now)
    }

    /// The app has written `len` bytes: timers will be short for a while. Whether they wait for more.
    pub(super) fn note_write(&mut self, now: Instant, len: usize, patience: Patience) -> bool {
        self.seat.inflow.interrupt();
        self.batching.holds(now, len, patience)
    }

    /// The app has written after it had to wait: where it did nothing but write before, it still does.
    pub(crate) fn resume_stream(&mut self, now: Instant) {
        self.batching.wrote(|| now);
    }

    /// Takes in what has arrived and follows up on it; gives the number of datagrams.
    pub(crate) fn receive(&mut self, now: Instant, wakeups: Wakeups) -> usize {
        self.received = Some(now);
        let mut count = 0;
        let endpoints = &mut self.endpoints;
        self.link.receive(now, wakeups, &mut |source, datagram| {
            count += 1;
            if let Err(error) = endpoints.handle_datagram(now, source, datagram) {
                tracing::debug!(%source, len = datagram.len(), %error, "malformed datagram");
            }
        });
        if count > 0 {
            self.seat.inflow.arrived(now, count);
        }
        self.settle(now);
        count
    }

    /// Takes in what costs no system call.
    pub(super) fn take_in(&mut self, now: Instant) {
        self.receive(now, Wakeups::default());
    }

    /// Whether a reader has so many samples for the app that more had better stay where they are for a moment: that costs
    /// no memory, and slows the writer down where the app is the slowest.
    pub(super) fn has_backlog(&self, now: Instant, id: EntityId) -> bool {
        const MOMENT: Duration = Duration::from_millis(1);
        let is_recent = self.received.is_some_and(|last| now < last + MOMENT);
        is_recent && self.endpoints.reader(id).is_some_and(Reader::has_backlog)
    }

    /// Where what has arrived can be seen.
    pub(super) fn arrivals(&self) -> Option<Arc<dyn Arrivals>> {
        self.link.arrivals()
    }

    /// Through which descriptors samples have come of late.
    pub(super) fn likely(&self) -> Wakeups {
        self.link.likely()
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
            self.handle_event(now, event);
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
            let send = |burst: &Burst<'_>| self.link.send(now, burst);
            self.outgoing.appended(start, transmit, send);
        }
        self.outgoing.flush(|burst| self.link.send(now, burst));
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
        let relief = self.batching.relief()?;
        let timeouts = [self.endpoints.poll_timeout(), self.link.poll_timeout()];
        let end = timeouts.into_iter().flatten().fold(relief, Instant::min);
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
        std::mem::take(&mut self.audience.notices)
    }
}
