//! A writer that is written to while its readers, four of them, come, go, acknowledge and ask for whatever they like.

#![no_main]

use std::sync::Arc;
use std::time::{Duration, Instant};

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use rtps_fuzz::{
    DATAGRAM, Message, Number, OURS, Policies, address, entities, remote, remote_guid,
    sequence_set, transmit,
};
use rtps_user::endpoints::Endpoints;
use rtps_user::filter::PayloadFilter;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::wire::{
    EntityId, EntityKind, FilterSignature, Guid, KeyHash, SequenceNumber, SubmessageKind, Timestamp,
};
use rtps_user::writer::{Writer, WriterConfig, WriterTiming};

#[derive(Arbitrary, Debug)]
struct Scene {
    policies: Policies,
    operations: Vec<Operation>,
}

#[derive(Arbitrary, Debug)]
enum Operation {
    Write {
        instance: u8,
        len: u16,
    },
    End {
        instance: u8,
        is_dispose: bool,
    },
    Match {
        reader: u8,
        policies: Policies,
    },
    /// The reader wants payloads of certain lengths only.
    Filter {
        reader: u8,
        divisor: Option<u8>,
    },
    BeginSet,
    EndSet,
    Unmatch {
        reader: u8,
    },
    AckNack {
        reader: u8,
        base: Number,
        count: u8,
        members: u64,
        acknack_count: i8,
        is_final: bool,
    },
    NackFrag {
        reader: u8,
        sequence: Number,
        base: u32,
        members: u32,
        nack_count: i8,
    },
    Transmit,
    Wait {
        milliseconds: u16,
    },
}

struct Bench {
    endpoints: Endpoints,
    now: Instant,
    writer: EntityId,
}

impl Bench {
    fn new(scene: &Scene) -> Self {
        let writer = EntityId::of_app(1, 1, EntityKind::WriterWithKey);
        let mut endpoints = Endpoints::new(OURS);
        endpoints.add_writer(WriterConfig {
            guid: Guid::new(OURS, writer),
            qos: scene.policies.qos(),
            datagram_size: DATAGRAM,
            timing: WriterTiming::default(),
        });
        Self {
            endpoints,
            now: Instant::now(),
            writer,
        }
    }

    fn last(&self) -> SequenceNumber {
        let writer = self.endpoints.writer(self.writer);
        writer.expect("the writer").last_sequence()
    }

    fn step(&mut self, operation: &Operation) {
        match *operation {
            Operation::Write { instance, len } => {
                self.write(ChangeKind::Alive, instance, len.into());
            }
            Operation::End {
                instance,
                is_dispose: true,
            } => self.write(ChangeKind::Disposed, instance, 0),
            Operation::End { instance, .. } => self.write(ChangeKind::Unregistered, instance, 0),
            Operation::Match { reader, policies } => {
                let (guid, number) = reader_of(reader);
                let remote = remote(guid, number, policies.qos());
                self.endpoints.match_remote(self.now, self.writer, &remote);
            }
            Operation::Unmatch { reader } => {
                let (guid, _) = reader_of(reader);
                self.endpoints.unmatch(self.now, self.writer, guid);
            }
            Operation::Filter { reader, divisor } => {
                let (guid, _) = reader_of(reader);
                let filter = divisor.map(|divisor| {
                    let passes: PayloadFilter =
                        Arc::new(move |_, payload| payload.len() % (usize::from(divisor) + 1) == 0);
                    (passes, FilterSignature([divisor; 16]))
                });
                self.writer_mut().set_reader_filter(guid, filter);
            }
            Operation::BeginSet => self.writer_mut().begin_coherent(),
            Operation::EndSet => {
                self.writer_mut().end_coherent(Timestamp::default());
            }
            Operation::AckNack { .. } | Operation::NackFrag { .. } => self.answer(operation),
            Operation::Transmit => transmit(&mut self.endpoints, self.now),
            Operation::Wait { milliseconds } => {
                self.now += Duration::from_millis(milliseconds.into());
                self.endpoints.handle_timeout(self.now);
            }
        }
    }

    fn write(&mut self, kind: ChangeKind, instance: u8, len: usize) {
        let change = NewChange {
            kind,
            instance: KeyHash([instance % 4; 16]),
            payload: vec![0; len].into(),
            timestamp: Timestamp::default(),
        };
        let now = self.now;
        let writer = self.writer_mut();
        // Its history may be full.
        let _ = writer.write(now, change);
    }

    fn writer_mut(&mut self) -> &mut Writer {
        self.endpoints.writer_mut(self.writer).expect("the writer")
    }

    fn answer(&mut self, operation: &Operation) {
        let last = self.last().0;
        let (reader, message) = match *operation {
            Operation::AckNack {
                reader,
                base,
                count,
                members,
                acknack_count,
                is_final,
            } => {
                let (guid, number) = reader_of(reader);
                let fields: [&[u8]; 3] = [
                    &entities(guid.entity, self.writer),
                    &sequence_set(base.from(last), count, members),
                    &i32::from(acknack_count).to_le_bytes(),
                ];
                let flags = u8::from(is_final) << 1;
                let message = Message::new(guid.prefix);
                (
                    number,
                    message.submessage(SubmessageKind::ACKNACK, flags, &fields),
                )
            }
            Operation::NackFrag {
                reader,
                sequence,
                base,
                members,
                nack_count,
            } => {
                let (guid, number) = reader_of(reader);
                let fields: [&[u8]; 6] = [
                    &entities(guid.entity, self.writer),
                    &rtps_fuzz::sequence(sequence.from(last)),
                    &base.to_le_bytes(),
                    &32u32.to_le_bytes(),
                    &members.to_le_bytes(),
                    &i32::from(nack_count).to_le_bytes(),
                ];
                let message = Message::new(guid.prefix);
                (
                    number,
                    message.submessage(SubmessageKind::NACK_FRAG, 0, &fields),
                )
            }
            _ => return,
        };
        // What makes no sense is refused.
        let _ = self
            .endpoints
            .handle_datagram(self.now, address(reader), message.bytes());
    }
}

fn reader_of(number: u8) -> (Guid, u8) {
    let number = number % 4 + 2;
    (remote_guid(number, EntityKind::ReaderWithKey), number)
}

fuzz_target!(|scene: Scene| {
    let mut bench = Bench::new(&scene);
    for operation in scene.operations.iter().take(500) {
        bench.step(operation);
        while bench.endpoints.poll_event().is_some() {}
    }
    bench.step(&Operation::EndSet);
    transmit(&mut bench.endpoints, bench.now);
    // Nobody is left to wait for.
    for reader in 0..4 {
        bench.step(&Operation::Unmatch { reader });
    }
    let writer = bench.endpoints.writer(bench.writer).expect("the writer");
    assert!(writer.all_acknowledged());
});
