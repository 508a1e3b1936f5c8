//! HISTORY and RESOURCE_LIMITS of writers (DDS 1.4 sections 2.2.3.18 and 2.2.3.19).

use std::time::Duration;

use rtps_user::history::CacheChange;
use rtps_user::qos::{Durability, History, Qos, Reliability, ResourceLimits};
use rtps_user::wire::{EntityKind, Guid};
use rtps_user::writer::{WriteError, WriterTiming};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, number, sample};

fn keep_last(depth: u32) -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: History::KeepLast(depth),
        ..Qos::default()
    }
}

fn limited(resource_limits: ResourceLimits, durability: Durability) -> Qos {
    Qos {
        history: History::KeepAll,
        durability,
        resource_limits,
        ..keep_last(1)
    }
}

/// A writer with a reader that never answers.
fn with_silent_reader(qos: Qos, timing: WriterTiming) -> (Network, Guid) {
    let mut network = Network::new(Conditions::PERFECT, 1);
    let writer = network.add_writer_with(EntityKind::WriterWithKey, qos.clone(), timing);
    let reader = network.add_reader(EntityKind::ReaderWithKey, qos);
    network.match_writer_side(writer, reader);
    (network, writer)
}

#[test]
fn keep_last_ends_in_the_same_state_on_both_sides() {
    for seed in seeds(20) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, keep_last(2));
        let reader = network.add_reader(EntityKind::ReaderWithKey, keep_last(2));
        network.connect(writer, reader);
        let mut written = vec![Vec::new(); 5];
        for number in 1..=500 {
            let key = network.random.below(5) as u8;
            network.write(writer, sample(number, key, 50)).unwrap();
            written[usize::from(key)].push(number);
            let pause = network.random.up_to(Duration::from_micros(400));
            network.run_for(pause);
        }
        network.run_until_acknowledged(writer);
        let samples = network.take(reader);
        for (key, written) in written.iter().enumerate() {
            let of_key = samples
                .iter()
                .filter(|s| s.info.instance == crate::sample::instance(key as u8));
            let received: Vec<_> = of_key.map(|s| number(&s.payload)).collect();
            assert_eq!(received, written[written.len() - 2..], "instance {key}");
        }
    }
}

#[test]
fn keep_last_never_waits() {
    let (mut network, writer) = with_silent_reader(keep_last(3), WriterTiming::default());
    for number in 1..=10_000 {
        network.write(writer, sample(number, 0, 50)).unwrap();
    }
}

#[test]
fn every_limit_is_kept() {
    let limits = [
        ResourceLimits {
            max_samples: Some(4),
            ..ResourceLimits::default()
        },
        ResourceLimits {
            max_samples_per_instance: Some(4),
            ..ResourceLimits::default()
        },
    ];
    for limits in limits {
        let qos = limited(limits, Durability::Volatile);
        let (mut network, writer) = with_silent_reader(qos, WriterTiming::default());
        for number in 1..=4 {
            network.write(writer, sample(number, 0, 50)).unwrap();
        }
        let result = network.write(writer, sample(5, 0, 50));
        assert_eq!(result, Err(WriteError::HistoryFull));
        assert_eq!(network.writer(writer).last_sequence().0, 4);
    }
}

#[test]
fn instances_beyond_the_limit_are_refused() {
    let limits = ResourceLimits {
        max_instances: Some(2),
        ..ResourceLimits::default()
    };
    let qos = limited(limits, Durability::TransientLocal);
    let (mut network, writer) = with_silent_reader(qos, WriterTiming::default());
    network.write(writer, sample(1, 1, 50)).unwrap();
    network.write(writer, sample(2, 2, 50)).unwrap();
    let result = network.write(writer, sample(3, 3, 50));
    assert_eq!(result, Err(WriteError::OutOfResources));
    network.write(writer, sample(4, 2, 50)).unwrap();
}

#[test]
fn the_window_bounds_what_is_unacknowledged() {
    let timing = WriterTiming {
        max_unacknowledged_bytes: 10 * (100 + CacheChange::OVERHEAD),
        ..WriterTiming::default()
    };
    let qos = limited(ResourceLimits::default(), Durability::Volatile);
    let (mut network, writer) = with_silent_reader(qos, timing);
    for number in 1..=10 {
        network.write(writer, sample(number, 0, 100)).unwrap();
    }
    let result = network.write(writer, sample(11, 0, 100));
    assert_eq!(result, Err(WriteError::HistoryFull));
}

#[test]
fn acknowledged_samples_make_room_also_for_transient_local() {
    let limits = ResourceLimits {
        max_samples: Some(8),
        ..ResourceLimits::default()
    };
    let durable = limited(limits, Durability::TransientLocal);
    let unlimited = limited(ResourceLimits::default(), Durability::TransientLocal);
    let mut network = Network::new(Conditions::AWFUL, 5);
    let writer = network.add_writer(EntityKind::WriterNoKey, durable);
    let reader = network.add_reader(EntityKind::ReaderNoKey, unlimited.clone());
    network.connect(writer, reader);
    for number in 1..=100 {
        network.write_blocking(writer, sample(number, 0, 50));
    }
    network.run_until_acknowledged(writer);
    let late = network.add_reader(EntityKind::ReaderNoKey, unlimited);
    network.connect(writer, late);
    network.run_until_acknowledged(writer);
    let numbers = |samples: Vec<rtps_user::reader::Sample>| -> Vec<_> {
        samples.iter().map(|s| number(&s.payload)).collect()
    };
    let received = numbers(network.take(reader));
    assert_numbers(&received, 1..=100);
    let received = numbers(network.take(late));
    assert_numbers(&received, 93..=100);
}
