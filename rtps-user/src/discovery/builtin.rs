//! The reliable built-in endpoints: those of SEDP, of the participant-message protocol (RTPS 2.5 sections 8.5.4 and
//! 8.4.13) and of the TypeLookup service (XTypes 7.6.3.3.4), and their matching by the announced set.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::endpoint_data::endpoint_instance;
use super::liveliness::participant_message_instance;
use super::remote_participant::RemoteParticipant;
use super::{BuiltinEndpointSet, DiscoveryConfig};
use crate::endpoints::Endpoints;
use crate::qos::{Durability, History, Qos, Reliability};
use crate::reader::{InstanceOf, ReaderConfig, ReaderTiming};
use crate::wire::{EntityId, Guid, GuidPrefix, KeyHash, SequenceNumber};
use crate::writer::{WriterConfig, WriterTiming};
use crate::{CountClock, RemoteEndpoint};

/// A topic of which every participant has a writer and a reader.
struct BuiltinTopic {
    writer: EntityId,
    writer_bit: u32,
    reader: EntityId,
    reader_bit: u32,
    instance_of: fn(&[u8]) -> Option<KeyHash>,
}

const TOPICS: [BuiltinTopic; 3] = [
    BuiltinTopic {
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        writer_bit: BuiltinEndpointSet::PUBLICATIONS_ANNOUNCER,
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        reader_bit: BuiltinEndpointSet::PUBLICATIONS_DETECTOR,
        instance_of: endpoint_instance,
    },
    BuiltinTopic {
        writer: EntityId::SEDP_SUBSCRIPTIONS_WRITER,
        writer_bit: BuiltinEndpointSet::SUBSCRIPTIONS_ANNOUNCER,
        reader: EntityId::SEDP_SUBSCRIPTIONS_READER,
        reader_bit: BuiltinEndpointSet::SUBSCRIPTIONS_DETECTOR,
        instance_of: endpoint_instance,
    },
    BuiltinTopic {
        writer: EntityId::PARTICIPANT_MESSAGE_WRITER,
        writer_bit: BuiltinEndpointSet::PARTICIPANT_MESSAGE_WRITER,
        reader: EntityId::PARTICIPANT_MESSAGE_READER,
        reader_bit: BuiltinEndpointSet::PARTICIPANT_MESSAGE_READER,
        instance_of: participant_message_instance,
    },
];

/// The topics of the TypeLookup service, which the low-level layer has no part in.
const LOOKUP_TOPICS: [BuiltinTopic; 2] = [
    BuiltinTopic {
        writer: EntityId::TYPE_LOOKUP_REQUEST_WRITER,
        writer_bit: BuiltinEndpointSet::TYPE_LOOKUP_REQUEST_WRITER,
        reader: EntityId::TYPE_LOOKUP_REQUEST_READER,
        reader_bit: BuiltinEndpointSet::TYPE_LOOKUP_REQUEST_READER,
        instance_of: |_| None,
    },
    BuiltinTopic {
        writer: EntityId::TYPE_LOOKUP_REPLY_WRITER,
        writer_bit: BuiltinEndpointSet::TYPE_LOOKUP_REPLY_WRITER,
        reader: EntityId::TYPE_LOOKUP_REPLY_READER,
        reader_bit: BuiltinEndpointSet::TYPE_LOOKUP_REPLY_READER,
        instance_of: |_| None,
    },
];

fn all_topics() -> impl Iterator<Item = &'static BuiltinTopic> {
    TOPICS.iter().chain(&LOOKUP_TOPICS)
}

/// Whether an entity is one of the TypeLookup service.
pub(super) fn is_type_lookup(entity: EntityId) -> bool {
    LOOKUP_TOPICS
        .iter()
        .any(|topic| [topic.writer, topic.reader].contains(&entity))
}

/// The writer and the reader of each topic of discovery.
pub(super) fn topics() -> impl Iterator<Item = (EntityId, EntityId)> {
    TOPICS.iter().map(|topic| (topic.writer, topic.reader))
}

/// The reader of a writer's topic.
pub(super) fn reader_of(writer: EntityId) -> Option<EntityId> {
    let topic = TOPICS.iter().find(|topic| topic.writer == writer)?;
    Some(topic.reader)
}

/// The writer of a reader's topic.
pub(super) fn writer_of(reader: EntityId) -> Option<EntityId> {
    let topic = TOPICS.iter().find(|topic| topic.reader == reader)?;
    Some(topic.writer)
}

/// The largest sample that is taken: parameter lists with all that vendors put in stay far below.
const MAX_SAMPLE_SIZE: usize = 256 * 1024;

/// Requests and replies of the TypeLookup service that wait for acknowledgement at the most.
const LOOKUP_DEPTH: u32 = 64;

/// Remote participants may be inventions, so that asking them for acknowledgements must soon become rare.
fn timing() -> WriterTiming {
    WriterTiming {
        heartbeat_period: Duration::from_millis(20),
        heartbeat_period_max: Duration::from_secs(4),
        ..WriterTiming::default()
    }
}

fn qos(entity: EntityId) -> Qos {
    let reliability = Reliability::RELIABLE;
    if is_type_lookup(entity) {
        return Qos {
            reliability,
            history: History::KeepLast(LOOKUP_DEPTH),
            ..Qos::default()
        };
    }
    Qos {
        reliability,
        durability: Durability::TransientLocal,
        ..Qos::default()
    }
}

/// Our writers and readers.
pub(super) fn endpoints(config: &DiscoveryConfig, now: Instant) -> Endpoints {
    let count_clock = Some(CountClock::new(now, config.count_age));
    // The low-level layer keeps the HEARTBEATs to itself that would tell that a greeting has been answered.
    let max_greetings = if config.kernel_discovery { 3 } else { u32::MAX };
    let prefix = config.participant.prefix;
    let mut endpoints = Endpoints::new(prefix);
    for topic in all_topics() {
        let is_lookup = is_type_lookup(topic.writer);
        endpoints.add_writer(WriterConfig {
            guid: Guid::new(prefix, topic.writer),
            qos: qos(topic.writer),
            datagram_size: usize::from(config.datagram_size),
            timing: WriterTiming {
                count_clock,
                ..timing()
            },
        });
        if let Some(writer) = endpoints.writer_mut(topic.writer) {
            if is_lookup {
                // Where an earlier run got to is not kept: time has got further than it did.
                let age = i64::try_from(config.count_age.as_millis()).unwrap_or(i64::MAX);
                writer.resume_from(SequenceNumber(age).next(), 0);
            } else if config.kernel_discovery {
                writer.publish();
            }
        }
        let instance_of = topic.instance_of;
        let instance_of: InstanceOf = Arc::new(move |_, payload| instance_of(payload));
        endpoints.add_reader(ReaderConfig {
            datagram_size: usize::from(config.datagram_size),
            max_sample_size: MAX_SAMPLE_SIZE,
            instance_of: (!is_lookup).then_some(instance_of),
            timing: ReaderTiming {
                // Of requests and replies none is of interest that was sent before.
                max_greetings: if is_lookup { 1 } else { max_greetings },
                count_clock,
                ..ReaderTiming::default()
            },
            ..ReaderConfig::new(Guid::new(prefix, topic.reader), qos(topic.reader))
        });
    }
    endpoints
}

/// Matches our endpoints with those that the participant has, or updates its addresses.
pub(super) fn match_participant(
    endpoints: &mut Endpoints,
    now: Instant,
    participant: &RemoteParticipant,
) {
    let set = participant.data.endpoints;
    for topic in all_topics() {
        if set.has(topic.writer_bit) {
            let writer = remote(participant, topic.writer);
            endpoints.match_remote(now, topic.reader, &writer);
        }
        if set.has(topic.reader_bit) {
            let reader = remote(participant, topic.reader);
            endpoints.match_remote(now, topic.writer, &reader);
        }
    }
}

/// Ends all matches with the participant.
pub(super) fn unmatch_participant(endpoints: &mut Endpoints, now: Instant, prefix: GuidPrefix) {
    for topic in all_topics() {
        endpoints.unmatch(now, topic.reader, Guid::new(prefix, topic.writer));
        endpoints.unmatch(now, topic.writer, Guid::new(prefix, topic.reader));
    }
}

fn remote(participant: &RemoteParticipant, entity: EntityId) -> RemoteEndpoint {
    let mut qos = qos(entity);
    if entity == EntityId::PARTICIPANT_MESSAGE_READER && participant.data.best_effort_messages {
        qos.reliability = Reliability::BestEffort;
    }
    RemoteEndpoint {
        guid: Guid::new(participant.data.prefix, entity),
        unicast: participant.metatraffic.clone(),
        addresses: participant.addresses().to_vec(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        takes_bare_keys: false,
        qos,
        topic: String::new(),
        type_name: String::new(),
        type_information: Vec::new(),
        content_filter: None,
    }
}
