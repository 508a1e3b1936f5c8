//! The life of instances across the network: dispose, unregister, a writer that goes (DDS 1.4 section 2.2.2.5.1).

use rtps_user::history::ChangeKind;
use rtps_user::qos::{Durability, History, Qos, Reliability};
use rtps_user::reader::{InstanceState, Sample};
use rtps_user::wire::{EntityKind, Guid};

use crate::network::{Conditions, Network};
use crate::random::seeds;
use crate::sample::{instance, not_alive, sample};

fn durable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        durability: Durability::TransientLocal,
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn pair(seed: u64) -> (Network, Guid, Guid) {
    let mut network = Network::new(Conditions::AWFUL, seed);
    let writer = network.add_writer(EntityKind::WriterWithKey, durable());
    let reader = network.add_reader(EntityKind::ReaderWithKey, durable());
    network.connect(writer, reader);
    (network, writer, reader)
}

/// The state that the last sample of an instance shows, and whether that sample has data.
fn last_of(samples: &[Sample], key: u8) -> Option<(InstanceState, bool)> {
    let mut of_key = samples
        .iter()
        .filter(|sample| sample.info.instance == instance(key));
    let last = of_key.next_back()?;
    Some((last.info.instance_state, last.info.valid_data))
}

#[test]
fn disposals_and_unregistrations_arrive() {
    for seed in seeds(10) {
        let (mut network, writer, reader) = pair(seed);
        for key in 1..=4 {
            network
                .write(writer, sample(u32::from(key), key, 50))
                .unwrap();
        }
        for (key, kind) in [
            (1, ChangeKind::Disposed),
            (2, ChangeKind::Unregistered),
            (3, ChangeKind::DisposedUnregistered),
        ] {
            network.write(writer, not_alive(kind, key)).unwrap();
        }
        network.run_until_acknowledged(writer);
        let samples = network.take(reader);
        let expected = [
            (1, InstanceState::NotAliveDisposed, false),
            (2, InstanceState::NotAliveNoWriters, false),
            (3, InstanceState::NotAliveDisposed, false),
            (4, InstanceState::Alive, true),
        ];
        for (key, state, has_data) in expected {
            assert_eq!(last_of(&samples, key), Some((state, has_data)), "{key}");
        }
    }
}

#[test]
fn an_instance_can_be_reborn() {
    let (mut network, writer, reader) = pair(1);
    network.write(writer, sample(1, 1, 50)).unwrap();
    network
        .write(writer, not_alive(ChangeKind::Disposed, 1))
        .unwrap();
    network.write(writer, sample(2, 1, 50)).unwrap();
    network.run_until_acknowledged(writer);
    let samples = network.take(reader);
    assert_eq!(last_of(&samples, 1), Some((InstanceState::Alive, true)));
    let generations = samples.last().unwrap().info.disposed_generation_count;
    assert_eq!(generations, 1);
}

#[test]
fn a_writer_that_goes_leaves_instances_without_writers() {
    let (mut network, writer, reader) = pair(2);
    network.write(writer, sample(1, 1, 50)).unwrap();
    network.run_until_acknowledged(writer);
    network.disconnect(writer, reader);
    let samples = network.take(reader);
    let (state, _) = last_of(&samples, 1).unwrap();
    assert_eq!(state, InstanceState::NotAliveNoWriters);
}

#[test]
fn unregistered_instances_leave_the_history() {
    let (mut network, writer, _) = pair(3);
    for key in 1..=100 {
        network.write(writer, sample(1, key, 50)).unwrap();
        network
            .write(writer, not_alive(ChangeKind::DisposedUnregistered, key))
            .unwrap();
    }
    network.write(writer, sample(7, 200, 50)).unwrap();
    network.run_until_acknowledged(writer);
    let late = network.add_reader(EntityKind::ReaderWithKey, durable());
    network.connect(writer, late);
    network.run_until_acknowledged(writer);
    let samples = network.take(late);
    assert_eq!(samples.len(), 1);
    assert_eq!(last_of(&samples, 200), Some((InstanceState::Alive, true)));
}
