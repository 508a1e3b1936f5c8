//! A reader that is read from while two writers send it whatever they like.

#![no_main]

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use rtps_fuzz::{
    MOST_SAMPLES, Message, Number, OURS, Policies, address, entities, remote, remote_guid,
    sequence, sequence_set, transmit,
};
use rtps_user::endpoints::Endpoints;
use rtps_user::filter::PayloadFilter;
use rtps_user::reader::{ReaderConfig, Sample, Selection};
use rtps_user::wire::{EntityId, EntityKind, Guid, SequenceNumber, SubmessageKind};

const FLAG_INLINE_QOS: u8 = 2;
const FLAG_DATA: u8 = 4;

#[derive(Arbitrary, Debug)]
struct Scene {
    policies: Policies,
    operations: Vec<Operation>,
}

#[derive(Arbitrary, Debug)]
enum Operation {
    Match {
        writer: u8,
        policies: Policies,
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
        set: Set,
        timestamp: Option<u8>,
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
    /// Each sample of one instance after the other.
    Walk,
    Freeze,
    Thaw,
    StageGroups,
    ReleaseGroups,
    /// The reader wants payloads of certain lengths only.
    Filter {
        divisor: Option<u8>,
    },
    Wait {
        milliseconds: u16,
    },
}

/// Where a change belongs.
#[derive(Arbitrary, Clone, Copy, Debug)]
struct Set {
    first: Option<Number>,
    group_sequence: Option<Number>,
    group_first: Option<Number>,
    writers: Option<[u8; 4]>,
    lifespan: Option<[u8; 8]>,
}

impl Set {
    fn inline_qos(&self, list: &mut Vec<u8>) {
        let numbers = [
            (0x56, self.first),
            (0x64, self.group_sequence),
            (0x63, self.group_first),
        ];
        for (id, number) in numbers {
            if let Some(number) = number {
                list.extend([id, 0, 8, 0]);
                list.extend(sequence(number.from(0)));
            }
        }
        if let Some(writers) = self.writers {
            list.extend([0x65, 0, 4, 0]);
            list.extend(writers);
        }
        if let Some(lifespan) = self.lifespan {
            list.extend([0x2b, 0, 8, 0]);
            list.extend(lifespan);
        }
    }
}

struct Bench {
    endpoints: Endpoints,
    now: Instant,
    reader: EntityId,
    policies: Policies,
    /// The samples of each writer that were taken since it was matched.
    taken: BTreeMap<Guid, BTreeSet<SequenceNumber>>,
}

impl Bench {
    fn new(scene: &Scene) -> Self {
        let reader = EntityId::of_app(1, 1, EntityKind::ReaderWithKey);
        let mut endpoints = Endpoints::new(OURS);
        let qos = scene.policies.qos();
        endpoints.add_reader(ReaderConfig::new(Guid::new(OURS, reader), qos));
        let now = Instant::now();
        let taken = BTreeMap::new();
        Self {
            endpoints,
            now,
            reader,
            policies: scene.policies,
            taken,
        }
    }

    fn step(&mut self, operation: &Operation) {
        match *operation {
            Operation::Match { writer, policies } => self.rematch(writer, Some(policies)),
            Operation::Unmatch { writer } => self.rematch(writer, None),
            Operation::Walk => self.walk(),
            Operation::Freeze => self.reader().freeze(),
            Operation::Thaw => self.reader().thaw(),
            Operation::StageGroups => {
                self.reader().stage_groups();
            }
            Operation::ReleaseGroups => {
                let groups: Vec<_> = self.reader().staged_groups().collect();
                let reader = self.reader();
                groups.iter().for_each(|set| reader.release_group(set));
            }
            Operation::Filter { divisor } => {
                let filter = divisor.map(|divisor| -> PayloadFilter {
                    Arc::new(move |_, payload| payload.len() % (usize::from(divisor) + 1) == 0)
                });
                self.reader().set_content_filter(filter, None);
            }
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

    fn rematch(&mut self, writer: u8, policies: Option<Policies>) {
        let (guid, number) = writer_of(writer);
        self.endpoints.unmatch(self.now, self.reader, guid);
        self.reader().thaw();
        self.step(&Operation::ReleaseGroups);
        self.take(usize::MAX);
        self.taken.remove(&guid);
        if let Some(policies) = policies {
            let remote = remote(guid, number, policies.qos());
            self.endpoints.match_remote(self.now, self.reader, &remote);
        }
    }

    /// What is taken is in the order of its writer, unless policies say otherwise, and never twice.
    fn take(&mut self, max: usize) {
        for Sample { info, .. } in self.reader().take(max, &Selection::default()) {
            if !info.valid_data {
                continue;
            }
            let taken = self.taken.entry(info.writer).or_default();
            if self.policies.keeps_order() {
                assert!(taken.last().is_none_or(|last| *last < info.sequence));
            }
            assert!(taken.insert(info.sequence), "twice");
        }
    }

    /// No instance comes twice, however many there are.
    fn walk(&mut self) {
        let mut previous = None;
        while let Some(instance) = self
            .reader()
            .next_instance(previous, &Selection::not_read())
        {
            assert!(previous < Some(instance));
            let selection = Selection {
                instance: Some(instance),
                ..Selection::not_read()
            };
            assert!(!self.reader().read(usize::MAX, &selection).is_empty());
            previous = Some(instance);
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
        let is_limited = self.policies.is_limited();
        assert!(!is_limited || self.reader().len() <= MOST_SAMPLES as usize * 2);
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
                set,
                timestamp: _,
            } => {
                let mut body = vec![0, 0, 16, 0];
                body.extend(self.address(writer));
                body.extend(sequence(number.from(0)));
                body.extend(inline_qos(instance, status, Some(set)));
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
                body.extend(inline_qos(0, 0, None));
                body.extend(vec![0; len.into()]);
                let flags = FLAG_INLINE_QOS & !FLAG_DATA;
                (SubmessageKind::DATA_FRAG, flags, writer, body)
            }
            _ => return self.control(operation),
        };
        let (guid, number) = writer_of(writer);
        let mut message = Message::new(guid.prefix);
        if let Operation::Data {
            timestamp: Some(seconds),
            ..
        } = *operation
        {
            let seconds = u32::from(seconds).to_le_bytes();
            message = message.submessage(SubmessageKind::INFO_TS, 0, &[&seconds, &[0; 4]]);
        }
        Some((number, message.submessage(kind, flags, &[&body])))
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
fn inline_qos(instance: u8, status: u8, set: Option<Set>) -> Vec<u8> {
    let mut list = vec![0x70, 0, 16, 0];
    list.extend([instance % 4; 16]);
    list.extend([0x71, 0, 4, 0, 0, 0, 0, status & 7]);
    if let Some(set) = set {
        set.inline_qos(&mut list);
    }
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
        let policies = scene.policies;
        bench.step(&Operation::Match { writer, policies });
    }
    for operation in scene.operations.iter().take(500) {
        bench.step(operation);
        transmit(&mut bench.endpoints, bench.now);
        while bench.endpoints.poll_event().is_some() {}
    }
    bench.step(&Operation::Thaw);
    bench.step(&Operation::ReleaseGroups);
    bench.take(usize::MAX);
});
