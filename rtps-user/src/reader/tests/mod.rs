//! Readers in virtual time, fed with submessages made by hand.

mod acknack;
mod any_policy;
mod best_effort;
mod cache;
mod coherent;
mod filters;
mod fragments;
mod lifecycle;
mod lifespan;
mod liveliness;
mod ownership;
mod random;
mod reliable;
mod separation;
mod source_order;
mod walk;

use std::time::{Duration, Instant};

use super::*;
use crate::qos::{Durability, Reliability};
use crate::wire;
use crate::wire::{
    AckNack, EntityId, EntityKind, InlineQos, KeyHash, MessageReceiver, NackFrag, PayloadKind,
    SequenceNumberSet, StatusInfo, Submessage,
};

const ALIVE: StatusInfo = StatusInfo {
    disposed: false,
    unregistered: false,
    filtered: false,
};
const DISPOSED: StatusInfo = StatusInfo {
    disposed: true,
    ..ALIVE
};
const UNREGISTERED: StatusInfo = StatusInfo {
    unregistered: true,
    ..ALIVE
};

const READER_PREFIX: GuidPrefix = GuidPrefix([1; 12]);

/// The `index`-th remote writer.
fn writer(index: u8) -> Guid {
    Guid::new(GuidPrefix([100 + index; 12]), EntityId([7, 0, index, 0x02]))
}

fn key(number: u8) -> KeyHash {
    KeyHash([number; 16])
}

fn reliable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: crate::qos::History::KeepAll,
        ..Qos::default()
    }
}

fn transient_local() -> Qos {
    Qos {
        durability: Durability::TransientLocal,
        ..reliable()
    }
}

fn remote(guid: Guid, qos: Qos) -> RemoteEndpoint {
    RemoteEndpoint {
        guid,
        unicast: vec!["10.0.0.2:7411".parse().unwrap()],
        addresses: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        takes_bare_keys: false,
        qos,
        topic: "Square".into(),
        type_name: "ShapeType".into(),
        type_information: Vec::new(),
        content_filter: None,
    }
}

fn millis(millis: u64) -> wire::Duration {
    wire::Duration::from_std(Duration::from_millis(millis))
}

/// What a reader answered.
#[derive(Clone, Debug, PartialEq)]
enum Answer {
    /// Base, members, count, final.
    AckNack(i64, Vec<i64>, i32, bool),
    /// Number, missing fragments, count.
    NackFrag(i64, Vec<u32>, i32),
}

/// A reader with keys, one matched writer, and a clock that stands still unless told to go on.
struct Bench {
    reader: Reader,
    now: Instant,
    writer: Guid,
    heartbeats: i32,
    /// The source timestamp of what is written.
    timestamp: Option<Timestamp>,
}

impl Bench {
    fn new(reader: Qos, writer_qos: Qos) -> Self {
        let mut bench = Self::unmatched(ReaderConfig::new(reader_guid(), reader));
        bench
            .reader
            .match_writer(bench.now, &remote(bench.writer, writer_qos));
        bench
    }

    /// A reliable pair whose greeting has been sent and answered: the writer has nothing yet.
    fn started(reader: Qos, writer_qos: Qos) -> Self {
        let mut bench = Self::new(reader, writer_qos);
        bench.answers();
        bench.heartbeat(1, 0);
        bench.answers();
        bench.events();
        bench
    }

    fn unmatched(config: ReaderConfig) -> Self {
        Self {
            reader: Reader::new(config),
            now: Instant::now(),
            writer: writer(1),
            heartbeats: 0,
            timestamp: None,
        }
    }

    /// What follows comes from the `index`-th writer, matched now or with other policies than before.
    fn switch_to(&mut self, index: u8, qos: Qos) {
        self.writer = writer(index);
        let known = remote(self.writer, qos);
        self.reader.match_writer(self.now, &known);
    }

    fn wait(&mut self, millis: u64) {
        self.now += Duration::from_millis(millis);
        self.reader.handle_timeout(self.now);
    }

    fn data(&mut self, sequence: i64) {
        self.sample(
            sequence,
            key(0),
            StatusInfo::default(),
            &sequence.to_le_bytes(),
        );
    }

    fn sample(&mut self, sequence: i64, instance: KeyHash, status: StatusInfo, payload: &[u8]) {
        let kind = if payload.is_empty() {
            PayloadKind::None
        } else {
            PayloadKind::Data
        };
        let inline_qos = InlineQos {
            key_hash: Some(instance),
            status,
            ..InlineQos::default()
        };
        self.submit(sequence, inline_qos, kind, payload);
    }

    fn submit(&mut self, sequence: i64, inline_qos: InlineQos, kind: PayloadKind, payload: &[u8]) {
        let data = Data {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(sequence),
            inline_qos,
            filters: None,
            kind,
            payload,
        };
        self.reader
            .handle_data(self.now, self.writer, self.timestamp, &data);
    }

    /// GAP of `start..base` and `members`.
    fn gap(&mut self, start: i64, base: i64, members: &[i64]) {
        let numbers = members.iter().copied().map(SequenceNumber);
        let gap = Gap {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            start: SequenceNumber(start),
            list: SequenceNumberSet::from_members(SequenceNumber(base), numbers),
        };
        self.reader.handle_gap(self.now, self.writer, &gap);
    }

    /// A HEARTBEAT that wants an answer, with a new count.
    fn heartbeat(&mut self, first: i64, last: i64) {
        self.heartbeats += 1;
        self.heartbeat_with(first, last, self.heartbeats, false);
    }

    fn heartbeat_with(&mut self, first: i64, last: i64, count: i32, is_final: bool) {
        let heartbeat = Heartbeat {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            first: SequenceNumber(first),
            last: SequenceNumber(last),
            count,
            is_final,
            liveliness: false,
            group: None,
        };
        self.reader
            .handle_heartbeat(self.now, self.writer, &heartbeat);
    }

    /// All that is sent now.
    fn answers(&mut self) -> Vec<Answer> {
        let (mut answers, mut out) = (Vec::new(), Vec::new());
        while let Some(transmit) = self.reader.poll_transmit(self.now, &mut out) {
            assert_eq!(*transmit.destinations, ["10.0.0.2:7411".parse().unwrap()]);
            assert!(out.len() <= self.reader.config.datagram_size);
            let received = MessageReceiver::new(self.writer.prefix, &out).unwrap();
            answers.extend(received.map(|received| answer(received.unwrap().submessage)));
            out.clear();
        }
        answers
    }

    fn events(&mut self) -> Vec<ReaderEvent> {
        std::iter::from_fn(|| self.reader.poll_event()).collect()
    }

    /// Numbers of the changes that are taken now.
    fn taken(&mut self) -> Vec<i64> {
        sequences(&self.take())
    }

    fn take(&mut self) -> Vec<Sample> {
        self.reader.take(usize::MAX, &Selection::default())
    }

    fn progress(&self) -> i64 {
        self.reader.progress(self.writer).unwrap().0
    }
}

fn reader_guid() -> Guid {
    Guid::new(
        READER_PREFIX,
        EntityId::of_app(1, 1, EntityKind::ReaderWithKey),
    )
}

fn sequences(samples: &[Sample]) -> Vec<i64> {
    samples
        .iter()
        .map(|sample| sample.info.sequence.0)
        .collect()
}

fn answer(submessage: Submessage<'_>) -> Answer {
    match submessage {
        Submessage::AckNack(AckNack {
            reader,
            state,
            count,
            is_final,
            ..
        }) => {
            assert_eq!(reader, reader_guid().entity);
            let members = state.iter().map(|number| number.0).collect();
            Answer::AckNack(state.base.0, members, count, is_final)
        }
        Submessage::NackFrag(NackFrag {
            sequence,
            missing,
            count,
            ..
        }) => Answer::NackFrag(sequence.0, missing.iter().collect(), count),
        other => panic!("a reader does not send {other:?}"),
    }
}

fn lost(count: u64) -> ReaderEvent {
    ReaderEvent::SampleLost {
        writer: writer(1),
        count,
    }
}
