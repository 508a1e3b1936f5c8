//! What follows from the messages of the layer and from what happens to endpoints.

use std::time::Instant;

use rtps_user::RemoteEndpoint;
use rtps_user::endpoints::EndpointEvent;
use rtps_user::layer::protocol::FromLayer;
use rtps_user::qos::PolicyId;
use rtps_user::wire::{EntityId, Guid};

use super::audience::Audience;
use super::core::Core;
use super::entity::Entity;
use crate::status::StatusEvent;

impl Core {
    pub(super) fn handle_message(&mut self, now: Instant, message: FromLayer) {
        match message {
            FromLayer::Matched { local, remote } if !self.is_match_ignored(local, remote.guid) => {
                self.endpoints.match_remote(now, local, &remote);
                self.suit_reader(local, &remote);
                self.on_entity(local, |entity, audience| entity.add_match(remote, audience));
            }
            FromLayer::Unmatched { local, remote } => self.end_match(now, local, remote),
            FromLayer::IncompatibleQos {
                local,
                remote,
                policy,
            } if !self.is_match_ignored(local, remote) => {
                self.report_incompatible(local, remote, policy);
            }
            FromLayer::InconsistentTopic { local, remote }
                if !self.is_match_ignored(local, remote) =>
            {
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
            FromLayer::Discovered(news) => self.handle_discovered(now, news),
            // The rest is for the link, or of what the app ignores.
            FromLayer::Matched { .. }
            | FromLayer::IncompatibleQos { .. }
            | FromLayer::InconsistentTopic { .. }
            | FromLayer::Welcome(_)
            | FromLayer::FanOut { .. }
            | FromLayer::Channel { .. }
            | FromLayer::ChannelClosed { .. } => {}
        }
    }

    pub(super) fn end_match(&mut self, now: Instant, local: EntityId, remote: Guid) {
        self.endpoints.unmatch(now, local, remote);
        self.review_group(local);
        self.on_entity(local, |entity, audience| {
            entity.remove_match(remote, audience)
        });
    }

    /// Has a writer send a reader what it wants, as far as that is understood, in a form that it reads.
    fn suit_reader(&mut self, local: EntityId, remote: &RemoteEndpoint) {
        let entity = self.entities.get(&local);
        let writer = self.endpoints.writer_mut(local);
        let (Some(entity), Some(writer)) = (entity, writer) else {
            return;
        };
        if let Some(make_filter) = entity.declaration.make_filter {
            let announced = remote.content_filter.as_ref();
            let filter =
                announced.and_then(|filter| Some((make_filter(filter)?, filter.signature())));
            writer.set_reader_filter(remote.guid, filter);
        }
        if let Some(bare_key) = entity.declaration.bare_key
            && remote.takes_bare_keys
        {
            writer.set_reader_bare_key(remote.guid, bare_key);
        }
    }

    /// Ends all matches, which nobody would end any more, and says so.
    pub(super) fn lose_layer(&mut self, now: Instant) {
        self.is_lost = true;
        for (id, entity) in &mut self.entities {
            let matched: Vec<_> = entity.matched().collect();
            for remote in matched {
                self.endpoints.unmatch(now, *id, remote);
                entity.remove_match(remote, &mut self.audience);
            }
        }
        self.report_all(&StatusEvent::LayerLost);
    }

    /// Reports what concerns the participant to all its endpoints.
    fn report_all(&mut self, event: &StatusEvent) {
        self.seat.news = true;
        for entity in self.entities.values_mut() {
            entity.report(event.clone(), &mut self.audience);
        }
    }

    pub(super) fn handle_event(&mut self, now: Instant, event: EndpointEvent) {
        match event {
            EndpointEvent::DataAvailable(id) => {
                self.batching.expect_answer();
                self.review_group(id);
                self.on_entity(id, |entity, audience| entity.data_available(audience));
            }
            EndpointEvent::Asserted { .. } => self.tell_assertion(now),
            EndpointEvent::Acknowledged(id) => {
                self.on_entity(id, |entity, audience| entity.wake(audience));
            }
            event => {
                if let Some((id, event)) = status_of(event) {
                    self.on_entity(id, |entity, audience| entity.report(event, audience));
                }
            }
        }
    }

    fn report_incompatible(&mut self, local: EntityId, remote: Guid, policy: PolicyId) {
        let is_writer = local.is_writer();
        self.on_entity(local, |entity, audience| {
            let topic = entity.topic();
            let event = if is_writer {
                tracing::warn!(
                    "writer of {topic:?} does not match reader {remote}: it requests more than is offered, {policy:?}"
                );
                StatusEvent::OfferedIncompatibleQos { policy, total: 0, reader: remote }
            } else {
                tracing::warn!(
                    "reader of {topic:?} does not match writer {remote}: it offers less than is requested, {policy:?}"
                );
                StatusEvent::RequestedIncompatibleQos { policy, total: 0, writer: remote }
            };
            entity.report(event, audience);
        });
    }

    fn report_inconsistent(&mut self, local: EntityId, remote: Guid) {
        self.on_entity(local, |entity, audience| {
            let topic = entity.topic();
            tracing::warn!("topic {topic:?} has another type at {remote}: the two do not match");
            audience.topics.note_inconsistent(topic, remote);
            entity.report(
                StatusEvent::InconsistentTopic { total: 0, remote },
                audience,
            );
        });
    }

    /// Whatever happens to an entity, somebody may wait for it.
    fn on_entity(&mut self, id: EntityId, act: impl FnOnce(&mut Entity, &mut Audience)) {
        self.seat.news = true;
        if let Some(entity) = self.entities.get_mut(&id) {
            act(entity, &mut self.audience);
        }
    }
}

/// The status that an event changes, and whose it is. Its total is counted later.
fn status_of(event: EndpointEvent) -> Option<(EntityId, StatusEvent)> {
    Some(match event {
        EndpointEvent::DataAvailable(_)
        | EndpointEvent::Acknowledged(_)
        | EndpointEvent::Asserted { .. } => return None,
        EndpointEvent::LivelinessLost(writer) => (writer, StatusEvent::LivelinessLost { total: 0 }),
        EndpointEvent::SampleLost {
            reader,
            writer,
            count,
        } => (
            reader,
            StatusEvent::SampleLost {
                count,
                total: 0,
                writer,
            },
        ),
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
                total: 0,
                writer,
            },
        ),
        EndpointEvent::OfferedDeadlineMissed { writer, instance } => (
            writer,
            StatusEvent::OfferedDeadlineMissed { instance, total: 0 },
        ),
        EndpointEvent::DeadlineMissed { reader, instance } => (
            reader,
            StatusEvent::RequestedDeadlineMissed { instance, total: 0 },
        ),
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
    })
}
