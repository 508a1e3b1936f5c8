//! The built-in topics (DDS 1.4 section 2.2.5): what is known of a domain, as values.
//!
//! [`BuiltinTopics`] gives what there is at the moment, and readers that tell of changes as samples. A participant that never
//! asks for them keeps nothing of it.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use md5::{Digest, Md5};
use rtps_user::RemoteEndpoint;
use rtps_user::discovery::ParticipantData;
use rtps_user::qos::ContentFilter;
use rtps_user::wire::{Guid, GuidPrefix, KeyHash};

use super::{BuiltinReader, builtin_reader};
use crate::driver::{Browser, Core};
use crate::qos::policies;
use crate::socket::RtpsSocket;

/// For how long what is known already may take to be told.
const PATIENCE: Duration = Duration::from_secs(1);

/// What is known of a domain beside the app's own endpoints.
pub struct BuiltinTopics {
    socket: RtpsSocket,
}

/// DCPSParticipant: a remote participant.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticipantBuiltinTopicData {
    /// The first part of the GUIDs of its endpoints.
    pub key: GuidPrefix,
    /// Its name for people; may be empty.
    pub name: String,
    /// USER_DATA.
    pub user_data: Vec<u8>,
}

/// DCPSTopic: a topic that endpoints have. RTPS announces none by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicBuiltinTopicData {
    /// Its name.
    pub name: String,
    /// The registered name of its type; where endpoints differ, there is an entry for each.
    pub type_name: String,
    /// TOPIC_DATA of one of its endpoints.
    pub topic_data: Vec<u8>,
}

/// DCPSPublication or DCPSSubscription: an endpoint of a remote participant, or of another app of this host where all are
/// one participant.
#[derive(Clone, Debug, PartialEq)]
pub struct EndpointBuiltinTopicData {
    /// Its name.
    pub key: Guid,
    /// Its topic.
    pub topic_name: String,
    /// The registered name of the topic's type.
    pub type_name: String,
    /// Its policies, with those of its publisher or subscriber and topic.
    pub qos: policies::Qos,
    /// What a reader wants of the topic, if not all.
    pub content_filter: Option<ContentFilter>,
}

impl From<&ParticipantData> for ParticipantBuiltinTopicData {
    fn from(participant: &ParticipantData) -> Self {
        Self {
            key: participant.prefix,
            name: participant.name.clone(),
            user_data: participant.user_data.clone(),
        }
    }
}

impl From<&RemoteEndpoint> for EndpointBuiltinTopicData {
    fn from(endpoint: &RemoteEndpoint) -> Self {
        Self {
            key: endpoint.guid,
            topic_name: endpoint.topic.clone(),
            type_name: endpoint.type_name.clone(),
            qos: endpoint.qos.clone(),
            content_filter: endpoint.content_filter.clone(),
        }
    }
}

impl TopicBuiltinTopicData {
    /// Names it among topics: a hash of both names.
    pub(super) fn handle(&self) -> KeyHash {
        let mut hash = Md5::new();
        hash.update(&self.name);
        hash.update([0]);
        hash.update(&self.type_name);
        KeyHash(hash.finalize().into())
    }
}

/// The topics that endpoints have, by name.
pub(super) fn topics_of(core: &Core) -> Vec<TopicBuiltinTopicData> {
    let mut topics = BTreeMap::new();
    for (_, endpoint) in core.known_endpoints() {
        topics
            .entry((&endpoint.topic, &endpoint.type_name))
            .or_insert(&endpoint.qos.topic_data);
    }
    topics
        .into_iter()
        .map(|((name, type_name), topic_data)| TopicBuiltinTopicData {
            name: name.clone(),
            type_name: type_name.clone(),
            topic_data: topic_data.clone(),
        })
        .collect()
}

impl BuiltinTopics {
    /// Waits until what is known already has been told.
    pub(super) fn new(socket: RtpsSocket) -> Self {
        let deadline = Instant::now().checked_add(PATIENCE);
        socket.shared().with(Core::browse);
        socket.shared().wait_until(deadline, |core, _| {
            let is_complete = core.browser().is_some_and(Browser::is_complete);
            is_complete.then_some(())
        });
        Self { socket }
    }

    /// The remote participants. On the kernel layer a host is one participant, however many apps it runs.
    pub fn participants(&self) -> Vec<ParticipantBuiltinTopicData> {
        self.look(|core| {
            let participants = core.known_participants();
            let participants = participants.map(|(_, participant)| participant.into());
            participants.collect()
        })
    }

    /// What is known of one of them (`get_discovered_participant_data`).
    pub fn participant(&self, key: GuidPrefix) -> Option<ParticipantBuiltinTopicData> {
        self.look(|core| {
            let mut participants = core.known_participants();
            let found = participants.find(|(_, participant)| participant.prefix == key);
            found.map(|(_, participant)| participant.into())
        })
    }

    /// The topics that endpoints have, by name.
    pub fn topics(&self) -> Vec<TopicBuiltinTopicData> {
        self.look(topics_of)
    }

    /// The writers.
    pub fn publications(&self) -> Vec<EndpointBuiltinTopicData> {
        self.endpoints(|endpoint| endpoint.guid.entity.is_writer())
    }

    /// The readers.
    pub fn subscriptions(&self) -> Vec<EndpointBuiltinTopicData> {
        self.endpoints(|endpoint| endpoint.guid.entity.is_reader())
    }

    /// A reader of DCPSParticipant.
    pub fn participant_reader(&self) -> BuiltinReader<ParticipantBuiltinTopicData> {
        BuiltinReader::new(self.socket.clone(), builtin_reader::participants)
    }

    /// A reader of DCPSTopic.
    pub fn topic_reader(&self) -> BuiltinReader<TopicBuiltinTopicData> {
        BuiltinReader::new(self.socket.clone(), builtin_reader::topics)
    }

    /// A reader of DCPSPublication.
    pub fn publication_reader(&self) -> BuiltinReader<EndpointBuiltinTopicData> {
        BuiltinReader::new(self.socket.clone(), builtin_reader::publications)
    }

    /// A reader of DCPSSubscription.
    pub fn subscription_reader(&self) -> BuiltinReader<EndpointBuiltinTopicData> {
        BuiltinReader::new(self.socket.clone(), builtin_reader::subscriptions)
    }

    /// How often something has changed so far.
    pub fn changes(&self) -> u64 {
        self.look(|core| core.browser().map_or(0, Browser::changes))
    }

    /// Waits until more has changed than `seen`; false when `timeout` passes before.
    pub fn wait(&self, seen: u64, timeout: Duration) -> bool {
        let deadline = Instant::now().checked_add(timeout);
        let changed = self.socket.shared().wait_until(deadline, |core, _| {
            (core.browser()?.changes() > seen).then_some(())
        });
        changed.is_some()
    }

    fn endpoints(&self, wanted: impl Fn(&RemoteEndpoint) -> bool) -> Vec<EndpointBuiltinTopicData> {
        self.look(|core| {
            let endpoints = core.known_endpoints().map(|(_, endpoint)| endpoint);
            let endpoints = endpoints.filter(|endpoint| wanted(endpoint));
            endpoints.map(EndpointBuiltinTopicData::from).collect()
        })
    }

    fn look<R>(&self, look: impl FnOnce(&Core) -> R) -> R {
        self.socket.shared().poll(|core, _| look(core))
    }
}
