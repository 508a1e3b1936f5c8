//! What follows from discovery and from matching: routes, messages to apps, records to keep.

use std::collections::BTreeSet;

use rtps_ebpf::SlotSet;

use super::protocol::{FromLayer, MAX_PROTOCOL_MESSAGE};
use super::store::{Record, StoreKey};
use super::{KernelChange, Layer};
use crate::RemoteEndpoint;
use crate::discovery::{DiscoveryEvent, MatchChange, Outcome};
use crate::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};

/// How much of USER_DATA, TOPIC_DATA and GROUP_DATA a message to an app has room for beside names and partitions,
/// which are parameters and no longer than 64 KiB each.
const MAX_DATA: usize = MAX_PROTOCOL_MESSAGE / 8;

impl Layer {
    /// Acts on all that discovery has to tell.
    pub(super) fn settle(&mut self) {
        while let Some(event) = self.discovery.poll_event() {
            match event {
                DiscoveryEvent::ParticipantFound { prefix, .. } => self.handle_participant(prefix),
                DiscoveryEvent::ParticipantLost { prefix, endpoints } => {
                    self.handle_lost_participant(prefix, &endpoints);
                }
                DiscoveryEvent::EndpointFound(guid) => self.handle_endpoint(guid),
                DiscoveryEvent::EndpointLost(guid) => self.handle_lost_endpoint(guid),
                DiscoveryEvent::Liveliness {
                    participant,
                    manual,
                } => self.tell_liveliness(participant, manual),
                DiscoveryEvent::TypesRequested(request) => {
                    let reply = request.answer(self.matchmaker.types(), self.has_cyclone_0_10());
                    self.discovery.reply_to_lookup(reply);
                }
                DiscoveryEvent::TypesFound(objects) => {
                    let changes = self.matchmaker.learn_types(&objects);
                    self.apply(changes);
                }
                DiscoveryEvent::Asserted { sequence, manual } => {
                    self.tell_liveliness(self.config.prefix, manual);
                    self.store(Record::NextSequence {
                        writer: EntityId::PARTICIPANT_MESSAGE_WRITER,
                        next: sequence.next(),
                    });
                }
                DiscoveryEvent::Progress { writer, next }
                | DiscoveryEvent::Overtaken { writer, next } => {
                    // Also what the low-level layer knows: a change of ours to the participant may have undone it.
                    if self.config.kernel_discovery {
                        let exact = false;
                        self.kernel(KernelChange::Progress {
                            writer,
                            next,
                            exact,
                        });
                    }
                    self.store_progress(writer, next);
                }
                DiscoveryEvent::Disowned(prefix) => self.kernel(KernelChange::ForgetPeer(prefix)),
                DiscoveryEvent::WithdrawalDone {
                    announcer,
                    sequence,
                } => {
                    let is_writer = announcer == EntityId::SEDP_PUBLICATIONS_WRITER;
                    self.forget(StoreKey::sample(is_writer, sequence));
                }
            }
        }
    }

    /// Whether a participant is there that some TypeObjects would crash.
    fn has_cyclone_0_10(&self) -> bool {
        let mut participants = self.discovery.participants();
        participants.any(|remote| remote.data.is_cyclone_0_10())
    }

    /// Tells the low-level layer and the apps what has changed.
    pub(super) fn apply(&mut self, changes: Vec<MatchChange>) {
        let of_readers = changes.iter().filter(|change| change.local.is_reader());
        let writers: BTreeSet<_> = of_readers.map(|change| change.other).collect();
        for writer in writers {
            self.refresh_route(writer);
        }
        let wanted = self.matchmaker.take_wanted_types();
        self.discovery.ask_for_types(wanted);
        for change in changes {
            self.supervise(&change);
            self.tell(change);
        }
    }

    fn refresh_route(&mut self, writer: Guid) {
        let readers = self.matchmaker.matched_with(writer);
        let slots: SlotSet = readers.map(EntityId::slot).collect();
        let before = if slots.is_empty() {
            self.routes.remove(&writer)
        } else {
            self.routes.insert(writer, slots)
        };
        if before.unwrap_or(SlotSet::EMPTY) != slots {
            self.kernel(KernelChange::Route { writer, slots });
        }
    }

    fn tell(&mut self, change: MatchChange) {
        let (local, remote) = (change.local, change.other);
        if change.before == Some(Outcome::Matched) && change.now != Some(Outcome::Matched) {
            self.reply(local.slot(), FromLayer::Unmatched { local, remote });
        }
        let message = match change.now {
            None => return,
            Some(Outcome::Matched) => match self.match_of(local, remote) {
                Some(message) => message,
                None => return,
            },
            Some(Outcome::Incompatible(policy)) => FromLayer::IncompatibleQos {
                local,
                remote,
                policy,
            },
            Some(Outcome::InconsistentTopic) => FromLayer::InconsistentTopic { local, remote },
        };
        self.reply(local.slot(), message);
    }

    /// What the app of `local` is told of a match.
    pub(super) fn match_of(&mut self, local: EntityId, remote: Guid) -> Option<FromLayer> {
        let mut endpoint = self.matchmaker.endpoint(remote)?.clone();
        if remote.prefix == self.config.prefix {
            self.locate(local.slot(), &mut endpoint);
        }
        Some(matched(local, endpoint))
    }

    fn tell_liveliness(&mut self, participant: GuidPrefix, manual: bool) {
        let readers = self.matchmaker.matched_with_participant(participant);
        let slots: SlotSet = readers
            .filter(|local| local.is_reader())
            .map(EntityId::slot)
            .collect();
        for slot in slots.iter() {
            let message = FromLayer::Liveliness {
                participant,
                manual,
            };
            self.reply(slot, message);
        }
    }

    fn handle_participant(&mut self, prefix: GuidPrefix) {
        let Some(participant) = self.discovery.participant(prefix) else {
            return;
        };
        let record = Record::Participant {
            source: participant.source(),
            proven: participant.is_proven(),
            data: Box::new(participant.data.clone()),
        };
        // Endpoints without addresses of their own have moved with their participant.
        let entities = participant.endpoints.keys();
        let endpoints: Vec<_> = entities
            .filter_map(|entity| participant.endpoint(*entity))
            .collect();
        self.refresh_peer(prefix);
        for endpoint in endpoints {
            let changes = self.matchmaker.insert(endpoint);
            self.apply(changes);
        }
        self.show_participant(prefix);
        self.store(record);
    }

    fn handle_lost_participant(&mut self, prefix: GuidPrefix, endpoints: &[Guid]) {
        for guid in endpoints {
            self.handle_lost_endpoint(*guid);
        }
        self.hide_participant(prefix);
        self.forget_peer(prefix);
        for writer in [
            EntityId::SEDP_PUBLICATIONS_WRITER,
            EntityId::SEDP_SUBSCRIPTIONS_WRITER,
            EntityId::PARTICIPANT_MESSAGE_WRITER,
        ] {
            self.forget(StoreKey::progress(Guid::new(prefix, writer)));
        }
        self.forget(StoreKey::participant(prefix));
    }

    fn handle_endpoint(&mut self, guid: Guid) {
        let participant = self.discovery.participant(guid.prefix);
        let data = participant.and_then(|p| p.endpoints.get(&guid.entity).cloned());
        let (Some(data), Some(endpoint)) = (data, self.remote_endpoint(guid)) else {
            return;
        };
        if !self.peers.may_send_from(guid.prefix, &endpoint.addresses) {
            self.refresh_peer(guid.prefix);
        }
        let changes = self.matchmaker.insert(endpoint);
        self.apply(changes);
        self.show_endpoint(guid);
        if self.store(Record::Endpoint(Box::new(data))) {
            self.unstorable.remove(&guid);
        } else {
            self.unstorable.insert(guid);
        }
    }

    /// A remote endpoint as local ones are to see it.
    pub(super) fn remote_endpoint(&self, guid: Guid) -> Option<RemoteEndpoint> {
        let participant = self.discovery.participant(guid.prefix)?;
        participant.endpoint(guid.entity)
    }

    fn handle_lost_endpoint(&mut self, guid: Guid) {
        let changes = self.matchmaker.remove(guid);
        self.apply(changes);
        self.hide_endpoint(guid);
        self.unstorable.remove(&guid);
        self.forget(StoreKey::endpoint(guid));
    }

    /// A participant of which not everything could be stored has to say it all again after a restart.
    fn store_progress(&mut self, writer: Guid, next: SequenceNumber) {
        let first = Guid::new(writer.prefix, EntityId([0; 4]));
        let last = Guid::new(writer.prefix, EntityId([0xff; 4]));
        if self.unstorable.range(first..=last).next().is_some() {
            self.forget(StoreKey::progress(writer));
        } else {
            self.store(Record::Progress { writer, next });
        }
    }
}

/// What an app is told of a match.
fn matched(local: EntityId, remote: RemoteEndpoint) -> FromLayer {
    FromLayer::Matched {
        local,
        remote: Box::new(without_large_data(remote)),
    }
}

/// An endpoint as apps are told of it: without the data of user, topic and group where a remote participant has announced
/// so much of them that the message would not reach the app. Matching does not need them.
pub(super) fn without_large_data(mut endpoint: RemoteEndpoint) -> RemoteEndpoint {
    let (qos, remote) = (&mut endpoint.qos, endpoint.guid);
    let data = [&mut qos.user_data, &mut qos.topic_data, &mut qos.group_data];
    let length: usize = data.iter().map(|data| data.len()).sum();
    if length > MAX_DATA {
        tracing::warn!(%remote, length, "USER_DATA, TOPIC_DATA and GROUP_DATA are not told to the app");
        data.into_iter().for_each(Vec::clear);
    }
    endpoint
}
