//! Spoofed and senseless submessages: nothing panics, takes long, or stops the communication of others.

use std::time::Duration;

use rtps_user::qos::{Durability, History, Qos, Reliability};
use rtps_user::wire::{
    AckNack, EntityId, EntityKind, FragmentNumberSet, Gap, Guid, GuidPrefix, Heartbeat,
    HeartbeatFrag, MessageWriter, NackFrag, SequenceNumber, SequenceNumberSet,
};

use crate::network::{Conditions, Network};
use crate::random::{Random, seeds};
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
    let writer = network.add_writer(EntityKind::WriterWithKey, durable());
    let reader = network.add_reader(EntityKind::ReaderWithKey, durable());
    network.connect(writer, reader);
    (network, writer, reader)
}

fn message(from: GuidPrefix, write: impl FnOnce(&mut MessageWriter<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut MessageWriter::new(&mut bytes, from));
    bytes
}

/// Numbers at which arithmetic goes wrong.
fn odd_number(random: &mut Random) -> i64 {
    let choices = [
        0,
        1,
        2,
        50,
        255,
        256,
        1 << 31,
        1 << 32,
        1 << 40,
        i64::MAX - 300,
    ];
    choices[random.below(choices.len() as u64) as usize]
}

fn odd_count(random: &mut Random) -> i32 {
    let choices = [0, 1, -1, i32::MAX, i32::MIN, 1000];
    choices[random.below(choices.len() as u64) as usize]
}

fn odd_set(random: &mut Random) -> SequenceNumberSet {
    let base = SequenceNumber(odd_number(random));
    let members: Vec<_> = (0..256).filter(|_| random.percent(50)).collect();
    SequenceNumberSet::from_members(base, members.into_iter().map(|bit| base.plus(bit)))
}

/// A message as an attacker would spoof it in the name of `reader`, for `writer`.
fn against_writer(random: &mut Random, writer: Guid, reader: Guid) -> Vec<u8> {
    message(reader.prefix, |message| {
        for _ in 0..4 {
            message.acknack(&AckNack {
                reader: reader.entity,
                writer: writer.entity,
                state: odd_set(random),
                count: odd_count(random),
                is_final: random.percent(50),
            });
            let base = (odd_number(random) as u32).clamp(1, u32::MAX - 300);
            let members: Vec<_> = (0..256).filter(|_| random.percent(50)).collect();
            let members = members.into_iter().map(|bit| base + bit);
            message.nack_frag(&NackFrag {
                reader: reader.entity,
                writer: writer.entity,
                sequence: SequenceNumber(odd_number(random).max(1)),
                missing: FragmentNumberSet::from_members(base, members),
                count: odd_count(random),
            });
        }
    })
}

/// A message as an attacker would spoof it in the name of `writer`, for all readers.
fn against_reader(random: &mut Random, writer: Guid) -> Vec<u8> {
    message(writer.prefix, |message| {
        for _ in 0..4 {
            let first = SequenceNumber(odd_number(random));
            message.heartbeat(&Heartbeat {
                reader: EntityId::UNKNOWN,
                writer: writer.entity,
                first,
                last: SequenceNumber(odd_number(random)).max(first.previous()),
                count: odd_count(random),
                is_final: random.percent(50),
                liveliness: random.percent(50),
                group: None,
            });
            let mut list = odd_set(random);
            let start = SequenceNumber(odd_number(random).max(1));
            list.base = list.base.max(start);
            message.gap(&Gap {
                reader: EntityId::UNKNOWN,
                writer: writer.entity,
                start,
                list,
            });
            message.heartbeat_frag(&HeartbeatFrag {
                reader: EntityId::UNKNOWN,
                writer: writer.entity,
                sequence: SequenceNumber(odd_number(random).max(1)),
                last_fragment: (odd_number(random) as u32).max(1),
                count: odd_count(random),
            });
        }
    })
}

#[test]
fn a_writer_withstands_spoofed_acknowledgements() {
    for seed in seeds(20) {
        let (mut network, writer, reader) = pair(Conditions::PERFECT, seed);
        let honest = network.add_reader(EntityKind::ReaderWithKey, durable());
        network.connect(writer, honest);
        for number in 1..=50 {
            let size = if number % 10 == 0 { 20_000 } else { 60 };
            network.write(writer, sample(number, 0, size)).unwrap();
            let mut random = network.random.clone();
            let bytes = against_writer(&mut random, writer, reader);
            network.random = random;
            network.inject(writer, &bytes);
            network.run_for(Duration::from_millis(1));
        }
        network.run_for(Duration::from_secs(5));
        let received = network.take(honest);
        let numbers: Vec<_> = received.iter().map(|s| number(&s.payload)).collect();
        assert_numbers(&numbers, 1..=50);
    }
}

#[test]
fn one_request_is_not_answered_with_more_than_was_asked_for() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 1);
    for number in 1..=1000 {
        network.write_blocking(writer, sample(number, 0, 1000));
    }
    network.run_until_acknowledged(writer);
    let before = network.datagrams;
    let base = SequenceNumber(1);
    let all = (0..256).map(|bit| base.plus(bit));
    let state = SequenceNumberSet::from_members(base, all);
    for count in 0..100 {
        let bytes = message(reader.prefix, |message| {
            message.acknack(&AckNack {
                reader: reader.entity,
                writer: writer.entity,
                state,
                count: 1_000_000 + count,
                is_final: false,
            });
        });
        network.inject(writer, &bytes);
    }
    let answers = network.datagrams - before;
    assert!(answers <= 257, "{answers} datagrams for 100 equal requests");
    network.run_for(Duration::from_secs(1));
}

#[test]
fn unknown_readers_get_no_answer() {
    let (mut network, writer, _) = pair(Conditions::PERFECT, 1);
    network.write(writer, sample(1, 0, 100)).unwrap();
    network.run_until_acknowledged(writer);
    let before = network.datagrams;
    let stranger = Guid::new(GuidPrefix([9; 12]), EntityId([1, 0, 2, 7]));
    for seed in seeds(100) {
        let bytes = against_writer(&mut Random::new(seed), writer, stranger);
        network.inject(writer, &bytes);
    }
    network.run_for(Duration::from_secs(1));
    assert_eq!(network.datagrams, before);
}

#[test]
fn a_reader_withstands_spoofed_ranges() {
    for seed in seeds(20) {
        let (mut network, writer, reader) = pair(Conditions::PERFECT, seed);
        network.is_hostile = true;
        let honest = network.add_writer(EntityKind::WriterWithKey, durable());
        network.connect(honest, reader);
        for number in 1..=50 {
            network.write(honest, sample(number, 0, 60)).unwrap();
            network.write(writer, sample(number, 0, 60)).unwrap();
            let mut random = network.random.clone();
            let bytes = against_reader(&mut random, writer);
            network.random = random;
            network.inject(reader, &bytes);
            network.run_for(Duration::from_millis(1));
        }
        network.run_for(Duration::from_secs(5));
        let samples = network.take(reader);
        let from_honest = samples.iter().filter(|s| s.info.writer == honest);
        let numbers: Vec<_> = from_honest.map(|s| number(&s.payload)).collect();
        assert_numbers(&numbers, 1..=50);
    }
}

#[test]
fn truncated_and_garbled_messages_do_no_harm() {
    let (mut network, writer, reader) = pair(Conditions::PERFECT, 4);
    network.write(writer, sample(1, 0, 200)).unwrap();
    let original = network.sniff().last().unwrap().to_vec();
    for length in 0..original.len() {
        network.inject(reader, &original[..length]);
        network.inject(writer, &original[..length]);
    }
    for _ in 0..5000 {
        let mut garbled = original.clone();
        // The header stays as it is, or else everything would be refused at its first byte.
        let at = 20 + network.random.below(garbled.len() as u64 - 20) as usize;
        garbled[at] = network.random.next() as u8;
        network.inject(reader, &garbled);
        network.inject(writer, &garbled);
    }
    network.run_for(Duration::from_secs(1));
}
