//! What the network may bring beside what is meant well.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use super::sim::{GROUP, Net, config, endpoint, prefix};
use super::{READER, SECOND, WRITER, matched, matches};
use crate::discovery::{DiscoveryLimits, EndpointData, ParticipantData};
use crate::layer::Limits;
use crate::layer::protocol::MAX_PROTOCOL_MESSAGE;
use crate::qos::Qos;
use crate::wire::{
    Data, DataFragment, EntityId, Guid, GuidPrefix, InlineQos, KeyHash, MessageWriter, PayloadKind,
    SequenceNumber, StatusInfo,
};

fn address(number: usize) -> SocketAddr {
    let [.., high, low] = number.to_be_bytes();
    ([10, 6, high, low], 7410).into()
}

fn message(source: GuidPrefix, writer: EntityId, sequence: i64, payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, source).data(&Data {
        reader: EntityId::UNKNOWN,
        writer,
        sequence: SequenceNumber(sequence),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload,
    });
    bytes
}

/// Has an invented participant announce itself.
fn announce(net: &mut Net, number: usize) -> Vec<u8> {
    let mut data = ParticipantData::new(prefix(number));
    data.metatraffic_unicast = vec![address(number)];
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let bytes = message(prefix(number), EntityId::SPDP_WRITER, 1, &payload);
    net.inject(address(number), GROUP, bytes.clone());
    bytes
}

/// Has an invented participant announce a writer.
fn announce_endpoint(net: &mut Net, number: usize, sequence: i64) -> Vec<u8> {
    let entity = EntityId::of_app(1, sequence as u16, WRITER);
    let data = EndpointData {
        guid: Guid::new(prefix(number), entity),
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: Qos::default(),
    };
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
    let bytes = message(prefix(number), writer, sequence, &payload);
    net.inject(address(number), net.hosts[0].address, bytes.clone());
    bytes
}

#[test]
fn a_flood_of_inventions_neither_fills_the_memory_nor_harms_the_known() {
    let mut net = Net::new(0);
    for number in 1..=2 {
        let mut config = config(number);
        config.limits.discovery.participants = 50;
        net.add(config);
    }
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(1)), [writer]);
    let sent = net.sent;
    for number in 1000..3000 {
        announce(&mut net, number);
        net.run(Duration::from_millis(1));
    }
    assert_eq!(net.replies(1), []);
    let status = net.hosts[1].layer.status();
    assert_eq!(status.participants.len(), 50);
    assert!(status.refused.participants > 1900);
    let answers = (net.sent - sent) / 2;
    assert!(answers < 20 * 2000, "{answers} datagrams");
    net.run(60 * SECOND);
    assert_eq!(net.replies(1), []);
}

#[test]
fn malformed_announcements_are_survived_and_counted() {
    let mut net = Net::new(1);
    let bytes = announce(&mut net, 1000);
    for length in 0..bytes.len() {
        net.inject(address(1000), GROUP, bytes[..length].to_vec());
    }
    for at in 0..bytes.len() {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0xff;
        net.inject(address(1000), GROUP, bytes);
    }
    net.run(SECOND);
    assert!(net.hosts[0].layer.status().refused.malformed > 10);
}

#[test]
fn malformed_endpoints_are_survived_and_counted() {
    let mut net = Net::new(1);
    announce(&mut net, 1000);
    let bytes = announce_endpoint(&mut net, 1000, 1);
    let payload = &bytes[44..];
    let mut sequence = 1;
    let mut inject = |net: &mut Net, payload: &[u8]| {
        sequence += 1;
        let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
        let bytes = message(prefix(1000), writer, sequence, payload);
        net.inject(address(1000), net.hosts[0].address, bytes);
    };
    for length in 4..payload.len() {
        inject(&mut net, &payload[..length]);
    }
    for at in 0..payload.len() {
        let mut payload = payload.to_vec();
        payload[at] ^= 0xff;
        inject(&mut net, &payload);
    }
    net.run(SECOND);
    let status = net.hosts[0].layer.status();
    assert!(status.refused.malformed > 10);
    assert!(!status.participants[0].endpoints.is_empty());
}

#[test]
fn who_announces_too_many_endpoints_is_not_listened_to_any_more() {
    let mut net = Net::new(0);
    let mut config = config(1);
    config.limits = Limits {
        discovery: DiscoveryLimits {
            endpoints_per_participant: 10,
            ..DiscoveryLimits::default()
        },
        ..Limits::default()
    };
    net.add(config);
    announce(&mut net, 1000);
    for sequence in 1..=100 {
        announce_endpoint(&mut net, 1000, sequence);
    }
    net.run(SECOND);
    let status = net.hosts[0].layer.status();
    assert_eq!(status.refused.endpoints, 1);
    assert!(status.participants[0].endpoints.len() <= 10);
}

#[test]
fn nobody_speaks_for_a_participant_from_elsewhere() {
    let (mut net, _, _) = matched();
    let mut impostor = ParticipantData::new(prefix(1));
    impostor.default_unicast = vec![address(1000)];
    let mut payload = Vec::new();
    impostor.encode(&mut payload);
    let bytes = message(prefix(1), EntityId::SPDP_WRITER, 2, &payload);
    net.inject(address(1000), GROUP, bytes);
    net.run(SECOND);
    assert_eq!(net.replies(1), []);
    assert_eq!(net.hosts[1].layer.status().refused.foreign, 1);
}

#[test]
fn nobody_makes_us_send_to_others() {
    let mut net = Net::new(2);
    net.run(SECOND);
    let mut invented = ParticipantData::new(prefix(1000));
    let victim = net.hosts[1].address;
    invented.metatraffic_unicast = vec![victim];
    let mut payload = Vec::new();
    invented.encode(&mut payload);
    let bytes = message(prefix(1000), EntityId::SPDP_WRITER, 1, &payload);
    let to = net.hosts[0].address;
    net.inject(address(1000), to, bytes);
    net.run(10 * SECOND);
    let status = net.hosts[0].layer.status();
    let known = status.participants.iter();
    let invented = known.filter(|known| known.metatraffic.contains(&victim));
    // Only the one that really is there.
    assert_eq!(invented.count(), 1);
    assert_eq!(status.participants.len(), 2);
}

#[test]
fn nobody_ends_a_match_of_others() {
    let (mut net, writer, _) = matched();
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, writer.prefix).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        sequence: SequenceNumber(2),
        inline_qos: InlineQos {
            key_hash: Some(KeyHash(writer.to_bytes())),
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
    let to = net.hosts[1].address;
    net.inject(address(666), to, bytes.clone());
    net.run(SECOND);
    assert_eq!(net.replies(1), []);
    assert_eq!(net.hosts[1].layer.status().refused.foreign, 1);
    let from = net.hosts[0].address;
    net.inject(from, to, bytes);
    net.run(SECOND);
    assert_eq!(net.replies(1).len(), 1, "its own word counts");
}

#[test]
fn an_announcement_is_not_echoed_for_ever() {
    let mut net = Net::new(1);
    let slot = net.attach(0);
    net.declare(0, endpoint(slot, 1, WRITER));
    net.run(10 * SECOND);
    let count = |net: &mut Net| {
        let before = net.sent;
        net.run(600 * SECOND);
        net.sent - before
    };
    let quiet = count(&mut net);
    let mut invented = ParticipantData::new(prefix(1000));
    invented.lease = crate::wire::Duration::INFINITE;
    invented.metatraffic_unicast = vec![address(77)];
    let mut payload = Vec::new();
    invented.encode(&mut payload);
    let bytes = message(prefix(1000), EntityId::SPDP_WRITER, 1, &payload);
    net.inject(address(1000), GROUP, bytes);
    let disturbed = count(&mut net);
    assert!(disturbed > quiet, "it is answered");
    assert!(disturbed < quiet + 200, "{disturbed} instead of {quiet}");
    assert_eq!(count(&mut net), quiet);
}

#[test]
fn what_is_announced_never_outgrows_the_messages_to_apps() {
    let mut net = Net::new(1);
    let slot = net.attach(0);
    net.declare(0, endpoint(slot, 1, READER));
    announce(&mut net, 1000);
    let data = EndpointData {
        guid: Guid::new(prefix(1000), EntityId::of_app(1, 1, WRITER)),
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: Qos {
            user_data: vec![1; 60_000],
            topic_data: vec![1; 60_000],
            group_data: vec![1; 60_000],
            ..super::sim::reliable()
        },
    };
    let mut sample = Vec::new();
    data.encode(&mut sample);
    let fragment_size = 1300;
    for fragment in 1..=sample.len().div_ceil(fragment_size) {
        let mut bytes = Vec::new();
        MessageWriter::new(&mut bytes, prefix(1000)).data_fragment(&DataFragment {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SEDP_PUBLICATIONS_WRITER,
            sequence: SequenceNumber(1),
            fragment: fragment as u32,
            fragment_size: fragment_size as u16,
            inline_qos: InlineQos::default(),
            kind: PayloadKind::Data,
            sample: &sample,
        });
        let to = net.hosts[0].address;
        net.inject(address(1000), to, bytes);
        net.run(Duration::from_millis(1));
    }
    let replies = net.replies(0);
    assert_eq!(matches(&replies), [data.guid]);
    for (_, message) in replies {
        let length = postcard::to_stdvec(&message).unwrap().len();
        assert!(length <= MAX_PROTOCOL_MESSAGE, "{length}");
    }
}

#[test]
fn a_thousand_participants_are_no_burden() {
    let start = Instant::now();
    let mut net = Net::new(1);
    let slot = net.attach(0);
    net.declare(0, endpoint(slot, 1, READER));
    for round in 0..3 {
        for number in 1000..2000 {
            announce(&mut net, number);
        }
        net.run(5 * SECOND);
        let participants = net.hosts[0].layer.status().participants;
        assert_eq!(participants.len(), 1000, "{round}");
    }
    let elapsed = start.elapsed();
    assert!(elapsed < 20 * SECOND, "{elapsed:?}");
}

#[test]
fn participants_of_other_domains_are_ignored() {
    let mut net = Net::new(1);
    let mut other_domain = config(2);
    other_domain.domain = 7;
    net.add(other_domain);
    net.run(SECOND);
    assert!(net.hosts[0].layer.status().participants.is_empty());
}
