//! Thousands of random operations on one writer and three readers, with invariants that hold whatever happens.

use std::collections::BTreeMap;
use std::time::Duration;

use rtps_user::history::ChangeKind;
use rtps_user::qos::{Durability, History, Qos, Reliability};
use rtps_user::reader::Sample;
use rtps_user::wire::{EntityKind, Guid, KeyHash};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, not_alive, number, sample};

/// A run, and what its readers have received since their last match.
struct Run {
    network: Network,
    writer: Guid,
    readers: Vec<Guid>,
    is_matched: Vec<bool>,
    received: Vec<Vec<Sample>>,
    written: u32,
    /// The last sample of each instance that is alive.
    newest: BTreeMap<KeyHash, u32>,
}

impl Run {
    fn new(seed: u64, history: History) -> Self {
        let qos = Qos {
            reliability: Reliability::RELIABLE,
            durability: Durability::TransientLocal,
            history,
            ..Qos::default()
        };
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, qos.clone());
        let readers: Vec<_> = (0..3)
            .map(|_| network.add_reader(EntityKind::ReaderWithKey, qos.clone()))
            .collect();
        Self {
            network,
            writer,
            is_matched: vec![false; readers.len()],
            received: vec![Vec::new(); readers.len()],
            readers,
            written: 0,
            newest: BTreeMap::new(),
        }
    }

    fn step(&mut self) {
        match self.network.random.below(20) {
            0 => self.toggle_match(),
            1 => self.dispose(),
            2..=5 => self.take_some(),
            6..=9 => {
                let pause = self.network.random.up_to(Duration::from_millis(5));
                self.network.run_for(pause);
            }
            _ => self.write(),
        }
    }

    fn toggle_match(&mut self) {
        let index = self.network.random.below(self.readers.len() as u64) as usize;
        let reader = self.readers[index];
        if self.is_matched[index] {
            self.network.disconnect(self.writer, reader);
            self.network.take(reader);
            self.received[index].clear();
        } else {
            self.network.connect(self.writer, reader);
        }
        self.is_matched[index] = !self.is_matched[index];
    }

    fn dispose(&mut self) {
        let key = self.network.random.below(6) as u8;
        let change = not_alive(ChangeKind::Disposed, key);
        self.newest.remove(&change.instance);
        self.network.write_blocking(self.writer, change);
    }

    fn write(&mut self) {
        self.written += 1;
        let key = self.network.random.below(6) as u8;
        let size = match self.network.random.below(10) {
            0 => 5000,
            _ => 40,
        };
        let change = sample(self.written, key, size);
        self.newest.insert(change.instance, self.written);
        self.network.write_blocking(self.writer, change);
    }

    fn take_some(&mut self) {
        for (index, reader) in self.readers.iter().enumerate() {
            let samples = self.network.take(*reader);
            self.received[index].extend(samples);
        }
    }

    /// Lets everything calm down with all readers matched.
    fn settle(&mut self) {
        for index in 0..self.readers.len() {
            if !self.is_matched[index] {
                self.network.connect(self.writer, self.readers[index]);
                self.is_matched[index] = true;
            }
        }
        self.network.run_until_acknowledged(self.writer);
        self.take_some();
    }

    fn check_order(&self) {
        for received in &self.received {
            let sequences: Vec<_> = received
                .iter()
                .filter(|s| s.info.valid_data)
                .map(|s| s.info.sequence)
                .collect();
            assert!(sequences.is_sorted_by(|a, b| a < b), "{sequences:?}");
        }
    }

    fn check_newest(&self) {
        for received in &self.received {
            let mut newest = BTreeMap::new();
            for sample in received {
                if sample.info.valid_data {
                    newest.insert(sample.info.instance, number(&sample.payload));
                } else {
                    newest.remove(&sample.info.instance);
                }
            }
            assert_eq!(newest, self.newest);
        }
    }
}

#[test]
fn keep_all_has_no_gaps() {
    for seed in seeds(12) {
        let mut run = Run::new(seed, History::KeepAll);
        for _ in 0..1000 {
            run.step();
        }
        run.settle();
        run.check_order();
        run.check_newest();
        for received in &run.received {
            let data = received.iter().filter(|s| s.info.valid_data);
            let numbers: Vec<_> = data.map(|s| number(&s.payload)).collect();
            assert_numbers(&numbers, 1..=run.written);
        }
    }
}

#[test]
fn keep_last_converges() {
    for seed in seeds(12) {
        let depth = 1 + (seed % 3) as u32;
        let mut run = Run::new(seed, History::KeepLast(depth));
        for _ in 0..1000 {
            run.step();
        }
        run.settle();
        run.check_newest();
    }
}
