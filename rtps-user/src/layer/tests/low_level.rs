//! Layers on top of a low-level layer that answers discovery messages.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::time::Duration;

use rtps_ebpf::abi::PEER_SUPERVISED;

use super::sim::{GROUP, Net, config, endpoint, prefix, reliable};
use super::{READER, SECOND, WRITER, matches, unmatched};
use crate::discovery::{EndpointData, ParticipantData};
use crate::layer::protocol::{FromLayer, ToLayer};
use crate::layer::{LayerConfig, StoreKey};
use crate::qos::{Liveliness, LivelinessKind};
use crate::wire::{
    self, AckNack, Data, EntityId, Guid, GuidPrefix, Heartbeat, InlineQos, KeyHash, MessageWriter,
    PayloadKind, SequenceNumber, SequenceNumberSet, StatusInfo,
};

/// Hosts of which those that `answers` names have a low-level layer that answers.
fn hosts(answers: &[bool]) -> Net {
    let mut net = Net::new(0);
    for (number, answers) in (1..).zip(answers) {
        if *answers {
            net.add_with_kernel(config(number));
        } else {
            net.add(config(number));
        }
    }
    net
}

/// The first with a low-level layer that answers, a writer on it and a reader on the second, matched.
fn matched() -> (Net, Guid, Guid) {
    let mut net = hosts(&[true, false]);
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    (net, writer, reader)
}

fn restarted(net: &mut Net) -> LayerConfig {
    let now = net.now;
    LayerConfig {
        kernel_discovery: true,
        count_age: net.kernel(0).count_age(now),
        ..config(1)
    }
}

fn sorted(mut guids: Vec<Guid>) -> Vec<Guid> {
    guids.sort();
    guids
}

#[test]
fn everything_is_discovered_whatever_the_network_does() {
    for loss in [0, 10, 30] {
        for answers in [[true, false], [true, true]] {
            let mut net = hosts(&answers);
            net.loss = loss;
            net.is_disorderly = true;
            let (a, b) = (net.attach(0), net.attach(1));
            let mut declared = [Vec::new(), Vec::new()];
            for serial in 1..=20 {
                declared[0].push(net.declare(0, endpoint(a, serial, WRITER)));
                declared[1].push(net.declare(1, endpoint(b, serial, READER)));
                net.run(SECOND / 20);
            }
            net.run(20 * SECOND);
            for (host, expected) in [(0, &declared[1]), (1, &declared[0])] {
                let found: BTreeSet<_> = matches(&net.replies(host)).into_iter().collect();
                let expected = expected.iter().copied().collect();
                assert_eq!(found, expected, "host {host} of {answers:?}, loss {loss}");
            }
            for reader in &declared[1][..10] {
                net.request(1, b, ToLayer::Withdraw(reader.entity));
            }
            net.run(20 * SECOND);
            let told = net.replies(0);
            for reader in &declared[1][..10] {
                let gone = unmatched(declared[0][0], *reader);
                assert!(told.contains(&gone), "{answers:?}, loss {loss}");
            }
            assert_eq!(net.hosts[0].layer.unacknowledged().count(), 0);
        }
    }
}

#[test]
fn the_low_level_layer_alone_makes_the_host_known() {
    let mut net = hosts(&[true, false]);
    let a = net.attach(0);
    let mut writers: Vec<_> = (1..=30)
        .map(|serial| net.declare(0, endpoint(a, serial, WRITER)))
        .collect();
    net.request(0, a, ToLayer::Withdraw(writers.remove(3).entity));
    net.hosts[1].is_connected = false;
    net.run(SECOND);
    net.hosts[0].is_stopped = true;
    net.hosts[1].is_connected = true;
    let b = net.attach(1);
    net.declare(1, endpoint(b, 1, READER));
    net.run(8 * SECOND);
    assert_eq!(sorted(matches(&net.replies(1))), writers);
    net.wake(0);
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)).len(), 29, "news were kept");
}

#[test]
fn nothing_is_acknowledged_that_could_not_be_handed_over() {
    let (mut net, writer, reader) = matched();
    net.hosts[0].is_stopped = true;
    net.kernel(0).capacity = 3;
    let mut readers = vec![reader];
    for serial in 2..=12 {
        readers.push(net.declare(1, endpoint(reader.entity.slot(), serial, READER)));
        net.run(SECOND / 10);
    }
    net.request(1, 1, ToLayer::Withdraw(reader.entity));
    net.run(SECOND);
    assert!(net.kernel(0).refused > 0);
    assert_ne!(net.hosts[1].layer.unacknowledged().count(), 0);
    net.wake(0);
    net.run(10 * SECOND);
    let told = net.replies(0);
    assert_eq!(sorted(matches(&told)), readers[1..]);
    assert!(told.contains(&unmatched(writer, reader)));
    assert_eq!(net.hosts[1].layer.unacknowledged().count(), 0);
}

#[test]
fn a_restart_goes_unnoticed() {
    let (mut net, writer, reader) = matched();
    let samples = net.endpoint_samples;
    let kept = net.kernel(0).peers.clone();
    let next = restarted(&mut net);
    net.restart(0, next);
    assert_eq!(net.resume(0, 1), 1);
    assert_eq!(matches(&net.replies(0)), [reader]);
    let progress = |peer: &rtps_ebpf::abi::Peer| peer.writers.map(|writer| writer.next);
    for (prefix, peer) in kept {
        assert_eq!(progress(&peer), progress(&net.kernel(0).peers[&prefix]));
    }
    net.declare(0, endpoint(1, 1, WRITER));
    net.run(40 * SECOND);
    assert_eq!(net.endpoint_samples, samples, "nothing is sent again");
    assert_eq!(net.replies(1), []);
    let second = net.declare(1, endpoint(1, 2, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [second]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    net.hosts[0].layer.detach(net.now, 1);
    net.run(SECOND);
    assert_eq!(
        net.replies(1),
        [unmatched(reader, writer), unmatched(second, writer)]
    );
}

#[test]
fn a_restart_in_the_middle_loses_nothing() {
    for loss in [0, 20] {
        let mut net = hosts(&[true, false]);
        net.loss = loss;
        net.is_disorderly = true;
        let (a, b) = (net.attach(0), net.attach(1));
        let mut declared = [Vec::new(), Vec::new()];
        for serial in 1..=20 {
            if serial % 7 == 0 {
                let next = restarted(&mut net);
                net.restart(0, next);
                net.resume(0, a);
                for earlier in 1..serial {
                    net.declare(0, endpoint(a, earlier, WRITER));
                }
            }
            declared[0].push(net.declare(0, endpoint(a, serial, WRITER)));
            declared[1].push(net.declare(1, endpoint(b, serial, READER)));
            net.run(SECOND / 50);
        }
        net.run(20 * SECOND);
        for (host, expected) in [(0, &declared[1]), (1, &declared[0])] {
            let status = net.hosts[host].layer.status();
            let [other] = status.participants.as_slice() else {
                panic!("{:?}", status.participants);
            };
            let found: BTreeSet<_> = other
                .endpoints
                .iter()
                .map(|known| known.guid.clone())
                .collect();
            let expected = expected.iter().map(Guid::to_string).collect();
            assert_eq!(found, expected, "host {host}, loss {loss}");
            assert_eq!(net.hosts[host].layer.unacknowledged().count(), 0);
        }
    }
}

#[test]
fn a_flood_of_inventions_does_not_push_out_the_known() {
    let mut net = Net::new(0);
    let mut limited = config(1);
    limited.limits.discovery.participants = 50;
    net.add_with_kernel(limited);
    net.add(config(2));
    net.run(SECOND);
    let kept = net.hosts[0].store.len();
    for number in 1000..4000 {
        let ([.., high, low], invented) = (u32::to_be_bytes(number), prefix(number as usize));
        let source = ([10, 6, high, low], 7410).into();
        net.inject(source, GROUP, announcement_of(invented, source));
        net.run(Duration::from_micros(100));
    }
    let participants = net.hosts[0].layer.status().participants;
    assert_eq!(participants.len(), 50);
    let known = prefix(2).to_string();
    assert!(
        participants
            .iter()
            .any(|participant| participant.prefix == known)
    );
    assert_eq!(net.hosts[0].peers, [prefix(2)].into());
    assert_eq!(net.hosts[0].store.len(), kept);
    assert!(net.kernel(0).strangers.len() <= 50, "both know the same");
}

#[test]
fn what_a_layer_took_and_lost_is_asked_for_again_by_the_next() {
    let (mut net, _, reader) = matched();
    net.hosts[0].is_stopped = true;
    let second = net.declare(1, endpoint(1, 2, READER));
    net.run(SECOND);
    net.hosts[0].is_stopped = false;
    // Taken from the low-level layer, but not dealt with.
    net.kernel(0).news.clear();
    let next = restarted(&mut net);
    net.restart(0, next);
    net.resume(0, 1);
    net.declare(0, endpoint(1, 1, WRITER));
    // The writer thinks that all is acknowledged; the next news tells.
    let third = net.declare(1, endpoint(1, 3, READER));
    net.run(10 * SECOND);
    assert_eq!(matches(&net.replies(0)), [reader, second, third]);
}

#[test]
fn the_steady_state_leaves_the_layer_alone() {
    let mut net = hosts(&[true; 20]);
    for host in 0..20 {
        let slot = net.attach(host);
        net.declare(
            host,
            endpoint(slot, 1, if host == 0 { READER } else { WRITER }),
        );
        net.run(SECOND / 7);
    }
    net.run(30 * SECOND);
    net.hosts[0].wakeups = 0;
    net.run(60 * SECOND);
    assert!(net.hosts[0].wakeups <= 20, "{}", net.hosts[0].wakeups);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 19);
    for host in 1..20 {
        net.hosts[host].is_connected = host % 2 == 0;
    }
    net.run(21 * SECOND);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 9);
    assert_eq!(net.kernel(0).peers.len(), 9);
}

const STRANGER: GuidPrefix = GuidPrefix([0x99; 12]);

fn address() -> SocketAddr {
    ([10, 9, 9, 9], 7410).into()
}

fn announcement() -> Vec<u8> {
    announcement_of(STRANGER, address())
}

fn announcement_of(participant: GuidPrefix, address: SocketAddr) -> Vec<u8> {
    let mut data = ParticipantData::new(participant);
    data.metatraffic_unicast = vec![address];
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, participant).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sequence: SequenceNumber(1),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload: &payload,
    });
    bytes
}

/// An ACKNACK of the stranger for the first host.
fn acknack(count: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut message = MessageWriter::new(&mut bytes, STRANGER);
    message.info_destination(prefix(1));
    message.acknack(&AckNack {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        state: SequenceNumberSet::empty(SequenceNumber(1)),
        count,
        is_final: true,
    });
    bytes
}

#[test]
fn a_stranger_costs_nothing_until_it_is_proven() {
    let mut net = hosts(&[true]);
    net.run(30 * SECOND);
    let (sent, kept) = (net.sent, net.hosts[0].store.len());
    let inject = |net: &mut Net, bytes| {
        net.inject(address(), GROUP, bytes);
        net.run(Duration::from_millis(500));
    };
    inject(&mut net, announcement());
    assert_eq!(net.sent - sent, 1, "the low-level layer's answer");
    assert_eq!(net.hosts[0].layer.status().participants.len(), 1);
    assert_eq!(net.hosts[0].store.len(), kept);
    assert!(net.hosts[0].peers.is_empty());

    inject(&mut net, acknack(1));
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
    let key = StoreKey::participant(STRANGER);
    assert!(net.hosts[0].store.contains_key(&key));
    assert!(net.kernel(0).strangers.is_empty());
}

#[test]
fn who_was_forgotten_here_becomes_known_again() {
    let mut net = hosts(&[true]);
    net.inject(address(), GROUP, announcement());
    net.run(31 * SECOND);
    assert_eq!(net.hosts[0].layer.status().participants, []);
    assert!(net.kernel(0).strangers.is_empty());
    net.inject(address(), GROUP, announcement());
    net.run(SECOND);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 1);
    // The layer alone forgets it.
    let next = restarted(&mut net);
    net.restart(0, next);
    net.inject(address(), GROUP, acknack(1));
    net.run(SECOND);
    assert!(
        net.kernel(0).strangers.is_empty(),
        "it has to say who it is"
    );
    net.inject(address(), GROUP, announcement());
    net.inject(address(), GROUP, acknack(2));
    net.run(SECOND);
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
}

/// What the stranger says of its one writer.
fn publication() -> (Guid, Vec<u8>) {
    let guid = Guid::new(STRANGER, EntityId::of_app(1, 1, WRITER));
    let data = EndpointData {
        guid,
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: reliable(),
    };
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, STRANGER).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        sequence: SequenceNumber(1),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload: &payload,
    });
    (guid, bytes)
}

fn farewell() -> Vec<u8> {
    let participant = Guid::new(STRANGER, EntityId::PARTICIPANT);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, STRANGER).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sequence: SequenceNumber(2),
        inline_qos: InlineQos {
            key_hash: Some(KeyHash(participant.to_bytes())),
            status: StatusInfo {
                disposed: true,
                unregistered: true,
                filtered: false,
            },
            ..InlineQos::default()
        },
        filters: None,
        kind: PayloadKind::None,
        payload: &[],
    });
    bytes
}

#[test]
fn who_says_goodbye_and_is_back_at_once_is_taken_in_again() {
    for answers in [true, false] {
        let mut net = hosts(&[answers]);
        let slot = net.attach(0);
        let reader = net.declare(0, endpoint(slot, 1, READER));
        let (writer, publication) = publication();
        let come = [announcement(), acknack(1), publication];
        let say = |net: &mut Net, messages: &[Vec<u8>]| {
            for bytes in messages {
                net.inject(address(), GROUP, bytes.clone());
            }
        };
        say(&mut net, &come);
        net.run(SECOND);
        assert_eq!(matches(&net.replies(0)), [writer]);
        for _ in 0..3 {
            say(&mut net, &[farewell()]);
            say(&mut net, &come);
            net.run(SECOND);
            let replies = net.replies(0);
            assert!(replies.contains(&unmatched(reader, writer)));
            assert_eq!(matches(&replies), [writer]);
        }
        // What the layer learns late has happened before.
        net.hosts[0].is_stopped = true;
        say(&mut net, &[farewell()]);
        say(&mut net, &come);
        net.run(SECOND);
        net.hosts[0].is_stopped = false;
        net.run(SECOND);
        say(&mut net, &come);
        net.run(SECOND);
        assert_eq!(matches(&net.replies(0)).last(), Some(&writer));
    }
}

#[test]
fn who_acknowledges_without_naming_us_is_proven() {
    let mut net = hosts(&[true]);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, STRANGER).acknack(&AckNack {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        state: SequenceNumberSet::empty(SequenceNumber(1)),
        count: 1,
        is_final: true,
    });
    net.inject(address(), GROUP, announcement());
    net.inject(address(), GROUP, bytes);
    net.run(SECOND);
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
    assert!(net.kernel(0).strangers.is_empty());
}

#[test]
fn where_the_low_level_layer_may_not_answer_the_layer_does() {
    let mut net = hosts(&[true, false]);
    net.kernel(0).may_answer = false;
    net.loss = 20;
    let (a, b) = (net.attach(0), net.attach(1));
    let writers: Vec<_> = (1..=10)
        .map(|serial| net.declare(0, endpoint(a, serial, WRITER)))
        .collect();
    let mut supervised = endpoint(b, 1, READER);
    supervised.topic = "Circle".to_owned();
    net.declare(1, supervised);
    let reader = net.declare(1, endpoint(b, 2, READER));
    net.request(1, b, ToLayer::AssertLiveliness);
    net.run(20 * SECOND);
    assert_eq!(
        sorted(matches(&net.replies(1)))
            .into_iter()
            .collect::<BTreeSet<_>>(),
        writers.into_iter().collect()
    );
    let found: BTreeSet<_> = matches(&net.replies(0)).into_iter().collect();
    assert_eq!(found, [reader].into());
    for host in 0..2 {
        assert_eq!(net.hosts[host].layer.unacknowledged().count(), 0, "{host}");
    }
}

#[test]
fn signs_of_life_come_through_where_an_app_waits_for_them() {
    let mut net = hosts(&[true, false]);
    let (a, b) = (net.attach(0), net.attach(1));
    let mut writer = endpoint(b, 1, WRITER);
    writer.qos.liveliness = Liveliness {
        kind: LivelinessKind::Automatic,
        lease: wire::Duration {
            seconds: 3,
            fraction: 0,
        },
    };
    net.declare(1, writer);
    net.run(5 * SECOND);
    let signs = |net: &mut Net| {
        let told = net.replies(0);
        let is_sign = |message: &FromLayer| matches!(message, FromLayer::Liveliness { .. });
        told.iter().filter(|(_, message)| is_sign(message)).count()
    };
    let flags = |net: &mut Net| net.kernel(0).peers[&prefix(2)].flags & PEER_SUPERVISED;
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    let reader = net.declare(0, endpoint(a, 1, READER));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (9, PEER_SUPERVISED));
    net.request(0, a, ToLayer::Withdraw(reader.entity));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    net.run(SECOND / 2);
    assert_eq!(net.hosts[1].layer.unacknowledged().count(), 0);
}

#[test]
fn numbers_that_the_low_level_layer_cannot_know_it_is_told() {
    let (mut net, _, reader) = matched();
    let writer = Guid::new(prefix(2), EntityId::SEDP_PUBLICATIONS_WRITER);
    let mut bytes = Vec::new();
    let mut message = MessageWriter::new(&mut bytes, writer.prefix);
    message.info_destination(prefix(1));
    message.heartbeat(&Heartbeat {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: writer.entity,
        first: SequenceNumber(8),
        last: SequenceNumber(7),
        count: 10_000,
        is_final: false,
        liveliness: false,
        group: None,
    });
    let from = net.hosts[1].address;
    net.inject(from, net.hosts[0].address, bytes);
    net.run(Duration::from_millis(1));
    let peer = net.kernel(0).peers[&reader.prefix];
    assert_eq!(peer.writers[0].next, 8);
}

#[test]
fn without_binding_any_address_will_do() {
    for binds in [true, false] {
        let mut net = Net::new(0);
        net.add_with_kernel(LayerConfig {
            bind_addresses: binds,
            ..config(1)
        });
        net.inject(address(), GROUP, announcement());
        net.inject(address(), GROUP, acknack(1));
        net.run(SECOND);
        let elsewhere = ([10, 9, 9, 10], 7410).into();
        let before = net.kernel(0).peers[&STRANGER].last_seen_ns;
        net.inject(elsewhere, GROUP, acknack(2));
        net.run(SECOND);
        let is_renewed = net.kernel(0).peers[&STRANGER].last_seen_ns > before;
        assert_eq!(is_renewed, !binds);
        let layer = &mut net.hosts[0].layer;
        layer
            .handle_datagram(net.now, elsewhere, &acknack(3))
            .unwrap();
        assert_eq!(layer.status().refused.foreign > 0, binds);
    }
}

#[test]
fn a_number_that_the_low_level_layer_has_lost_is_told_again() {
    let (mut net, _, reader) = matched();
    let writer = Guid::new(prefix(2), EntityId::SEDP_PUBLICATIONS_WRITER);
    net.hosts[1].is_connected = false;
    let (from, to) = (net.hosts[1].address, net.hosts[0].address);
    let hb = |first, last, count| {
        let mut bytes = Vec::new();
        let mut message = MessageWriter::new(&mut bytes, writer.prefix);
        message.info_destination(prefix(1));
        message.heartbeat(&Heartbeat {
            reader: EntityId::SEDP_PUBLICATIONS_READER,
            writer: writer.entity,
            first: SequenceNumber(first),
            last: SequenceNumber(last),
            count,
            is_final: false,
            liveliness: false,
            group: None,
        });
        bytes
    };
    let data = |n| {
        let mut bytes = Vec::new();
        let mut message = MessageWriter::new(&mut bytes, writer.prefix);
        message.info_destination(prefix(1));
        message.data(&Data {
            reader: EntityId::SEDP_PUBLICATIONS_READER,
            writer: writer.entity,
            sequence: SequenceNumber(n),
            inline_qos: InlineQos::default(),
            filters: None,
            kind: PayloadKind::Data,
            payload: &[0, 3, 0, 0, 1, 0, 0, 0],
        });
        bytes
    };
    net.inject(from, to, hb(8, 7, 10_000));
    net.run(Duration::from_millis(100));
    net.kernel(0).peers.get_mut(&reader.prefix).unwrap().writers[0].next = 1;
    for turn in 0..20 {
        net.inject(from, to, data(8));
        net.run(Duration::from_millis(100));
        net.inject(from, to, hb(8, 8, 10_001 + turn));
        net.run(Duration::from_millis(200));
    }
    let peer = net.kernel(0).peers[&reader.prefix];
    assert_eq!(peer.writers[0].next, 9);
}

/// A remote participant that we have lost still knows us, and holds all of its samples for acknowledged.
#[test]
fn who_is_found_again_is_asked_for_its_endpoints() {
    let mut net = hosts(&[true, true]);
    let (a, b) = (net.attach(0), net.attach(1));
    net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    let key = KeyHash(Guid::new(prefix(2), EntityId::PARTICIPANT).to_bytes());
    let mut farewell = Vec::new();
    MessageWriter::new(&mut farewell, prefix(2)).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sequence: SequenceNumber(9),
        inline_qos: InlineQos {
            key_hash: Some(key),
            status: StatusInfo {
                disposed: true,
                ..StatusInfo::default()
            },
            ..InlineQos::default()
        },
        filters: None,
        kind: PayloadKind::None,
        payload: &[],
    });
    let (from, to) = (net.hosts[1].address, net.hosts[0].address);
    net.inject(from, to, farewell);
    net.run(30 * SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
}
