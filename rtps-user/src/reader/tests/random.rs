//! Random sequences of whatever a network and a hostile writer can send.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::qos::{History, ResourceLimits};

#[derive(Clone, Debug)]
enum Operation {
    Data(i64),
    Dispose(i64),
    Fragment(i64, u32),
    Gap(i64, i64, Vec<i64>),
    Heartbeat(i64, i64, i32, bool),
    Wait(u64),
    Take(usize),
    Read(usize),
    Rematch,
    Liveliness,
}

fn number() -> impl Strategy<Value = i64> {
    prop_oneof![
        20 => 1..40i64,
        1 => prop::sample::select(vec![1 << 40, i64::MAX - 1, i64::MAX, 70_000]),
    ]
}

fn operation() -> impl Strategy<Value = Operation> {
    prop_oneof![
        8 => number().prop_map(Operation::Data),
        1 => number().prop_map(Operation::Dispose),
        4 => (number(), 1..5u32).prop_map(|(sequence, first)| Operation::Fragment(sequence, first)),
        2 => (number(), 0..9i64, prop::collection::vec(0..256i64, 0..4)).prop_map(
            |(start, length, members)| {
                let base = start.saturating_add(length).min(i64::MAX - 256);
                Operation::Gap(start.min(base), base, members.iter().map(|m| base + m).collect())
            }
        ),
        4 => (number(), 0..20i64, any::<i32>(), any::<bool>()).prop_map(
            |(first, length, count, is_final)| {
                Operation::Heartbeat(first, first.saturating_add(length - 1), count, is_final)
            }
        ),
        2 => (0..700u64).prop_map(Operation::Wait),
        2 => (0..9usize).prop_map(Operation::Take),
        1 => (0..9usize).prop_map(Operation::Read),
        1 => Just(Operation::Rematch),
        1 => Just(Operation::Liveliness),
    ]
}

fn qos() -> impl Strategy<Value = Qos> {
    (
        any::<bool>(),
        any::<bool>(),
        prop::option::of(1..4u32),
        prop::option::of(1..6u32),
        prop::option::of(1..3u32),
    )
        .prop_map(
            |(is_reliable, is_durable, depth, max_samples, max_instances)| {
                let base = if is_durable {
                    transient_local()
                } else {
                    reliable()
                };
                Qos {
                    reliability: if is_reliable {
                        Reliability::RELIABLE
                    } else {
                        Reliability::BestEffort
                    },
                    history: depth.map_or(History::KeepAll, History::KeepLast),
                    resource_limits: ResourceLimits {
                        max_samples,
                        max_instances,
                        max_samples_per_instance: None,
                    },
                    ..base
                }
            },
        )
}

impl Bench {
    fn run(&mut self, operation: &Operation) -> Vec<Sample> {
        let payload = [7; 350];
        match operation {
            Operation::Data(sequence) => {
                let instance = key((sequence % 3) as u8);
                self.sample(*sequence, instance, StatusInfo::default(), &payload[..8]);
            }
            Operation::Dispose(sequence) => {
                let status = StatusInfo {
                    disposed: true,
                    ..StatusInfo::default()
                };
                self.sample(*sequence, key((sequence % 3) as u8), status, &[]);
            }
            Operation::Fragment(sequence, first) => self.random_fragment(*sequence, *first),
            Operation::Gap(start, base, members) => self.gap(*start, *base, members),
            Operation::Heartbeat(first, last, count, is_final) => {
                self.heartbeat_with(*first, *last, *count, *is_final);
            }
            Operation::Wait(millis) => self.wait(*millis),
            Operation::Take(max) => return self.reader.take(*max, &Selection::default()),
            Operation::Read(max) => {
                self.reader.read(*max, &Selection::not_read());
            }
            Operation::Rematch => {
                let known = remote(self.writer, transient_local());
                self.reader.match_writer(self.now, &known);
            }
            Operation::Liveliness => {
                self.reader
                    .handle_liveliness(self.now, self.writer.prefix, true);
            }
        }
        Vec::new()
    }

    /// A fragment of 1000 bytes.
    fn kilobyte(&mut self, sequence: i64, first: u32, whole: &[u8]) {
        let start = (first as usize - 1) * 1000;
        let data = DataFrag {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(sequence),
            first_fragment: first,
            fragment_count: 1,
            fragment_size: 1000,
            sample_size: whole.len() as u32,
            inline_qos: InlineQos::default(),
            kind: PayloadKind::Data,
            payload: &whole[start..(start + 1000).min(whole.len())],
        };
        self.reader
            .handle_data_frag(self.now, self.writer, None, &data);
    }

    fn random_fragment(&mut self, sequence: i64, first: u32) {
        let fragment_size = 100;
        let start = (first - 1) * fragment_size;
        let data = DataFrag {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(sequence),
            first_fragment: first,
            fragment_count: 1,
            fragment_size: fragment_size as u16,
            sample_size: 350,
            inline_qos: InlineQos {
                key_hash: Some(key((sequence % 3) as u8)),
                ..InlineQos::default()
            },
            kind: PayloadKind::Data,
            payload: &[7; 100][..(350 - start).min(100) as usize],
        };
        self.reader
            .handle_data_frag(self.now, self.writer, None, &data);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn order_and_uniqueness_hold_whatever_comes(
        qos in qos(),
        operations in prop::collection::vec(operation(), 0..120),
    ) {
        let is_reliable = qos.reliability.is_reliable();
        let mut bench = Bench::new(qos, transient_local());
        let (mut sent, mut taken) = (BTreeSet::new(), Vec::new());
        for operation in &operations {
            match operation {
                Operation::Data(sequence)
                | Operation::Dispose(sequence)
                | Operation::Fragment(sequence, _) => {
                    sent.insert(*sequence);
                }
                _ => {}
            }
            let before = bench.progress();
            taken.extend(sequences(&bench.run(operation)));
            prop_assert!(bench.progress() >= before);
            for answer in bench.answers() {
                prop_assert!(is_reliable);
                check(&answer, bench.progress())?;
            }
            bench.events();
        }
        while bench.reader.has_matching(&Selection::default()) {
            taken.extend(bench.taken());
        }
        prop_assert!(taken.is_sorted_by(|a, b| a < b), "{:?}", taken);
        prop_assert!(taken.iter().all(|sequence| sent.contains(sequence)));
        prop_assert!(bench.reader.is_empty());
        prop_assert!(!bench.reader.has_data());
    }

    /// A writer that answers what it is asked makes everything arrive, whatever is lost on the way.
    #[test]
    fn everything_arrives_in_the_end(
        lost in prop::collection::vec(any::<bool>(), 0..400),
        written in 1..60i64,
    ) {
        let mut bench = Bench::new(reliable(), reliable());
        let mut lost = lost.into_iter();
        let mut arrives = || !lost.next().unwrap_or(false);
        for sequence in 1..=written {
            if arrives() {
                bench.data(sequence);
            }
        }
        let mut taken = Vec::new();
        for _ in 0..500 {
            bench.heartbeats += 1;
            if arrives() {
                bench.heartbeat_with(1, written, bench.heartbeats, false);
            }
            for answer in bench.answers() {
                let Answer::AckNack(_, missing, ..) = answer else {
                    continue;
                };
                for sequence in missing {
                    if arrives() {
                        bench.data(sequence);
                    }
                }
            }
            taken.extend(bench.taken());
            bench.wait(10);
        }
        prop_assert_eq!(taken, (1..=written).collect::<Vec<_>>());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same for samples in fragments, of which never more are asked for than find room.
    #[test]
    fn large_samples_arrive_in_the_end(
        lost in prop::collection::vec(prop::bool::weighted(0.3), 0..4000),
        written in 1..4i64,
    ) {
        const SIZE: usize = 200_000;
        let whole = vec![7; SIZE];
        let mut config = ReaderConfig::new(reader_guid(), reliable());
        config.timing.max_requested_bytes = 70_000;
        let mut bench = Bench::unmatched(config);
        bench.reader.match_writer(bench.now, &remote(bench.writer, reliable()));
        let mut lost = lost.into_iter();
        let mut arrives = || !lost.next().unwrap_or(false);
        let mut taken = Vec::new();
        let all = |sequence| (1..=SIZE.div_ceil(1000) as u32).map(move |first| (sequence, first));
        let mut due: Vec<(i64, u32)> = (1..=written).flat_map(all).collect();
        for _ in 0..200 {
            for (sequence, first) in due.drain(..) {
                if arrives() {
                    bench.kilobyte(sequence, first, &whole);
                }
            }
            bench.heartbeats += 1;
            if arrives() {
                bench.heartbeat_with(1, written, bench.heartbeats, false);
            }
            let mut asked = 0;
            for answer in bench.answers() {
                match answer {
                    Answer::AckNack(_, missing, ..) => {
                        asked += SIZE * missing.len().saturating_sub(1);
                        due.extend(missing.into_iter().flat_map(all));
                    }
                    Answer::NackFrag(sequence, missing, _) => {
                        asked += 1000 * missing.len();
                        due.extend(missing.into_iter().map(|first| (sequence, first)));
                    }
                }
            }
            prop_assert!(taken.is_empty() || asked <= 70_000, "{}", asked);
            taken.extend(bench.taken());
            bench.wait(1);
        }
        prop_assert_eq!(taken, (1..=written).collect::<Vec<_>>());
    }
}

/// What is acknowledged has been dealt with; what is asked for has not.
fn check(answer: &Answer, progress: i64) -> Result<(), TestCaseError> {
    match answer {
        Answer::AckNack(base, missing, ..) => {
            prop_assert!(*base <= progress);
            prop_assert!(missing.iter().all(|number| *number >= progress));
        }
        Answer::NackFrag(sequence, missing, _) => {
            prop_assert!(*sequence >= progress);
            prop_assert!(missing.iter().all(|number| (1..=4).contains(number)));
        }
    }
    Ok(())
}
