//! DESTINATION_ORDER BY_SOURCE_TIMESTAMP: the order of writing, whatever that of arrival.

use proptest::prelude::*;

use super::*;
use crate::qos::{DestinationOrder, History, Presentation, PresentationScope};

fn ordered() -> Qos {
    Qos {
        destination_order: DestinationOrder::BySourceTimestamp,
        ..reliable()
    }
}

fn bench(reader: Qos) -> Bench {
    let mut bench = Bench::unmatched(ReaderConfig::new(reader_guid(), reader));
    for index in [2, 1] {
        bench.switch_to(index, ordered());
    }
    bench
}

impl Bench {
    /// The writer `index` wrote its `sequence`-th change at that second.
    fn written(
        &mut self,
        (index, sequence): (u8, i64),
        seconds: u32,
        instance: u8,
        status: StatusInfo,
    ) {
        self.writer = writer(index);
        self.timestamp = Some(Timestamp {
            seconds,
            fraction: 0,
        });
        let payload: &[u8] = if status.is_alive() { b"data" } else { b"" };
        self.sample(sequence, key(instance), status, payload);
    }

    fn seconds(&mut self) -> Vec<u32> {
        let samples = self.take().into_iter();
        samples
            .map(|sample| sample.info.source_timestamp.unwrap().seconds)
            .collect()
    }
}

#[test]
fn samples_stand_in_the_order_of_writing() {
    let mut bench = bench(ordered());
    bench.written((1, 1), 10, 1, ALIVE);
    bench.written((1, 2), 30, 1, ALIVE);
    bench.written((2, 1), 20, 1, ALIVE);
    bench.written((2, 2), 25, 1, ALIVE);
    assert_eq!(bench.seconds(), [10, 20, 25, 30]);
    bench.written((2, 3), 29, 1, ALIVE);
    assert!(bench.seconds().is_empty(), "the reader knows better");
    bench.written((2, 4), 31, 1, ALIVE);
    assert_eq!(bench.seconds(), [31]);
    assert_eq!(bench.progress(), 5);
}

#[test]
fn what_has_been_read_is_not_preceded() {
    let mut bench = bench(ordered());
    bench.written((1, 1), 10, 1, ALIVE);
    bench.reader.read(9, &Selection::default());
    bench.written((1, 2), 20, 1, ALIVE);
    bench.written((2, 1), 5, 1, ALIVE);
    bench.written((2, 2), 15, 1, ALIVE);
    assert_eq!(bench.seconds(), [10, 15, 20]);
}

#[test]
fn history_keeps_what_was_written_last() {
    let mut bench = bench(Qos {
        history: History::KeepLast(2),
        ..ordered()
    });
    bench.written((1, 1), 10, 1, ALIVE);
    bench.written((1, 2), 30, 1, ALIVE);
    bench.written((2, 1), 5, 1, ALIVE);
    bench.written((2, 2), 20, 1, ALIVE);
    bench.written((2, 3), 15, 1, ALIVE);
    assert_eq!(bench.seconds(), [20, 30]);
}

#[test]
fn the_state_is_that_of_the_newest_change() {
    let mut bench = bench(ordered());
    bench.written((1, 1), 20, 1, ALIVE);
    bench.written((2, 1), 10, 1, DISPOSED);
    let samples = bench.take();
    assert_eq!(samples.len(), 1);
    assert_eq!(samples[0].info.instance_state, InstanceState::Alive);
    bench.written((1, 2), 40, 1, DISPOSED);
    bench.written((2, 2), 30, 1, ALIVE);
    let samples = bench.take();
    assert_eq!(sequences(&samples), [2, 2]);
    assert!(samples[0].info.valid_data && !samples[1].info.valid_data);
    let state = samples[1].info.instance_state;
    assert_eq!(state, InstanceState::NotAliveDisposed);
}

#[test]
fn writers_of_one_moment_are_told_apart() {
    for order in [[1, 2], [2, 1]] {
        let mut bench = bench(Qos {
            history: History::KeepLast(1),
            ..ordered()
        });
        for index in order {
            bench.written((index, 1), 10, 1, ALIVE);
        }
        assert_eq!(bench.take()[0].info.writer, writer(2));
    }
}

#[test]
fn the_order_can_span_instances() {
    let presentation = Presentation {
        scope: PresentationScope::Topic,
        coherent: false,
        ordered: true,
    };
    for (presentation, expected) in [
        (presentation, [10, 20, 30]),
        (Presentation::default(), [10, 30, 20]),
    ] {
        let mut bench = bench(Qos {
            presentation,
            ..ordered()
        });
        bench.written((1, 1), 10, 1, ALIVE);
        bench.written((1, 2), 30, 1, ALIVE);
        bench.written((2, 1), 20, 2, ALIVE);
        assert_eq!(bench.seconds(), expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn the_last_value_does_not_depend_on_the_order_of_arrival(
        changes in prop::collection::vec((1..=2u8, 0..20u32, 0..3u8, any::<bool>()), 1..40),
        swaps in prop::collection::vec(any::<bool>(), 40),
        takes in prop::collection::vec(prop::bool::weighted(0.2), 40),
    ) {
        let run = |swapped: bool| {
            let mut bench = bench(Qos { history: History::KeepLast(1), ..ordered() });
            let mut changes = changes.clone();
            changes.sort_by_key(|change| change.1);
            // Each writer's own changes stay in order.
            for (index, swap) in swaps.iter().enumerate().take(changes.len() - 1) {
                if swapped && *swap && changes[index].0 != changes[index + 1].0 {
                    changes.swap(index, index + 1);
                }
            }
            let (mut next, mut last) = ([1; 3], std::collections::BTreeMap::new());
            for (index, (author, seconds, instance, disposes)) in changes.iter().enumerate() {
                let number = &mut next[usize::from(*author)];
                let status = if *disposes { DISPOSED } else { ALIVE };
                bench.written((*author, *number), *seconds, *instance, status);
                *number += 1;
                if takes[index] || index + 1 == changes.len() {
                    for sample in bench.take() {
                        let state = sample.info.instance_state;
                        let is_alive = state == InstanceState::Alive;
                        let value = is_alive.then_some(sample.info.writer);
                        last.insert(sample.info.instance, (state, value));
                    }
                }
            }
            last
        };
        prop_assert_eq!(run(false), run(true));
    }
}
