//! Late joiners: VOLATILE and TRANSIENT_LOCAL (DDS 1.4 section 2.2.3.4).

use std::time::Duration;

use rtps_user::endpoints::EndpointEvent;
use rtps_user::qos::{Durability, History, Qos, Reliability};
use rtps_user::wire::{EntityKind, Guid};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, number, sample};

fn qos(durability: Durability, reliability: Reliability) -> Qos {
    Qos {
        reliability,
        durability,
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn numbers(network: &mut Network, reader: Guid) -> Vec<u32> {
    let samples = network.take(reader);
    samples.iter().map(|s| number(&s.payload)).collect()
}

/// A writer that has written 1..=600 before the reader joins, and writes up to 700 after.
fn join_late(conditions: Conditions, seed: u64, writer: Qos, reader: Qos) -> Vec<u32> {
    let mut network = Network::new(Conditions::PERFECT, seed);
    let writer = network.add_writer(EntityKind::WriterNoKey, writer);
    let early = qos(Durability::Volatile, Reliability::RELIABLE);
    let early = network.add_reader(EntityKind::ReaderNoKey, early);
    network.connect(writer, early);
    network.run_for(Duration::from_millis(1));
    network.conditions = conditions;
    for number in 1..=600 {
        network.write_blocking(writer, sample(number, 0, 100));
    }
    network.run_until_acknowledged(writer);
    let late = network.add_reader(EntityKind::ReaderNoKey, reader);
    network.connect(writer, late);
    // Time for the two to greet each other in spite of losses.
    network.run_for(Duration::from_secs(30));
    for number in 601..=700 {
        network.write_blocking(writer, sample(number, 0, 100));
        network.run_for(Duration::from_micros(200));
    }
    network.run_until_acknowledged(writer);
    network.run_for(Duration::from_millis(100));
    assert_numbers(&numbers(&mut network, early), 1..=700);
    let lost = |event: &EndpointEvent| matches!(event, EndpointEvent::SampleLost { .. });
    let has_lost = network.events.iter().any(|(_, event)| lost(event));
    assert!(!has_lost, "nothing counts as lost");
    numbers(&mut network, late)
}

#[test]
fn transient_local_readers_get_everything() {
    let durable = qos(Durability::TransientLocal, Reliability::RELIABLE);
    for seed in seeds(5) {
        let received = join_late(Conditions::AWFUL, seed, durable.clone(), durable.clone());
        assert_numbers(&received, 1..=700);
    }
}

#[test]
fn volatile_readers_get_what_comes_after() {
    let volatile = qos(Durability::Volatile, Reliability::RELIABLE);
    let durable = qos(Durability::TransientLocal, Reliability::RELIABLE);
    for writer in [volatile.clone(), durable] {
        for seed in seeds(5) {
            let received = join_late(Conditions::AWFUL, seed, writer.clone(), volatile.clone());
            assert_numbers(&received, 601..=700);
        }
    }
}

#[test]
fn best_effort_transient_local_readers_get_the_past_once() {
    let writer = qos(Durability::TransientLocal, Reliability::RELIABLE);
    let reader = qos(Durability::TransientLocal, Reliability::BestEffort);
    let received = join_late(Conditions::PERFECT, 1, writer, reader);
    assert_numbers(&received, 1..=700);
}

#[test]
fn the_newest_of_each_instance_is_enough_for_keep_last() {
    let durable = Qos {
        history: History::KeepLast(1),
        ..qos(Durability::TransientLocal, Reliability::RELIABLE)
    };
    for seed in seeds(5) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterWithKey, durable.clone());
        for number in 1..=1000 {
            let key = network.random.below(100) as u8;
            network.write(writer, sample(number, key, 30)).unwrap();
        }
        for key in 0..100 {
            let number = 2000 + u32::from(key);
            network.write(writer, sample(number, key, 30)).unwrap();
        }
        let reader = network.add_reader(EntityKind::ReaderWithKey, durable.clone());
        network.connect(writer, reader);
        network.run_until_acknowledged(writer);
        let received = numbers(&mut network, reader);
        assert_numbers(&received, 2000..2100);
    }
}

#[test]
fn a_removed_sample_is_not_waited_for() {
    let durable = qos(Durability::TransientLocal, Reliability::RELIABLE);
    let mut network = Network::new(Conditions::AWFUL, 3);
    let writer = network.add_writer(EntityKind::WriterNoKey, durable.clone());
    for number in 1..=20 {
        let sequence = network.write(writer, sample(number, 0, 30)).unwrap();
        if number % 3 != 0 {
            network.writer(writer).remove(sequence);
        }
    }
    let reader = network.add_reader(EntityKind::ReaderNoKey, durable);
    network.connect(writer, reader);
    network.run_until_acknowledged(writer);
    assert_eq!(numbers(&mut network, reader), [3, 6, 9, 12, 15, 18]);
}
