//! A remote participant that exists only as far as discovery goes: what it says is valid, and nothing runs on it.
//!
//! It says HEARTBEAT and ACKNACK for its built-in endpoints when the host has announced itself to it, repeats what the
//! host asks for, and asks for what the host has.

use std::net::SocketAddr;
use std::time::Duration;

use rtps_user::discovery::{EndpointData, ParticipantData, ParticipantMessageData};
use rtps_user::qos::Qos;
use rtps_user::wire::{
    self, AckNack, Data, EntityId, Guid, GuidPrefix, Heartbeat, InlineQos, MessageReceiver,
    MessageWriter, PayloadKind, SequenceNumber, SequenceNumberSet, StatusInfo, Submessage,
};

/// The reliable built-in topics: writer and reader.
const TOPICS: [(EntityId, EntityId); 3] = [
    (
        EntityId::SEDP_PUBLICATIONS_WRITER,
        EntityId::SEDP_PUBLICATIONS_READER,
    ),
    (
        EntityId::SEDP_SUBSCRIPTIONS_WRITER,
        EntityId::SEDP_SUBSCRIPTIONS_READER,
    ),
    (
        EntityId::PARTICIPANT_MESSAGE_WRITER,
        EntityId::PARTICIPANT_MESSAGE_READER,
    ),
];
const PUBLICATIONS: usize = 0;
const PARTICIPANT_MESSAGES: usize = 2;

/// See the module.
pub(crate) struct Remote {
    pub(crate) prefix: GuidPrefix,
    /// The host, once it has answered.
    pub(crate) host: Option<GuidPrefix>,
    announcement: Vec<u8>,
    writers: [Writer; TOPICS.len()],
    /// By topic: the next number that is expected from the host.
    readers: [i64; TOPICS.len()],
    /// By topic: the last number that the host has told of.
    told: [i64; TOPICS.len()],
    count: i32,
}

/// A built-in writer.
#[derive(Default)]
struct Writer {
    /// The payloads of its samples from number 1 on.
    samples: Vec<Vec<u8>>,
    /// Base of the host's last ACKNACK.
    acknowledged: i64,
}

impl Remote {
    /// A participant that receives discovery traffic at `metatraffic` and is silent for `lease` at the most.
    pub(crate) fn new(prefix: GuidPrefix, metatraffic: SocketAddr, lease: Duration) -> Self {
        let data = ParticipantData {
            metatraffic_unicast: vec![metatraffic],
            default_unicast: vec![metatraffic],
            lease: wire::Duration::from_std(lease),
            ..ParticipantData::new(prefix)
        };
        let mut announcement = Vec::new();
        data.encode(&mut announcement);
        Self {
            prefix,
            host: None,
            announcement,
            writers: Default::default(),
            readers: [1; TOPICS.len()],
            told: [0; TOPICS.len()],
            count: 0,
        }
    }

    /// The SPDP announcement, in every message the same.
    pub(crate) fn announcement(&self) -> Vec<u8> {
        let payload = (PayloadKind::Data, self.announcement.as_slice());
        self.spdp(InlineQos::default(), payload)
    }

    /// The SPDP message by which it leaves.
    pub(crate) fn farewell(&self) -> Vec<u8> {
        let inline_qos = InlineQos {
            status: StatusInfo {
                disposed: true,
                unregistered: true,
                filtered: false,
            },
            ..InlineQos::default()
        };
        // A list of parameters may say more than the key.
        self.spdp(inline_qos, (PayloadKind::Key, &self.announcement))
    }

    fn spdp(&self, inline_qos: InlineQos, (kind, payload): (PayloadKind, &[u8])) -> Vec<u8> {
        let mut message = Vec::new();
        MessageWriter::new(&mut message, self.prefix).data(&Data {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SPDP_WRITER,
            sequence: SequenceNumber(1),
            inline_qos,
            filters: None,
            kind,
            payload,
        });
        message
    }

    /// Makes a writer of user data with an announcement of more than 1,024 bytes. Gives the message that tells of it.
    pub(crate) fn add_endpoint(&mut self) -> Vec<u8> {
        let number = self.writers[PUBLICATIONS].samples.len() + 1;
        let [.., high, low] = number.to_be_bytes();
        let entity = EntityId([0, high, low, 0x02]);
        let endpoint = EndpointData {
            guid: Guid::new(self.prefix, entity),
            topic: format!("Nobody reads this {number:01000}"),
            type_name: "ShapeType".to_owned(),
            type_information: Vec::new(),
            content_filter: None,
            unicast: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            qos: Qos::default(),
        };
        let mut payload = Vec::new();
        endpoint.encode(&mut payload);
        self.writers[PUBLICATIONS].samples.push(payload);
        self.sample(PUBLICATIONS, number as i64)
    }

    /// Asserts that its AUTOMATIC writers are alive. The host has room for one such sample, so only the last one is
    /// offered later on.
    pub(crate) fn assert_liveliness(&mut self) -> Vec<u8> {
        let assertion = ParticipantMessageData {
            participant: self.prefix,
            manual: false,
        };
        let mut payload = Vec::new();
        assertion.encode(&mut payload);
        self.writers[PARTICIPANT_MESSAGES].samples.push(payload);
        let number = self.writers[PARTICIPANT_MESSAGES].samples.len();
        self.sample(PARTICIPANT_MESSAGES, number as i64)
    }

    /// Everything that it has to tell is acknowledged, and it has everything that the host has told of.
    pub(crate) fn is_content(&self) -> bool {
        let endpoints = &self.writers[PUBLICATIONS];
        self.host.is_some()
            && endpoints.acknowledged == endpoints.samples.len() as i64 + 1
            && (self.told.iter().zip(self.readers)).all(|(told, next)| next > *told)
    }

    /// How many of its endpoints the host has acknowledged.
    pub(crate) fn acknowledged(&self) -> i64 {
        self.writers[PUBLICATIONS].acknowledged.max(1) - 1
    }

    /// Messages that ask the host to acknowledge, and for what it has: nothing before it has answered.
    pub(crate) fn questions(&mut self) -> Vec<Vec<u8>> {
        let topics = 0..TOPICS.len();
        let mut messages: Vec<_> = topics
            .clone()
            .filter_map(|topic| self.heartbeat(topic))
            .collect();
        messages.extend(topics.filter_map(|topic| self.acknack(topic, 0, false)));
        messages
    }

    /// Reads a message and gives the replies to it.
    pub(crate) fn receive(&mut self, message: &[u8]) -> Vec<Vec<u8>> {
        let Ok(receiver) = MessageReceiver::new(self.prefix, message) else {
            return Vec::new();
        };
        let submessages = receiver.filter_map(Result::ok);
        submessages
            .flat_map(|received| self.handle(received.source, &received.submessage))
            .collect()
    }

    fn handle(&mut self, source: GuidPrefix, submessage: &Submessage<'_>) -> Vec<Vec<u8>> {
        match submessage {
            Submessage::Data(data) if data.writer == EntityId::SPDP_WRITER => self.meet(source),
            Submessage::Data(data) => {
                self.take(data.writer, data.sequence.0, data.sequence.0 + 1);
                Vec::new()
            }
            Submessage::Gap(gap) => {
                self.take(gap.writer, gap.start.0, gap.list.base.0);
                Vec::new()
            }
            Submessage::Heartbeat(heartbeat) => self.acknowledge(heartbeat),
            Submessage::AckNack(acknack) => self.repeat(acknack),
            _ => Vec::new(),
        }
    }

    fn meet(&mut self, host: GuidPrefix) -> Vec<Vec<u8>> {
        match self.host.replace(host) {
            None => self.questions(),
            Some(_) => Vec::new(),
        }
    }

    /// Numbers from `start` to below `end` are there, or will not come.
    fn take(&mut self, writer: EntityId, start: i64, end: i64) {
        if let Some(topic) = of_writer(writer)
            && start <= self.readers[topic]
        {
            self.readers[topic] = self.readers[topic].max(end);
        }
    }

    fn acknowledge(&mut self, heartbeat: &Heartbeat) -> Vec<Vec<u8>> {
        let Some(topic) = of_writer(heartbeat.writer) else {
            return Vec::new();
        };
        self.told[topic] = heartbeat.last.0;
        self.readers[topic] = self.readers[topic].max(heartbeat.first.0);
        let is_complete = self.readers[topic] > heartbeat.last.0;
        if is_complete && heartbeat.is_final {
            return Vec::new();
        }
        let reply = self.acknack(topic, heartbeat.last.0, is_complete);
        reply.into_iter().collect()
    }

    fn repeat(&mut self, acknack: &AckNack) -> Vec<Vec<u8>> {
        let Some(topic) = of_writer(acknack.writer) else {
            return Vec::new();
        };
        let writer = &mut self.writers[topic];
        writer.acknowledged = writer.acknowledged.max(acknack.state.base.0);
        let there = 1..=writer.samples.len() as i64;
        let wanted = acknack.state.iter().map(|number| number.0);
        wanted
            .filter(|number| there.contains(number))
            .map(|number| self.sample(topic, number))
            .collect()
    }

    fn sample(&self, topic: usize, number: i64) -> Vec<u8> {
        let (writer, reader) = TOPICS[topic];
        self.directed(|message| {
            message.data(&Data {
                reader,
                writer,
                sequence: SequenceNumber(number),
                inline_qos: InlineQos::default(),
                filters: None,
                kind: PayloadKind::Data,
                payload: &self.writers[topic].samples[number as usize - 1],
            });
        })
    }

    fn heartbeat(&mut self, topic: usize) -> Option<Vec<u8>> {
        let (writer, reader) = TOPICS[topic];
        let last = self.writers[topic].samples.len() as i64;
        // KEEP_LAST 1, as others have it for this topic.
        let first = match topic {
            PARTICIPANT_MESSAGES => last.max(1),
            _ => 1,
        };
        self.count += 1;
        self.host?;
        Some(self.directed(|message| {
            message.heartbeat(&Heartbeat {
                reader,
                writer,
                first: SequenceNumber(first),
                last: SequenceNumber(last),
                count: self.count,
                is_final: false,
                liveliness: false,
                group: None,
            });
        }))
    }

    /// Asks for all up to `last`.
    fn acknack(&mut self, topic: usize, last: i64, is_final: bool) -> Option<Vec<u8>> {
        let (writer, reader) = TOPICS[topic];
        let base = SequenceNumber(self.readers[topic]);
        let missing = (base.0..=last).map(SequenceNumber);
        self.count += 1;
        self.host?;
        Some(self.directed(|message| {
            message.acknack(&AckNack {
                reader,
                writer,
                state: SequenceNumberSet::from_members(base, missing.take(256)),
                count: self.count,
                is_final,
            });
        }))
    }

    /// A message for the host, or, before it is known, for whoever gets it.
    fn directed(&self, write: impl FnOnce(&mut MessageWriter<'_>)) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut message = MessageWriter::new(&mut bytes, self.prefix);
        message.info_destination(self.host.unwrap_or(GuidPrefix::UNKNOWN));
        write(&mut message);
        bytes
    }
}

fn of_writer(writer: EntityId) -> Option<usize> {
    TOPICS.iter().position(|(entity, _)| *entity == writer)
}
