//! Flow control: a writer that is faster than its readers does not flood them.

use std::time::Duration;

use rtps_user::qos::{History, Qos, Reliability};
use rtps_user::wire::EntityKind;

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{assert_numbers, number, sample};

fn reliable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: History::KeepAll,
        ..Qos::default()
    }
}

/// Inboxes that are smaller than what a writer may have on its way in the beginning.
const SMALL: Conditions = Conditions {
    inbox: 150_000,
    ..Conditions::PERFECT
};

/// What was received, after `count` samples were written as fast as possible.
fn flood(network: &mut Network, readers: usize, count: u32, size: usize) -> Vec<Vec<u32>> {
    let writer = network.add_writer(EntityKind::WriterNoKey, reliable());
    let readers: Vec<_> = (0..readers)
        .map(|_| network.add_reader(EntityKind::ReaderNoKey, reliable()))
        .collect();
    for reader in &readers {
        network.connect(writer, *reader);
    }
    network.run_for(Duration::from_secs(1));
    for number in 1..=count {
        network.write_blocking(writer, sample(number, 0, size));
    }
    network.run_until_acknowledged(writer);
    let numbers = |reader| {
        let samples = network.take(reader);
        samples.iter().map(|s| number(&s.payload)).collect()
    };
    readers.into_iter().map(numbers).collect()
}

#[test]
fn a_large_inbox_loses_nothing() {
    let conditions = Conditions {
        inbox: 4 << 20,
        ..Conditions::PERFECT
    };
    let mut network = Network::new(conditions, 1);
    let received = flood(&mut network, 1, 50_000, 100);
    assert_numbers(&received[0], 1..=50_000);
    assert_eq!(network.overflown, 0);
}

#[test]
fn a_small_inbox_loses_little() {
    for (count, size) in [(30_000, 100), (5_000, 1000), (600, 8192)] {
        let mut network = Network::new(SMALL, 1);
        let received = flood(&mut network, 1, count, size);
        assert_numbers(&received[0], 1..=count);
        let (lost, sent) = (network.overflown, network.datagrams);
        assert!(lost * 10 < sent, "{lost} of {sent} lost at {size} bytes");
    }
}

#[test]
fn several_readers_get_everything_in_spite_of_losses() {
    for seed in seeds(3) {
        for conditions in [SMALL, Conditions::AWFUL] {
            let mut network = Network::new(conditions, seed);
            let received = flood(&mut network, 4, 1000, 1000);
            for numbers in received {
                assert_numbers(&numbers, 1..=1000);
            }
        }
    }
}

#[test]
fn what_is_larger_than_the_inbox_arrives() {
    let mut network = Network::new(SMALL, 1);
    let received = flood(&mut network, 1, 3, 1_000_000);
    assert_numbers(&received[0], 1..=3);
}
