//! What a reader shows with policies that choose: coherent sets, owners, the order of writing, the last value.

use std::collections::BTreeMap;
use std::time::Duration;

use rtps_user::qos::{
    DestinationOrder, Durability, History, Ownership, Presentation, PresentationScope, Qos,
    Reliability, TimeBasedFilter,
};
use rtps_user::reader::Sample;
use rtps_user::wire::{self, EntityKind, Guid, KeyHash, Timestamp};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{number, sample};

fn reliable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn coherent() -> Qos {
    Qos {
        presentation: Presentation {
            scope: PresentationScope::Topic,
            coherent: true,
            ordered: true,
        },
        ..reliable()
    }
}

/// Writes `sets` sets of the sizes 1 to 7, in turn; sample `1000 * set + index`.
fn write_sets(network: &mut Network, writer: Guid, sets: u32) {
    for set in 1..=sets {
        network.writer(writer).begin_coherent();
        for index in 0..size(set) {
            let key = (index % 3) as u8;
            network.write_blocking(writer, sample(1000 * set + index, key, 100));
            let pause = network.random.up_to(Duration::from_millis(1));
            network.run_for(pause);
        }
        network.writer(writer).end_coherent(Timestamp::default());
    }
}

fn size(set: u32) -> u32 {
    1 + set % 7
}

/// How many samples of each set there are.
fn sizes(samples: &[Sample]) -> BTreeMap<u32, u32> {
    let mut sizes = BTreeMap::new();
    for sample in samples.iter().filter(|sample| sample.info.valid_data) {
        *sizes.entry(number(&sample.payload) / 1000).or_default() += 1;
    }
    sizes
}

#[test]
fn reliable_sets_arrive_whole() {
    for seed in seeds(20) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, coherent());
        let reader = network.add_reader(EntityKind::ReaderWithKey, coherent());
        network.connect(writer, reader);
        for _ in 0..5 {
            write_sets(&mut network, writer, 6);
            for (set, count) in sizes(&network.take(reader)) {
                assert_eq!(count % size(set), 0, "set {set} is torn");
            }
        }
        network.run_until_acknowledged(writer);
        network.take(reader);
        write_sets(&mut network, writer, 30);
        network.run_until_acknowledged(writer);
        let expected: BTreeMap<u32, u32> = (1..=30).map(|set| (set, size(set))).collect();
        assert_eq!(sizes(&network.take(reader)), expected);
    }
}

#[test]
fn best_effort_and_late_readers_see_whole_sets_or_none() {
    for seed in seeds(20) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let durable = Qos {
            durability: Durability::TransientLocal,
            ..coherent()
        };
        let writer = network.add_writer(EntityKind::WriterWithKey, durable.clone());
        let best_effort = Qos {
            reliability: Reliability::BestEffort,
            ..coherent()
        };
        let hasty = network.add_reader(EntityKind::ReaderWithKey, best_effort);
        network.connect(writer, hasty);
        write_sets(&mut network, writer, 20);
        let late = network.add_reader(EntityKind::ReaderWithKey, durable);
        network.connect(writer, late);
        network.writer(writer).begin_coherent();
        network.write_blocking(writer, sample(21_000, 0, 100));
        network.run_until_acknowledged(writer);
        let seen = sizes(&network.take(hasty));
        assert!(seen.iter().all(|(set, count)| *count == size(*set)));
        let seen = sizes(&network.take(late));
        let expected: BTreeMap<u32, u32> = (1..=20).map(|set| (set, size(set))).collect();
        assert_eq!(seen, expected, "the last one is still open");
    }
}

/// A writer of coherent sets, and readers that come and go.
struct Audience {
    network: Network,
    writer: Guid,
    readers: [Guid; 2],
    is_matched: [bool; 2],
    /// How large the sets are that have ended.
    ended: Vec<u32>,
    /// The size of the open one.
    open: u32,
}

impl Audience {
    fn new(seed: u64) -> Self {
        let qos = Qos {
            durability: Durability::TransientLocal,
            ..coherent()
        };
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, qos.clone());
        let readers = [(); 2].map(|()| network.add_reader(EntityKind::ReaderWithKey, qos.clone()));
        Self {
            network,
            writer,
            readers,
            is_matched: [false; 2],
            ended: Vec::new(),
            open: 0,
        }
    }

    fn step(&mut self) {
        let index = self.network.random.below(2) as usize;
        match self.network.random.below(20) {
            0 => self.toggle_match(index),
            1..=3 => self.end_set(),
            4..=6 => self.take(index),
            7..=9 => {
                let pause = self.network.random.up_to(Duration::from_millis(5));
                self.network.run_for(pause);
            }
            _ => self.write(),
        }
    }

    fn toggle_match(&mut self, index: usize) {
        if self.is_matched[index] {
            self.network.disconnect(self.writer, self.readers[index]);
            self.take(index);
        } else {
            self.network.connect(self.writer, self.readers[index]);
        }
        self.is_matched[index] = !self.is_matched[index];
    }

    fn end_set(&mut self) {
        self.network
            .writer(self.writer)
            .end_coherent(Timestamp::default());
        if self.open > 0 {
            self.ended.push(self.open);
            self.open = 0;
        }
    }

    fn write(&mut self) {
        self.network.writer(self.writer).begin_coherent();
        let number = 1000 * self.ended.len() as u32 + self.open;
        self.open += 1;
        let key = self.network.random.below(4) as u8;
        self.network
            .write_blocking(self.writer, sample(number, key, 100));
    }

    fn take(&mut self, index: usize) {
        let samples = self.network.take(self.readers[index]);
        for (set, count) in sizes(&samples) {
            assert_eq!(self.ended.get(set as usize), Some(&count), "set {set}");
        }
    }

    /// What somebody sees who comes at last.
    fn all(&mut self) -> BTreeMap<u32, u32> {
        for index in 0..2 {
            if self.is_matched[index] {
                self.toggle_match(index);
            }
        }
        self.toggle_match(0);
        self.network.run_until_acknowledged(self.writer);
        sizes(&self.network.take(self.readers[0]))
    }
}

#[test]
fn readers_that_come_and_go_see_whole_sets_alone() {
    for seed in seeds(12) {
        let mut audience = Audience::new(seed);
        for _ in 0..1000 {
            audience.step();
        }
        audience.end_set();
        let expected: BTreeMap<u32, u32> = (0..).zip(audience.ended.iter().copied()).collect();
        assert_eq!(audience.all(), expected);
    }
}

/// The last value of each instance that a reader has shown.
type Values = BTreeMap<KeyHash, u32>;

fn note(values: &mut Values, samples: &[Sample]) {
    for sample in samples {
        values.insert(sample.info.instance, number(&sample.payload));
    }
}

#[test]
fn all_readers_end_with_the_value_that_was_written_last() {
    for seed in seeds(20) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let qos = Qos {
            destination_order: DestinationOrder::BySourceTimestamp,
            history: History::KeepLast(1),
            ..reliable()
        };
        let writers = [(); 3].map(|()| network.add_writer(EntityKind::WriterWithKey, qos.clone()));
        let readers = [(); 3].map(|()| network.add_reader(EntityKind::ReaderWithKey, qos.clone()));
        for writer in writers {
            for reader in readers {
                network.connect(writer, reader);
            }
        }
        let mut shown = [(); 3].map(|()| Values::new());
        let mut written = Values::new();
        for number in 1..=300 {
            let writer = writers[network.random.below(3) as usize];
            let change = sample(number, (number % 4) as u8, 100);
            written.insert(change.instance, number);
            network.write_blocking(writer, change);
            let pause = network.random.up_to(Duration::from_millis(1));
            network.run_for(pause);
            let reader = network.random.below(3) as usize;
            note(&mut shown[reader], &network.take(readers[reader]));
        }
        for writer in writers {
            network.run_until_acknowledged(writer);
        }
        for (reader, values) in readers.into_iter().zip(&mut shown) {
            note(values, &network.take(reader));
            assert_eq!(*values, written);
        }
    }
}

#[test]
fn the_strongest_writer_is_heard_and_the_next_when_it_goes() {
    for seed in seeds(10) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let exclusive = |strength| Qos {
            ownership: Ownership::Exclusive { strength },
            ..reliable()
        };
        let weak = network.add_writer(EntityKind::WriterWithKey, exclusive(1));
        let strong = network.add_writer(EntityKind::WriterWithKey, exclusive(2));
        let reader = network.add_reader(EntityKind::ReaderWithKey, exclusive(0));
        for writer in [weak, strong] {
            network.connect(writer, reader);
            network.write_blocking(writer, sample(1, 1, 100));
            network.run_until_acknowledged(writer);
        }
        network.take(reader);
        for number in 2..=50 {
            network.write_blocking(weak, sample(number, 1, 100));
            network.write_blocking(strong, sample(number, 1, 100));
        }
        network.run_until_acknowledged(weak);
        network.run_until_acknowledged(strong);
        let authors: Vec<Guid> = network.take(reader).iter().map(|s| s.info.writer).collect();
        assert_eq!(authors, [strong; 49]);
        network.disconnect(strong, reader);
        network.write_blocking(weak, sample(51, 1, 100));
        network.run_until_acknowledged(weak);
        let samples = network.take(reader);
        assert_eq!(samples.len(), 1);
        assert_eq!(samples[0].info.writer, weak);
    }
}

#[test]
fn a_filter_in_time_lets_the_last_value_through() {
    for seed in seeds(10) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, reliable());
        let separation = Duration::from_millis(50);
        let reader = network.add_reader(
            EntityKind::ReaderWithKey,
            Qos {
                time_based_filter: TimeBasedFilter(wire::Duration::from_std(separation)),
                ..reliable()
            },
        );
        network.connect(writer, reader);
        for number in 1..=200 {
            network.write_blocking(writer, sample(number, (number % 2) as u8, 100));
            network.run_for(Duration::from_millis(5));
        }
        network.run_until_acknowledged(writer);
        network.run_for(Duration::from_secs(1));
        let samples = network.take(reader);
        let mut values = Values::new();
        note(&mut values, &samples);
        assert_eq!(values.into_values().collect::<Vec<_>>(), [200, 199]);
        // About a second at 50 ms for each of two instances.
        assert!(samples.len() <= 60, "{}", samples.len());
    }
}
