//! The reliable built-in endpoints: those of SEDP and of the participant-message protocol (RTPS 2.5 sections 8.5.4
//! and 8.4.13), and their matching by the announced set.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::database::RemoteParticipant;
use super::endpoint_data::endpoint_instance;
use super::liveliness::participant_message_instance;
use super::{BuiltinEndpointSet, DiscoveryConfig};
use crate::RemoteEndpoint;
use crate::endpoints::Endpoints;
use crate::qos::{Durability, Qos, Reliability};
use crate::reader::{InstanceOf, ReaderConfig};
use crate::wire::{EntityId, Guid, GuidPrefix, KeyHash, SequenceNumber};
use crate::writer::{WriterConfig, WriterTiming};

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

/// The reader of each topic, and that topic's writer.
pub(super) fn readers() -> impl Iterator<Item = (EntityId, EntityId)> {
    TOPICS.iter().map(|topic| (topic.reader, topic.writer))
}

/// The largest sample that is taken: parameter lists with all that vendors put in stay far below.
const MAX_SAMPLE_SIZE: usize = 256 * 1024;

/// Remote participants may be inventions, so that asking them for acknowledgements must soon become rare.
fn timing() -> WriterTiming {
    WriterTiming {
        heartbeat_period: Duration::from_millis(20),
        heartbeat_period_max: Duration::from_secs(4),
        ..WriterTiming::default()
    }
}

/// Where counts in HEARTBEATs and ACKNACKs go on, so that those before a restart, or before the end of a lease, look
/// old to participants that still remember them. It leaves an incarnation twelve days of one count a second.
pub(super) fn count_at(incarnation: u32, age: Duration) -> i32 {
    (incarnation << 20)
        .wrapping_add(age.as_secs() as u32)
        .cast_signed()
}

fn qos() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        durability: Durability::TransientLocal,
        ..Qos::default()
    }
}

/// Our writers and readers.
pub(super) fn endpoints(config: &DiscoveryConfig) -> Endpoints {
    let prefix = config.participant.prefix;
    let mut endpoints = Endpoints::new(prefix);
    for topic in &TOPICS {
        endpoints.add_writer(WriterConfig {
            guid: Guid::new(prefix, topic.writer),
            qos: qos(),
            datagram_size: usize::from(config.datagram_size),
            timing: timing(),
        });
        if let Some(writer) = endpoints.writer_mut(topic.writer) {
            let next = writer.last_sequence().next();
            writer.resume_from(next, count_at(config.incarnation, Duration::ZERO));
        }
        let instance_of = topic.instance_of;
        let instance_of: InstanceOf = Arc::new(move |_, payload| instance_of(payload));
        endpoints.add_reader(ReaderConfig {
            datagram_size: usize::from(config.datagram_size),
            max_sample_size: MAX_SAMPLE_SIZE,
            instance_of: Some(instance_of),
            ..ReaderConfig::new(Guid::new(prefix, topic.reader), qos())
        });
    }
    endpoints
}

/// Matches our endpoints with those that the participant has, or updates its addresses. ACKNACKs to a new writer are
/// counted from `count` on.
pub(super) fn match_participant(
    endpoints: &mut Endpoints,
    now: Instant,
    participant: &RemoteParticipant,
    count: i32,
) {
    let set = participant.data.endpoints;
    for topic in &TOPICS {
        if set.has(topic.writer_bit) {
            let writer = remote(participant, topic.writer);
            let reader = endpoints.reader(topic.reader);
            let is_new = reader.is_some_and(|reader| !reader.is_matched(writer.guid));
            endpoints.match_remote(now, topic.reader, &writer);
            if let (true, Some(reader)) = (is_new, endpoints.reader_mut(topic.reader)) {
                reader.resume_from(writer.guid, SequenceNumber(1), count);
            }
        }
        if set.has(topic.reader_bit) {
            let reader = remote(participant, topic.reader);
            endpoints.match_remote(now, topic.writer, &reader);
        }
    }
}

/// Ends all matches with the participant.
pub(super) fn unmatch_participant(endpoints: &mut Endpoints, now: Instant, prefix: GuidPrefix) {
    for topic in &TOPICS {
        endpoints.unmatch(now, topic.reader, Guid::new(prefix, topic.writer));
        endpoints.unmatch(now, topic.writer, Guid::new(prefix, topic.reader));
    }
}

fn remote(participant: &RemoteParticipant, entity: EntityId) -> RemoteEndpoint {
    let mut qos = qos();
    if entity == EntityId::PARTICIPANT_MESSAGE_READER && participant.data.best_effort_messages {
        qos.reliability = Reliability::BestEffort;
    }
    RemoteEndpoint {
        guid: Guid::new(participant.data.prefix, entity),
        unicast: participant.metatraffic.clone(),
        addresses: participant.addresses().to_vec(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos,
        topic: String::new(),
        type_name: String::new(),
    }
}
