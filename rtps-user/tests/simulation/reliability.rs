//! Reliable communication: every sample, once, in order, at a low price (RTPS 2.5 sections 8.4.2.2.2, 8.4.9.2).

use std::time::Duration;

use rtps_user::qos::{History, Qos, Reliability, ResourceLimits};
use rtps_user::wire::{EntityKind, Guid};
use rtps_user::writer::WriteError;

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

fn pair(conditions: Conditions, seed: u64) -> (Network, Guid, Guid) {
    let mut network = Network::new(conditions, seed);
    let writer = network.add_writer(EntityKind::WriterNoKey, reliable());
    let reader = network.add_reader(EntityKind::ReaderNoKey, reliable());
    network.connect(writer, reader);
    (network, writer, reader)
}

fn numbers(network: &mut Network, reader: Guid) -> Vec<u32> {
    let samples = network.take(reader);
    samples.iter().map(|s| number(&s.payload)).collect()
}

#[test]
fn nothing_is_lost_repeated_or_reordered() {
    for seed in seeds(30) {
        let (mut network, writer, reader) = pair(Conditions::AWFUL, seed);
        for number in 1..=500 {
            network.write_blocking(writer, sample(number, 0, 100));
            let pause = network.random.up_to(Duration::from_millis(1));
            network.run_for(pause);
        }
        network.run_until_acknowledged(writer);
        let received = numbers(&mut network, reader);
        assert_numbers(&received, 1..=500);
    }
}

#[test]
fn a_burst_without_pauses_arrives() {
    for seed in seeds(10) {
        let (mut network, writer, reader) = pair(Conditions::AWFUL, seed);
        for number in 1..=3000 {
            network.write_blocking(writer, sample(number, 0, 100));
        }
        network.run_until_acknowledged(writer);
        let received = numbers(&mut network, reader);
        assert_numbers(&received, 1..=3000);
    }
}

#[test]
fn acknowledgements_are_few_and_end() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 1);
    network.run_for(Duration::from_secs(1));
    let before = network.datagrams;
    for number in 1..=1000 {
        network.write(writer, sample(number, 0, 100)).unwrap();
        network.run_for(Duration::from_micros(100));
    }
    network.run_until_acknowledged(writer);
    let overhead = network.datagrams - before - 1000;
    assert!(overhead <= 100, "{overhead} datagrams beside the data");
    let before = network.datagrams;
    network.run_for(Duration::from_secs(60));
    assert_eq!(network.datagrams, before, "an idle pair is silent");
    assert_eq!(numbers(&mut network, reader).len(), 1000);
}

#[test]
fn several_readers_and_writers() {
    for seed in seeds(5) {
        let mut network = Network::new(Conditions::AWFUL, seed);
        let writers: Vec<_> = (0..3)
            .map(|_| network.add_writer(EntityKind::WriterNoKey, reliable()))
            .collect();
        let readers: Vec<_> = (0..3)
            .map(|_| network.add_reader(EntityKind::ReaderNoKey, reliable()))
            .collect();
        for writer in &writers {
            for reader in &readers {
                network.connect(*writer, *reader);
            }
        }
        for number in 1..=100 {
            for writer in &writers {
                network.write_blocking(*writer, sample(number, 0, 50));
            }
            network.run_for(Duration::from_micros(500));
        }
        for writer in &writers {
            network.run_until_acknowledged(*writer);
        }
        for reader in readers {
            let samples = network.take(reader);
            for writer in &writers {
                let from_writer = samples.iter().filter(|s| s.info.writer == *writer);
                let received: Vec<_> = from_writer.map(|s| number(&s.payload)).collect();
                assert_numbers(&received, 1..=100);
            }
        }
    }
}

#[test]
fn a_full_history_waits_for_the_slowest_reader() {
    let mut network = Network::new(Conditions::PERFECT, 1);
    let limited = Qos {
        resource_limits: ResourceLimits {
            max_samples: Some(10),
            ..ResourceLimits::default()
        },
        ..reliable()
    };
    let writer = network.add_writer(EntityKind::WriterNoKey, limited.clone());
    let reader = network.add_reader(EntityKind::ReaderNoKey, limited);
    network.connect(writer, reader);
    // The reader has room for 10 and the writer for 10 more.
    let mut written = 0;
    while network.write(writer, sample(written + 1, 0, 100)).is_ok() {
        written += 1;
        network.run_for(Duration::from_millis(5));
        assert!(written <= 20, "no back-pressure");
    }
    assert_eq!(written, 20);
    network.run_for(Duration::from_secs(5));
    let full = network.write(writer, sample(written + 1, 0, 100));
    assert_eq!(full, Err(WriteError::HistoryFull));
    let mut received = numbers(&mut network, reader);
    while received.len() < 20 {
        network.run_for(Duration::from_secs(2));
        let more = numbers(&mut network, reader);
        assert!(!more.is_empty(), "stuck after {}", received.len());
        received.extend(more);
    }
    assert_numbers(&received, 1..=20);
    assert!(network.write(writer, sample(21, 0, 100)).is_ok());
}

#[test]
fn a_reader_that_is_gone_holds_nobody_up() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 1);
    let dead = network.add_reader(EntityKind::ReaderNoKey, reliable());
    network.match_writer_side(writer, dead);
    network.write(writer, sample(1, 0, 100)).unwrap();
    network.run_for(Duration::from_secs(10));
    assert!(!network.writer(writer).all_acknowledged());
    let reminders = network.datagrams;
    network.run_for(Duration::from_secs(10));
    assert!(
        network.datagrams - reminders <= 11,
        "silent readers get one a second"
    );
    network.writer(writer).unmatch_reader(dead);
    assert!(network.writer(writer).all_acknowledged());
    assert_eq!(numbers(&mut network, reader), [1]);
}

#[test]
fn either_side_may_match_first() {
    for delay in [
        Duration::ZERO,
        Duration::from_micros(150),
        Duration::from_secs(3),
    ] {
        for writer_first in [true, false] {
            let mut network = Network::new(Conditions::PERFECT, 1);
            let writer = network.add_writer(EntityKind::WriterNoKey, reliable());
            let reader = network.add_reader(EntityKind::ReaderNoKey, reliable());
            if writer_first {
                network.match_writer_side(writer, reader);
            } else {
                network.match_reader_side(writer, reader);
            }
            network.run_for(delay);
            if writer_first {
                network.write(writer, sample(1, 0, 100)).unwrap();
                network.run_for(delay);
                network.match_reader_side(writer, reader);
            } else {
                network.match_writer_side(writer, reader);
                network.write(writer, sample(1, 0, 100)).unwrap();
            }
            network.write(writer, sample(2, 0, 100)).unwrap();
            network.run_until_acknowledged(writer);
            assert_eq!(
                numbers(&mut network, reader),
                [1, 2],
                "{delay:?} {writer_first}"
            );
        }
    }
}

#[test]
fn a_restarted_writer_goes_on() {
    let (mut network, writer, reader) = pair(Conditions::AWFUL, 7);
    for number in 1..=10 {
        network.write(writer, sample(number, 0, 100)).unwrap();
    }
    network.run_until_acknowledged(writer);
    let last = network.writer(writer).last_sequence();
    network.restart_writer(writer, last.next());
    network.match_writer_side(writer, reader);
    for number in 11..=20 {
        network.write(writer, sample(number, 0, 100)).unwrap();
    }
    network.run_until_acknowledged(writer);
    let received = numbers(&mut network, reader);
    assert_numbers(&received, 1..=20);
}
