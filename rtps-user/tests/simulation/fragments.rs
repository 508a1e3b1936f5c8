//! Samples that need many datagrams: DATA_FRAG and NACK_FRAG (RTPS 2.5 section 8.4.14.1).

use std::time::Duration;

use rtps_user::qos::{Durability, History, Qos, Reliability};
use rtps_user::wire::{EntityKind, Guid};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, number, sample};

fn durable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        durability: Durability::TransientLocal,
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn pair(conditions: Conditions, seed: u64) -> (Network, Guid, Guid) {
    let mut network = Network::new(conditions, seed);
    let writer = network.add_writer(EntityKind::WriterNoKey, durable());
    let reader = network.add_reader(EntityKind::ReaderNoKey, durable());
    network.connect(writer, reader);
    (network, writer, reader)
}

fn numbers(network: &mut Network, reader: Guid) -> Vec<u32> {
    let samples = network.take(reader);
    samples.iter().map(|s| number(&s.payload)).collect()
}

#[test]
fn a_large_sample_takes_as_many_datagrams_as_it_must() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 1);
    network.run_for(Duration::from_secs(1));
    let before = network.datagrams;
    network.write(writer, sample(1, 0, 1 << 20)).unwrap();
    network.run_until_acknowledged(writer);
    let datagrams = network.datagrams - before;
    assert!((700..800).contains(&datagrams), "{datagrams} datagrams");
    assert_eq!(numbers(&mut network, reader), [1]);
}

#[test]
fn a_megabyte_survives_loss() {
    for seed in seeds(5) {
        let (mut network, writer, reader) = pair(Conditions::AWFUL, seed);
        network.write(writer, sample(1, 0, 1 << 20)).unwrap();
        let before = network.datagrams;
        network.run_until_acknowledged(writer);
        assert_eq!(numbers(&mut network, reader), [1]);
        assert!(network.datagrams - before < 4 * 720, "wasteful repairs");
    }
}

/// 20 a second would leave 50 ms for each, of which the link itself and the CPUs need most.
#[test]
fn losses_hold_up_a_large_sample_for_milliseconds() {
    const SAMPLES: u32 = 5;
    let conditions = Conditions {
        loss: 5,
        ..Conditions::PERFECT
    };
    for seed in seeds(3) {
        let (mut network, writer, reader) = pair(conditions, seed);
        network.run_for(Duration::from_secs(1));
        let (start, before) = (network.now, network.datagrams);
        for number in 1..=SAMPLES {
            network.write_blocking(writer, sample(number, 0, 4 << 20));
        }
        network.run_until_acknowledged(writer);
        assert_numbers(&numbers(&mut network, reader), 1..=SAMPLES);
        let each = (network.now - start) / SAMPLES;
        assert!(each < Duration::from_millis(25), "{each:?}");
        let sent = (network.datagrams - before) / SAMPLES as usize;
        assert!(sent < 3600, "{sent} datagrams, 2,950 without a loss");
    }
}

#[test]
fn sizes_around_the_limits_of_datagrams() {
    for seed in seeds(3) {
        let (mut network, writer, reader) = pair(Conditions::AWFUL, seed);
        let sizes: Vec<_> = (1300..1500).chain([2700, 2712, 2713, 2720]).collect();
        for (index, size) in sizes.iter().enumerate() {
            network.write_blocking(writer, sample(index as u32, 0, *size));
        }
        network.run_until_acknowledged(writer);
        let received = numbers(&mut network, reader);
        assert_numbers(&received, 0..sizes.len() as u32);
    }
}

#[test]
fn late_joiners_get_large_samples_between_small_ones() {
    for seed in seeds(3) {
        let (mut network, writer, _) = pair(Conditions::AWFUL, seed);
        for number in 1..=30 {
            let size = if number % 5 == 0 { 25_000 } else { 50 };
            network.write(writer, sample(number, 0, size)).unwrap();
        }
        let late = network.add_reader(EntityKind::ReaderNoKey, durable());
        network.connect(writer, late);
        network.run_until_acknowledged(writer);
        let received = numbers(&mut network, late);
        assert_numbers(&received, 1..=30);
    }
}

#[test]
fn a_replaced_large_sample_is_given_up() {
    let last = Qos {
        history: History::KeepLast(1),
        ..durable()
    };
    for seed in seeds(5) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writer = network.add_writer(EntityKind::WriterNoKey, last.clone());
        let reader = network.add_reader(EntityKind::ReaderNoKey, last.clone());
        network.connect(writer, reader);
        for number in 1..=20 {
            network.write(writer, sample(number, 0, 100_000)).unwrap();
            let pause = network.random.up_to(Duration::from_millis(5));
            network.run_for(pause);
        }
        network.run_until_acknowledged(writer);
        assert_eq!(numbers(&mut network, reader).last(), Some(&20));
    }
}
