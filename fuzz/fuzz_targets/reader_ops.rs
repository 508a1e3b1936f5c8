//! A reader that is read from while two writers send it whatever they like.

#![no_main]

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use rtps_fuzz::{
    Message, Number, OURS, address, entities, remote, remote_guid, sequence, sequence_set, transmit,
};
use rtps_user::endpoints::Endpoints;
use rtps_user::qos::{Durability, History, Qos, Reliability, ResourceLimits};
use rtps_user::reader::{ReaderConfig, Sample, Selection};
use rtps_user::wire::{EntityId, EntityKind, Guid, SequenceNumber, SubmessageKind};

const MOST_SAMPLES: u32 = 16;
const FLAG_INLINE_QOS: u8 = 2;
const FLAG_DATA: u8 = 4;

#[derive(Arbitrary, Debug)]
struct Scene {
    depth: Option<u8>,
    is_reliable: bool,
    is_transient_local: bool,
    operations: Vec<Operation>,
}

#[derive(Arbitrary, Debug)]
enum Operation {
    Match {
        writer: u8,
    },
    Unmatch {
        writer: u8,
    },
    Data {
        writer: u8,
        sequence: Number,
        instance: u8,
        status: u8,
        flags: u8,
        len: u8,
    },
    DataFrag {
        writer: u8,
        sequence: Number,
        first: u32,
        count: u16,
        size: u16,
        sample_size: u32,
        len: u8,
    },
    Heartbeat {
        writer: u8,
        first: Number,
        last: Number,
        count: i8,
        flags: u8,
    },
    HeartbeatFrag {
        writer: u8,
        sequence: Number,
        last: u32,
        count: i8,
    },
    Gap {
        writer: u8,
        start: Number,
        base: Number,
        count: u8,
        members: u64,
    },
    Take {
        max: u8,
    },
    Read {
        max: u8,
    },
    Wait {
        milliseconds: u16,
    },
}

struct Bench {
    endpoints: Endpoints,
    now: Instant,
    reader: EntityId,
    qos: Qos,
    /// The last sample of each writer that was taken since it was matched.
    taken: BTreeMap<Guid, SequenceNumber>,
}

impl Bench {
    fn new(scene: &Scene) -> Self {
        let qos = Qos {
            reliability: match scene.is_reliable {
                true => Reliability::RELIABLE,
                false => Reliability::BestEffort,
            },
            durability: match scene.is_transient_local {
                true => Durability::TransientLocal,
                false => Durability::Volatile,
            },
            history: match scene.depth {
                Some(depth) => History::KeepLast(u32::from(depth % 8) + 1),
                None => History::KeepAll,
            },
            resource_limits: ResourceLimits {
                max_samples: Some(MOST_SAMPLES),
                ..ResourceLimits::default()
            },
            ..Qos::default()
        };
        let reader = EntityId::of_app(1, 1, EntityKind::ReaderWithKey);
        let mut endpoints = Endpoints::new(OURS);
        endpoints.add_reader(ReaderConfig::new(Guid::new(OURS, reader), qos.clone()));
        let now = Instant::now();
        let taken = BTreeMap::new();
        Self {
            endpoints,
            now,
            reader,
            qos,
            taken,
        }
    }

    fn step(&mut self, operation: &Operation) {
        match *operation {
            Operation::Match { writer } => self.rematch(writer, true),
            Operation::Unmatch { writer } => self.rematch(writer, false),
            Operation::Take { max } => self.take(max.into()),
            Operation::Read { max } => {
                self.reader().read(max.into(), &Selection::not_read());
            }
            Operation::Wait { milliseconds } => {
                self.now += Duration::from_millis(milliseconds.into());
                self.endpoints.handle_timeout(self.now);
            }
            _ => self.receive(operation),
        }
    }

    fn reader(&mut self) -> &mut rtps_user::reader::Reader {
        self.endpoints.reader_mut(self.reader).expect("the reader")
    }

    fn rematch(&mut self, writer: u8, is_matched: bool) {
        let (guid, number) = writer_of(writer);
        self.endpoints.unmatch(self.now, self.reader, guid);
        self.take(usize::MAX);
        self.taken.remove(&guid);
        if is_matched {
            let remote = remote(guid, number, self.qos.clone());
            self.endpoints.match_remote(self.now, self.reader, &remote);
        }
    }

    /// What is taken is in the order of its writer, and never twice.
    fn take(&mut self, max: usize) {
        for Sample { info, .. } in self.reader().take(max, &Selection::default()) {
            if !info.valid_data {
                continue;
            }
            let before = self.taken.insert(info.writer, info.sequence);
            assert!(before.is_none_or(|before| before < info.sequence));
        }
    }

    fn receive(&mut self, operation: &Operation) {
        let Some((number, message)) = self.message(operation) else {
            return;
        };
        // What makes no sense is refused.
        let _ = self
            .endpoints
            .handle_datagram(self.now, address(number), message.bytes());
        assert!(self.reader().len() <= MOST_SAMPLES as usize * 2);
    }

    fn message(&self, operation: &Operation) -> Option<(u8, Message)> {
        let (kind, flags, writer, body) = match *operation {
            Operation::Data {
                writer,
                sequence: number,
                instance,
                status,
                flags,
                len,
            } => {
                let mut body = vec![0, 0, 16, 0];
                body.extend(self.address(writer));
                body.extend(sequence(number.from(0)));
                body.extend(inline_qos(instance, status));
                body.extend([0, 1, 0, 0]);
                body.extend(vec![0; len.into()]);
                (
                    SubmessageKind::DATA,
                    flags & 0x0c | FLAG_INLINE_QOS,
                    writer,
                    body,
                )
            }
            Operation::DataFrag {
                writer,
                sequence: number,
                first,
                count,
                size,
                sample_size,
                len,
            } => {
                let mut body = vec![0, 0, 28, 0];
                body.extend(self.address(writer));
                body.extend(sequence(number.from(0)));
                body.extend(first.to_le_bytes());
                body.extend(count.to_le_bytes());
                body.extend(size.to_le_bytes());
                body.extend(sample_size.to_le_bytes());
                body.extend(inline_qos(0, 0));
                body.extend(vec![0; len.into()]);
                let flags = FLAG_INLINE_QOS & !FLAG_DATA;
                (SubmessageKind::DATA_FRAG, flags, writer, body)
            }
            _ => return self.control(operation),
        };
        let (guid, number) = writer_of(writer);
        let message = Message::new(guid.prefix).submessage(kind, flags, &[&body]);
        Some((number, message))
    }

    fn control(&self, operation: &Operation) -> Option<(u8, Message)> {
        let (kind, flags, writer, body) = match *operation {
            Operation::Heartbeat {
                writer,
                first,
                last,
                count,
                flags,
            } => {
                let mut body = sequence(first.from(0)).to_vec();
                body.extend(sequence(last.from(0)));
                body.extend(i32::from(count).to_le_bytes());
                (SubmessageKind::HEARTBEAT, flags & 0x06, writer, body)
            }
            Operation::HeartbeatFrag {
                writer,
                sequence: number,
                last,
                count,
            } => {
                let mut body = sequence(number.from(0)).to_vec();
                body.extend(last.to_le_bytes());
                body.extend(i32::from(count).to_le_bytes());
                (SubmessageKind::HEARTBEAT_FRAG, 0, writer, body)
            }
            Operation::Gap {
                writer,
                start,
                base,
                count,
                members,
            } => {
                let mut body = sequence(start.from(0)).to_vec();
                body.extend(sequence_set(base.from(0), count, members));
                (SubmessageKind::GAP, 0, writer, body)
            }
            _ => return None,
        };
        let (guid, number) = writer_of(writer);
        let fields: [&[u8]; 2] = [&self.address(writer), &body];
        let message = Message::new(guid.prefix).submessage(kind, flags, &fields);
        Some((number, message))
    }

    fn address(&self, writer: u8) -> [u8; 8] {
        let (guid, _) = writer_of(writer);
        entities(self.reader, guid.entity)
    }
}

/// PID_KEY_HASH and PID_STATUS_INFO.
fn inline_qos(instance: u8, status: u8) -> Vec<u8> {
    let mut list = vec![0x70, 0, 16, 0];
    list.extend([instance % 4; 16]);
    list.extend([0x71, 0, 4, 0, 0, 0, 0, status & 7]);
    list.extend([1, 0, 0, 0]);
    list
}

fn writer_of(number: u8) -> (Guid, u8) {
    let number = number % 2 + 2;
    (remote_guid(number, EntityKind::WriterWithKey), number)
}

fuzz_target!(|scene: Scene| {
    let mut bench = Bench::new(&scene);
    for writer in 0..2 {
        bench.step(&Operation::Match { writer });
    }
    for operation in scene.operations.iter().take(500) {
        bench.step(operation);
        transmit(&mut bench.endpoints, bench.now);
        while bench.endpoints.poll_event().is_some() {}
    }
    bench.take(usize::MAX);
});
