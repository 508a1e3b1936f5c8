//! OWNERSHIP EXCLUSIVE: one writer of an instance counts.

use super::*;
use crate::qos::{Deadline, Liveliness, LivelinessKind, Ownership};

fn strength(strength: i32) -> Qos {
    Qos {
        ownership: Ownership::Exclusive { strength },
        ..reliable()
    }
}

/// A reader and three writers with the strengths 10, 20 and 5; each knows what number it is to use next.
struct Rivals {
    bench: Bench,
    next: [i64; 4],
}

impl Rivals {
    fn new(reader: Qos) -> Self {
        let mut bench = Bench::unmatched(ReaderConfig::new(reader_guid(), reader));
        for (index, force) in [(1, 10), (2, 20), (3, 5)] {
            bench.switch_to(index, strength(force));
        }
        Self {
            bench,
            next: [1; 4],
        }
    }

    fn write(&mut self, writer: u8, instance: u8, status: StatusInfo) {
        let next = &mut self.next[usize::from(writer)];
        self.bench.writer = super::writer(writer);
        let payload: &[u8] = if status.is_alive() { &[writer] } else { &[] };
        self.bench.sample(*next, key(instance), status, payload);
        *next += 1;
        assert_eq!(self.bench.progress(), *next, "it is acknowledged");
    }

    /// Who wrote the samples that are taken now.
    fn authors(&mut self) -> Vec<u8> {
        let samples = self.bench.take().into_iter();
        samples
            .filter(|sample| sample.info.valid_data)
            .map(|sample| sample.payload[0])
            .collect()
    }

    /// Each writes once, the weakest first; who of them counts.
    fn all_write(&mut self) -> Vec<u8> {
        for writer in [3, 1, 2] {
            self.write(writer, 1, ALIVE);
        }
        self.authors()
    }
}

#[test]
fn stronger_writers_take_over_and_weaker_ones_are_not_heard() {
    let mut rivals = Rivals::new(strength(0));
    assert_eq!(rivals.all_write(), [3, 1, 2]);
    assert_eq!(rivals.all_write(), [2]);
    rivals.write(1, 2, ALIVE);
    assert_eq!(rivals.authors(), [1], "each instance has its own owner");
    assert!(
        !rivals
            .bench
            .events()
            .iter()
            .any(|event| matches!(event, ReaderEvent::SampleLost { .. }))
    );
}

#[test]
fn equally_strong_writers_give_way_to_the_smallest_guid() {
    let mut rivals = Rivals::new(strength(0));
    rivals.bench.switch_to(2, strength(10));
    rivals.write(2, 1, ALIVE);
    rivals.write(1, 1, ALIVE);
    rivals.write(2, 1, ALIVE);
    assert_eq!(rivals.authors(), [2, 1]);
}

#[test]
fn the_strongest_of_those_left_inherits_what_is_given_up() {
    let mut rivals = Rivals::new(strength(0));
    rivals.all_write();
    rivals.write(2, 1, UNREGISTERED);
    rivals.write(3, 1, ALIVE);
    rivals.write(1, 1, ALIVE);
    assert_eq!(rivals.authors(), [1]);
    let now = rivals.bench.now;
    rivals.bench.reader.unmatch_writer(now, writer(1));
    rivals.write(3, 1, ALIVE);
    assert_eq!(rivals.authors(), [3]);
}

#[test]
fn only_its_owner_disposes_an_instance() {
    let mut rivals = Rivals::new(strength(0));
    rivals.all_write();
    rivals.write(1, 1, DISPOSED);
    assert!(rivals.bench.take().is_empty());
    rivals.write(2, 1, DISPOSED);
    let samples = rivals.bench.take();
    assert_eq!(
        samples[0].info.instance_state,
        InstanceState::NotAliveDisposed
    );
}

#[test]
fn an_instance_without_its_owner_lives_while_others_write_it() {
    let mut rivals = Rivals::new(strength(0));
    rivals.write(2, 1, ALIVE);
    rivals.write(1, 1, ALIVE);
    assert_eq!(rivals.authors(), [2]);
    rivals.write(2, 1, UNREGISTERED);
    assert!(rivals.bench.take().is_empty());
    rivals.write(1, 1, UNREGISTERED);
    let samples = rivals.bench.take();
    assert_eq!(
        samples[0].info.instance_state,
        InstanceState::NotAliveNoWriters
    );
}

#[test]
fn who_misses_the_deadline_loses_the_instance() {
    let mut rivals = Rivals::new(Qos {
        deadline: Deadline(millis(100)),
        ..strength(0)
    });
    rivals.all_write();
    rivals.bench.wait(60);
    rivals.write(3, 1, ALIVE);
    assert_eq!(rivals.authors(), []);
    rivals.bench.wait(40);
    rivals.write(3, 1, ALIVE);
    assert_eq!(rivals.authors(), [3]);
    rivals.write(2, 1, ALIVE);
    assert_eq!(rivals.authors(), [2], "and gets it back");
}

#[test]
fn who_is_not_alive_loses_the_instance() {
    let mut rivals = Rivals::new(strength(0));
    rivals.bench.switch_to(
        2,
        Qos {
            liveliness: Liveliness {
                kind: LivelinessKind::ManualByTopic,
                lease: millis(100),
            },
            ..strength(20)
        },
    );
    rivals.all_write();
    rivals.bench.wait(100);
    rivals.write(3, 1, ALIVE);
    rivals.write(1, 1, ALIVE);
    assert_eq!(rivals.authors(), [1]);
    assert_eq!(rivals.all_write(), [1, 2]);
}

#[test]
fn strengths_change_at_run_time() {
    let mut rivals = Rivals::new(strength(0));
    rivals.all_write();
    rivals.bench.switch_to(3, strength(30));
    assert_eq!(rivals.all_write(), [3]);
    rivals.bench.switch_to(3, strength(1));
    assert_eq!(rivals.all_write(), [3, 1, 2]);
}

#[test]
fn shared_instances_have_no_owner() {
    let mut rivals = Rivals::new(reliable());
    rivals.all_write();
    assert_eq!(rivals.all_write(), [3, 1, 2]);
}
