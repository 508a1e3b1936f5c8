//! Readers with any mixture of policies, given anything: nothing comes twice, nothing stays behind.

use std::collections::HashSet;
use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::qos::{
    Deadline, DestinationOrder, History, Lifespan, Ownership, Presentation, PresentationScope,
    ReaderDataLifecycle, ResourceLimits, TimeBasedFilter,
};
use crate::wire::GroupDigest;

#[derive(Clone, Debug)]
enum Operation {
    /// The next change of a writer, or one not before that: how many are left out; what it is; its set.
    Change(u8, i64, Kind, Option<i64>),
    Heartbeat(u8, i64),
    Wait(u64),
    Take(usize),
    Read(usize),
    Freeze,
    Thaw,
    Walk,
    Release,
    Filter(bool),
    Strength(u8, i32),
    Unmatch(u8),
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Data(u8, u32),
    Disposed(u8, u32),
    Unregistered(u8),
    End,
}

fn kind() -> impl Strategy<Value = Kind> {
    prop_oneof![
        6 => (0..3u8, 0..50u32).prop_map(|(instance, at)| Kind::Data(instance, at)),
        1 => (0..3u8, 0..50u32).prop_map(|(instance, at)| Kind::Disposed(instance, at)),
        1 => (0..3u8).prop_map(Kind::Unregistered),
        1 => Just(Kind::End),
    ]
}

fn operation() -> impl Strategy<Value = Operation> {
    let left_out = prop_oneof![4 => Just(0i64), 1 => 0..3i64];
    prop_oneof![
        12 => (1..3u8, left_out, kind(), prop::option::of(0..4i64))
            .prop_map(|(writer, skip, kind, set)| Operation::Change(writer, skip, kind, set)),
        3 => (1..3u8, 0..6i64).prop_map(|(writer, kept)| Operation::Heartbeat(writer, kept)),
        3 => (0..80u64).prop_map(Operation::Wait),
        3 => (0..5usize).prop_map(Operation::Take),
        1 => (0..5usize).prop_map(Operation::Read),
        1 => Just(Operation::Freeze),
        1 => Just(Operation::Thaw),
        1 => Just(Operation::Walk),
        1 => Just(Operation::Release),
        1 => any::<bool>().prop_map(Operation::Filter),
        1 => (1..3u8, 0..3i32).prop_map(|(writer, force)| Operation::Strength(writer, force)),
        1 => (1..3u8).prop_map(Operation::Unmatch),
    ]
}

fn duration() -> impl Strategy<Value = wire::Duration> {
    prop_oneof![Just(wire::Duration::INFINITE), (1..100u64).prop_map(millis)]
}

fn qos() -> impl Strategy<Value = Qos> {
    let kinds = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    let limits = (
        prop::option::of(1..3u32),
        prop::option::of(2..6u32),
        prop::option::of(1..3u32),
        prop::option::of(1..3u32),
    );
    let times = (duration(), duration(), duration(), duration(), 0..50u64);
    (kinds, limits, times, 0..3usize).prop_map(|(kinds, limits, times, scope)| Qos {
        reliability: match kinds.0 {
            true => Reliability::RELIABLE,
            false => Reliability::BestEffort,
        },
        ownership: match kinds.1 {
            true => Ownership::Exclusive { strength: 0 },
            false => Ownership::Shared,
        },
        destination_order: match kinds.2 {
            true => DestinationOrder::BySourceTimestamp,
            false => DestinationOrder::ByReceptionTimestamp,
        },
        presentation: Presentation {
            scope: [
                PresentationScope::Instance,
                PresentationScope::Topic,
                PresentationScope::Group,
            ][scope],
            coherent: kinds.3,
            ordered: kinds.2,
        },
        history: limits.0.map_or(History::KeepAll, History::KeepLast),
        resource_limits: ResourceLimits {
            max_samples: limits.1,
            max_instances: limits.2,
            max_samples_per_instance: limits.3,
        },
        deadline: Deadline(times.0),
        lifespan: Lifespan(times.1),
        reader_data_lifecycle: ReaderDataLifecycle {
            autopurge_nowriter_samples_delay: times.2,
            autopurge_disposed_samples_delay: times.3,
        },
        time_based_filter: TimeBasedFilter(millis(times.4)),
        ..Qos::default()
    })
}

/// A reader with two writers, and the number that each uses next.
struct Stage {
    bench: Bench,
    qos: Qos,
    next: [i64; 3],
    matched: [bool; 3],
}

impl Stage {
    fn new(qos: Qos) -> Self {
        let mut bench = Bench::unmatched(ReaderConfig::new(reader_guid(), qos.clone()));
        bench.reader.stage_groups();
        for index in [1, 2] {
            bench.switch_to(index, qos.clone());
            bench.heartbeat(1, 0);
        }
        Self {
            bench,
            qos,
            next: [1; 3],
            matched: [true; 3],
        }
    }

    fn run(&mut self, operation: &Operation) -> Vec<Sample> {
        let reader = &mut self.bench.reader;
        match *operation {
            Operation::Change(writer, skip, kind, set) => self.change(writer, skip, kind, set),
            Operation::Heartbeat(index, kept) => {
                self.bench.writer = writer(index);
                let last = self.next[usize::from(index)] - 1;
                self.bench.heartbeat((last - kept).max(1), last);
            }
            Operation::Wait(millis) => self.bench.wait(millis),
            Operation::Take(max) => return reader.take(max, &Selection::default()),
            Operation::Read(max) => drop(reader.read(max, &Selection::not_read())),
            Operation::Freeze => reader.freeze(),
            Operation::Thaw => reader.thaw(),
            Operation::Walk => return self.walk(),
            Operation::Release => self.release(),
            Operation::Filter(is_on) => {
                let odd: PayloadFilter = Arc::new(|_, payload| payload.len() % 2 == 1);
                reader.set_content_filter(is_on.then_some(odd), None);
            }
            Operation::Strength(index, strength) => {
                if self.matched[usize::from(index)] {
                    let ownership = Ownership::Exclusive { strength };
                    let changed = Qos {
                        ownership,
                        ..self.qos.clone()
                    };
                    self.bench.switch_to(index, changed);
                }
            }
            Operation::Unmatch(index) => {
                reader.unmatch_writer(self.bench.now, writer(index));
                self.matched[usize::from(index)] = false;
            }
        }
        Vec::new()
    }

    fn change(&mut self, index: u8, skip: i64, kind: Kind, set: Option<i64>) {
        let next = &mut self.next[usize::from(index)];
        let sequence = *next + skip;
        *next = sequence + 1;
        let number = |sequence: i64| Some(SequenceNumber(sequence.max(1)));
        let (instance, at, status, payload): (u8, u32, StatusInfo, &[u8]) = match kind {
            Kind::Data(instance, at) => (instance, at, ALIVE, &b"data!"[..4 + at as usize % 2]),
            Kind::Disposed(instance, at) => (instance, at, DISPOSED, b""),
            Kind::Unregistered(instance) => (instance, 0, UNREGISTERED, b""),
            Kind::End => (0, 0, ALIVE, b""),
        };
        let inline_qos = InlineQos {
            key_hash: Some(key(instance)),
            status,
            coherent_set: match kind {
                Kind::End => Some(SequenceNumber::UNKNOWN),
                _ => set.and_then(|before| number(sequence - before)),
            },
            group_sequence: number(sequence),
            group_coherent_set: set.and_then(|before| number(sequence - before)),
            writer_group: Some(GroupDigest([7; 4])),
            ..InlineQos::default()
        };
        let kind = match payload.is_empty() {
            true => PayloadKind::None,
            false => PayloadKind::Data,
        };
        self.bench.writer = writer(index);
        self.bench.timestamp = (at > 5).then_some(Timestamp {
            seconds: at,
            fraction: 0,
        });
        self.bench.submit(sequence, inline_qos, kind, payload);
    }

    /// Takes the samples of each instance in turn.
    fn walk(&mut self) -> Vec<Sample> {
        let (mut samples, mut previous) = (Vec::new(), None);
        let any = Selection::default();
        while let Some(instance) = self.bench.reader.next_instance(previous, &any) {
            assert!(Some(instance) > previous);
            let of_instance = Selection {
                instance: Some(instance),
                ..any
            };
            let taken = self.bench.reader.take(9, &of_instance);
            assert!(!taken.is_empty());
            samples.extend(taken);
            previous = Some(instance);
        }
        samples
    }

    fn release(&mut self) {
        let staged: Vec<GroupSet> = self.bench.reader.staged_groups().collect();
        for set in staged {
            self.bench.reader.release_group(&set);
        }
    }

    /// Ends all that there is, and takes what comes of it.
    fn finish(&mut self) -> Vec<Sample> {
        self.bench.reader.thaw();
        let mut samples = Vec::new();
        for _ in 0..100 {
            self.release();
            samples.extend(self.bench.take());
            self.bench.wait(50);
        }
        for index in [1, 2] {
            let (now, writer) = (self.bench.now, writer(index));
            self.bench.reader.unmatch_writer(now, writer);
        }
        self.release();
        samples.extend(self.bench.take());
        samples
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn nothing_comes_twice_and_nothing_stays(
        qos in qos(),
        operations in prop::collection::vec(operation(), 0..100),
    ) {
        let limits = qos.resource_limits;
        let mut stage = Stage::new(qos);
        let mut taken = Vec::new();
        for operation in &operations {
            taken.extend(stage.run(operation));
            stage.bench.answers();
            let cache = &stage.bench.reader.cache;
            if let Some(max) = limits.max_samples {
                prop_assert!(cache.valid_count + cache.staged <= max as usize);
            }
            if let Some(max) = limits.max_instances {
                prop_assert!(cache.instances.len() <= max as usize);
            }
        }
        taken.extend(stage.finish());
        let with_data = taken.iter().filter(|sample| sample.info.valid_data);
        let mut seen = HashSet::new();
        for Sample { info, .. } in with_data {
            prop_assert!(seen.insert((info.writer, info.sequence)), "{:?}", info);
        }
        let reader = &stage.bench.reader;
        prop_assert!(reader.is_empty() && !reader.has_data());
        prop_assert_eq!((reader.cache.valid_count, reader.cache.staged), (0, 0));
    }
}
