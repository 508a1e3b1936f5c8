//! A million samples through a network that loses 30 % of all datagrams, reorders and doubles others, between writers and
//! readers that come, go and are restarted.
//!
//! What must hold, whatever happens: samples of one writer arrive in order and once; a reliable KEEP_ALL reader misses none
//! that was written while both lived; KEEP_LAST ends in the same state everywhere; a coherent set arrives as a whole or not
//! at all.

mod expectation;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use rtps_user::filter::PayloadFilter;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::qos::{
    Durability, DurabilityService, History, Presentation, PresentationScope, Qos, Reliability,
    ResourceLimits,
};
use rtps_user::reader::Sample;
use rtps_user::wire::{EntityKind, FilterSignature, Guid, KeyHash, PayloadKind, Timestamp};
use rtps_user::writer::Writer;

use crate::network::{Conditions, Network};
use crate::random::{Random, seeds};
use crate::sample::{not_alive, number, sample};
use expectation::Expectation;

/// Instances of each writer, which no other writes.
const INSTANCES: u64 = 6;
const MAX_BURST: u64 = 60;

/// A writer, as the test knows it.
struct Writing {
    guid: Guid,
    /// Its key numbers begin here.
    first_key: u8,
    written: u32,
    /// Its last restart came after that number.
    restarted_after: u32,
    /// The last sample of each instance that is alive and was written since the restart.
    newest: BTreeMap<KeyHash, u32>,
    /// The set of each number, by the number it begins with; 0 without set.
    sets: Vec<u32>,
}

/// A reader, as the test knows it.
struct Reading {
    guid: Guid,
    is_matched: bool,
    /// What it may expect of each writer.
    expected: BTreeMap<Guid, Expectation>,
    /// The last sample of each instance.
    newest: BTreeMap<KeyHash, u32>,
    /// It wants the multiples of this number.
    every: u32,
}

struct Run {
    network: Network,
    qos: Qos,
    writers: Vec<Writing>,
    readers: Vec<Reading>,
    /// Whether readers want only some numbers.
    is_filtered: bool,
    /// Whether readers have room for less than a burst.
    is_limited: bool,
    received: usize,
}

impl Run {
    fn new(seed: u64, qos: Qos, limits: ResourceLimits) -> Self {
        let mut network = Network::new(Conditions::AWFUL, seed);
        network.conditions.jitter = network.random.up_to(Duration::from_millis(4));
        let writers = 1 + network.random.below(3);
        let readers = 2 + network.random.below(3);
        let writers = (0..writers).map(|index| Writing {
            guid: network.add_writer(EntityKind::WriterWithKey, qos.clone()),
            first_key: (index * INSTANCES) as u8,
            written: 0,
            restarted_after: 0,
            newest: BTreeMap::new(),
            sets: vec![0],
        });
        let writers: Vec<_> = writers.collect();
        let reader_qos = Qos {
            resource_limits: limits,
            ..qos.clone()
        };
        let readers = (0..readers).map(|_| Reading {
            guid: network.add_reader(EntityKind::ReaderWithKey, reader_qos.clone()),
            is_matched: false,
            expected: BTreeMap::new(),
            newest: BTreeMap::new(),
            every: 1,
        });
        let readers = readers.collect();
        Self {
            network,
            qos,
            writers,
            readers,
            is_filtered: false,
            is_limited: limits != ResourceLimits::default(),
            received: 0,
        }
    }

    /// Goes on until so many samples have been received.
    fn run(&mut self, samples: usize) {
        while self.received < samples {
            self.step();
        }
        self.settle();
    }

    fn step(&mut self) {
        match self.network.random.below(1000) {
            0..6 => self.restart_writer(),
            6..30 => self.toggle_reader(),
            30..60 => self.dispose(),
            60..300 => self.take_all(),
            300..550 => {
                let pause = self.network.random.up_to(Duration::from_millis(5));
                self.network.run_for(pause);
            }
            _ => self.write(),
        }
    }

    fn pick_writer(&mut self) -> usize {
        self.network.random.below(self.writers.len() as u64) as usize
    }

    fn write(&mut self) {
        // Nobody takes while a writer waits for room.
        self.make_room();
        let index = self.pick_writer();
        let is_set = self.qos.presentation.coherent && self.network.random.percent(70);
        let count = 1 + self.network.random.below(MAX_BURST);
        let Self {
            network, writers, ..
        } = self;
        let writer = &mut writers[index];
        let set = if is_set { writer.written + 1 } else { 0 };
        let changes: Vec<_> = (0..count)
            .map(|_| writer.next_change(set, &mut network.random))
            .collect();
        if is_set {
            network.writer(writer.guid).begin_coherent();
        }
        network.write_burst(writer.guid, changes);
        if is_set {
            let timestamp = Timestamp::default();
            network.writer(writer.guid).end_coherent(timestamp);
        }
    }

    fn dispose(&mut self) {
        let index = self.pick_writer();
        let writer = &mut self.writers[index];
        let key = writer.first_key + self.network.random.below(INSTANCES) as u8;
        let change = not_alive(ChangeKind::Disposed, key);
        writer.newest.remove(&change.instance);
        self.network.write_burst(writer.guid, [change]);
    }

    /// What readers lack then, they never get; where there are sets, that must not be a part of one, since a new writer cannot
    /// know what its numbers were.
    fn restart_writer(&mut self) {
        let index = self.pick_writer();
        if self.qos.presentation.coherent {
            self.network
                .run_until_acknowledged(self.writers[index].guid);
        }
        self.take_all();
        let Self {
            network,
            writers,
            readers,
            ..
        } = self;
        let writer = &mut writers[index];
        let last = network.writer(writer.guid).last_sequence();
        network.restart_writer(writer.guid, last.next());
        writer.restarted_after = writer.written;
        writer.newest.clear();
        for reader in readers.iter_mut().filter(|reader| reader.is_matched) {
            network.match_writer_side(writer.guid, reader.guid);
            reader.announce_filter(network.writer(writer.guid));
            if let Some(expected) = reader.expected.get_mut(&writer.guid) {
                expected.excuse(writer.written);
            }
        }
    }

    /// A reader goes, or comes back and knows nothing.
    fn toggle_reader(&mut self) {
        let index = self.network.random.below(self.readers.len() as u64) as usize;
        if self.readers[index].is_matched {
            self.take(index);
            let reader = self.readers[index].guid;
            for writer in &self.writers {
                self.network.disconnect(writer.guid, reader);
            }
            self.network.restart_reader(reader);
            self.readers[index].is_matched = false;
        } else {
            self.join(index);
        }
    }

    fn join(&mut self, index: usize) {
        let reader = &mut self.readers[index];
        reader.is_matched = true;
        reader.every = if self.is_filtered {
            1 + index as u32
        } else {
            1
        };
        reader.newest.clear();
        for writer in &self.writers {
            self.network.connect(writer.guid, reader.guid);
            reader.announce_filter(self.network.writer(writer.guid));
            let past = match self.qos.durability {
                Durability::Volatile => writer.written,
                _ => writer.restarted_after,
            };
            let is_complete =
                self.qos.history == History::KeepAll && self.qos.reliability.is_reliable();
            let mut expected = Expectation::new(past, is_complete, reader.every);
            if self.qos.durability_service != DurabilityService::default() {
                expected.excuse(writer.written);
            }
            reader.expected.insert(writer.guid, expected);
        }
    }

    fn take_all(&mut self) {
        for index in 0..self.readers.len() {
            self.take(index);
        }
    }

    fn take(&mut self, index: usize) {
        let reader = &mut self.readers[index];
        let samples = self.network.take(reader.guid);
        if !reader.is_matched {
            return;
        }
        for writer in &self.writers {
            let of_writer = samples.iter().filter(|s| s.info.writer == writer.guid);
            let of_writer = of_writer.filter(|sample| sample.info.valid_data);
            let numbers: Vec<u32> = of_writer.map(|s| number(&s.payload)).collect();
            self.received += numbers.len();
            if let Some(expected) = reader.expected.get_mut(&writer.guid) {
                expected.check(&numbers);
                expected.check_sets(&numbers, &writer.sets);
            }
        }
        samples.iter().for_each(|sample| reader.note(sample));
    }

    /// Takes until the readers have room for all that has been written.
    fn make_room(&mut self) {
        for _ in 0..6_000 {
            let mut writers = self.writers.iter().map(|writer| writer.guid);
            let network = &mut self.network;
            if !self.is_limited || writers.all(|guid| network.writer(guid).all_acknowledged()) {
                return;
            }
            network.run_for(Duration::from_millis(10));
            self.take_all();
        }
    }

    /// Lets everything calm down with all readers matched.
    fn settle(&mut self) {
        for index in 0..self.readers.len() {
            if !self.readers[index].is_matched {
                self.join(index);
            }
        }
        if !self.qos.reliability.is_reliable() {
            return;
        }
        self.make_room();
        for index in 0..self.writers.len() {
            self.network
                .run_until_acknowledged(self.writers[index].guid);
        }
        self.take_all();
        for reader in &self.readers {
            for writer in &self.writers {
                let expected = &reader.expected[&writer.guid];
                expected.check_end(writer.written, writer.newest.values().max().copied());
                if self.qos.durability != Durability::Volatile && !self.is_filtered {
                    reader.check_state(writer);
                }
            }
        }
    }
}

impl Writing {
    fn next_change(&mut self, set: u32, random: &mut Random) -> NewChange {
        self.written += 1;
        self.sets.push(set);
        let key = self.first_key + random.below(INSTANCES) as u8;
        let size = match random.below(200) {
            0 => 5000,
            _ => 8 + random.below(50) as usize,
        };
        let change = sample(self.written, key, size);
        self.newest.insert(change.instance, self.written);
        change
    }
}

impl Reading {
    fn announce_filter(&self, writer: &mut Writer) {
        let every = self.every;
        let is_wanted = move |kind, payload: &[u8]| {
            let number = u32::from_le_bytes(payload[4..8].try_into().unwrap());
            kind != PayloadKind::Data || number.is_multiple_of(every)
        };
        let filter: PayloadFilter = Arc::new(is_wanted);
        let signature = FilterSignature([every as u8; 16]);
        writer.set_reader_filter(self.guid, (every > 1).then_some((filter, signature)));
    }

    fn note(&mut self, sample: &Sample) {
        let instance = sample.info.instance;
        if sample.info.valid_data {
            self.newest.insert(instance, number(&sample.payload));
        } else {
            self.newest.remove(&instance);
        }
    }

    /// The last value of each instance is here.
    fn check_state(&self, writer: &Writing) {
        for (instance, number) in &writer.newest {
            assert_eq!(self.newest.get(instance), Some(number), "{instance:?}");
        }
    }
}

fn qos(durability: Durability, history: History, coherent: bool) -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        durability,
        history,
        presentation: Presentation {
            scope: if coherent {
                PresentationScope::Topic
            } else {
                PresentationScope::Instance
            },
            coherent,
            ordered: false,
        },
        ..Qos::default()
    }
}

/// Runs of so many samples in all.
fn marathon(runs: u64, samples: usize, qos: &Qos) {
    for seed in seeds(runs) {
        Run::new(seed, qos.clone(), ResourceLimits::default()).run(samples / runs as usize);
    }
}

#[test]
fn keep_all_reaches_whoever_is_there() {
    marathon(
        8,
        300_000,
        &qos(Durability::Volatile, History::KeepAll, false),
    );
}

#[test]
fn keep_all_reaches_late_joiners() {
    marathon(
        8,
        200_000,
        &qos(Durability::TransientLocal, History::KeepAll, false),
    );
}

#[test]
fn late_joiners_get_what_the_durability_service_keeps() {
    let durability_service = DurabilityService {
        history: History::KeepLast(2),
        ..DurabilityService::default()
    };
    let transient = Qos {
        durability_service,
        ..qos(Durability::Transient, History::KeepAll, false)
    };
    marathon(8, 50_000, &transient);
}

#[test]
fn filtered_readers_get_all_that_they_want() {
    for seed in seeds(6) {
        for durability in [Durability::Volatile, Durability::TransientLocal] {
            let qos = qos(durability, History::KeepAll, false);
            let mut run = Run::new(seed, qos, ResourceLimits::default());
            run.is_filtered = true;
            run.run(8_000);
        }
    }
}

#[test]
fn readers_without_room_get_all_once_they_have_room() {
    let limits = ResourceLimits {
        max_samples: Some(20),
        max_samples_per_instance: Some(6),
        ..ResourceLimits::default()
    };
    for seed in seeds(6) {
        let qos = qos(Durability::Volatile, History::KeepAll, false);
        Run::new(seed, qos, limits).run(8_000);
    }
}

#[test]
fn keep_last_ends_in_the_same_state() {
    marathon(
        8,
        150_000,
        &qos(Durability::TransientLocal, History::KeepLast(2), false),
    );
}

#[test]
fn best_effort_is_in_order() {
    let best_effort = Qos {
        reliability: Reliability::BestEffort,
        ..qos(Durability::Volatile, History::KeepAll, false)
    };
    marathon(8, 150_000, &best_effort);
}

#[test]
fn coherent_sets_are_whole_or_absent() {
    marathon(
        8,
        200_000,
        &qos(Durability::Volatile, History::KeepAll, true),
    );
    marathon(
        4,
        50_000,
        &qos(Durability::TransientLocal, History::KeepAll, true),
    );
}
