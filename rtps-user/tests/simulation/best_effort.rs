//! Best-effort communication: what arrives arrives in order and once.

use std::time::Duration;

use rtps_user::qos::{History, Qos};
use rtps_user::wire::{EntityKind, Guid};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, number, sample};

fn best_effort() -> Qos {
    Qos {
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn pair(conditions: Conditions, seed: u64) -> (Network, Guid, Guid) {
    let mut network = Network::new(conditions, seed);
    let writer = network.add_writer(EntityKind::WriterNoKey, best_effort());
    let reader = network.add_reader(EntityKind::ReaderNoKey, best_effort());
    network.connect(writer, reader);
    (network, writer, reader)
}

fn write(network: &mut Network, writer: Guid, count: u32) {
    for number in 1..=count {
        network.write(writer, sample(number, 0, 100)).unwrap();
        network.run_for(Duration::from_millis(1));
    }
    network.run_for(Duration::from_secs(1));
}

#[test]
fn one_datagram_a_sample_and_nothing_else() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 1);
    write(&mut network, writer, 100);
    let received = network.take(reader);
    let numbers: Vec<_> = received.iter().map(|s| number(&s.payload)).collect();
    assert_numbers(&numbers, 1..=100);
    assert_eq!(network.datagrams, 100);
}

#[test]
fn what_arrives_is_in_order_and_comes_once() {
    for seed in seeds(20) {
        let (mut network, writer, reader) = pair(Conditions::AWFUL, seed);
        write(&mut network, writer, 200);
        let received = network.take(reader);
        let numbers: Vec<_> = received.iter().map(|s| number(&s.payload)).collect();
        assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
        assert!(numbers.len() > 60, "only {} of 200", numbers.len());
    }
}

#[test]
fn nobody_receives_after_the_match_is_over() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 2);
    write(&mut network, writer, 1);
    network.disconnect(writer, reader);
    write(&mut network, writer, 10);
    let received = network.take(reader);
    assert_eq!(received.iter().filter(|s| s.info.valid_data).count(), 1);
    assert_eq!(network.datagrams, 1);
}
