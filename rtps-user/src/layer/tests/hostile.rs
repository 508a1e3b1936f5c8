//! What the network may bring beside what is meant well.

use std::net::SocketAddr;
use std::time::Duration;

use super::messages::{disposal, sample};
use super::sim::{GROUP, Net, config, endpoint, prefix};
use super::{READER, SECOND, WRITER, matched, matches};
use crate::discovery::{DiscoveryLimits, EndpointData, ParticipantData};
use crate::layer::Limits;
use crate::layer::protocol::MAX_PROTOCOL_MESSAGE;
use crate::qos::Qos;
use crate::wire::{
    AckNack, DataFragment, EntityId, Guid, GuidPrefix, InlineQos, MessageWriter, PayloadKind,
    SequenceNumber, SequenceNumberSet,
};

fn address(number: usize) -> SocketAddr {
    let [.., high, low] = number.to_be_bytes();
    ([10, 6, high, low], 7410).into()
}

/// Has an invented participant announce itself.
fn announce(net: &mut Net, number: usize) -> Vec<u8> {
    let mut data = ParticipantData::new(prefix(number));
    data.metatraffic_unicast = vec![address(number)];
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let bytes = sample(prefix(number), EntityId::SPDP_WRITER, 1, &payload);
    net.inject(address(number), GROUP, bytes.clone());
    bytes
}

/// What an invented participant may say of a writer.
fn invented_writer(number: usize, sequence: i64) -> EndpointData {
    EndpointData {
        guid: Guid::new(prefix(number), EntityId::of_app(1, sequence as u16, WRITER)),
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: Qos::default(),
    }
}

/// Has an invented participant announce a writer.
fn announce_endpoint(net: &mut Net, number: usize, sequence: i64) -> Vec<u8> {
    let mut payload = Vec::new();
    invented_writer(number, sequence).encode(&mut payload);
    let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
    let bytes = sample(prefix(number), writer, sequence, &payload);
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

/// Has an invented participant announce itself for ever from `source`, and act as if it had heard the first host.
fn announce_proven(net: &mut Net, number: usize, source: SocketAddr) {
    let mut data = ParticipantData::new(prefix(number));
    data.lease = crate::wire::Duration::INFINITE;
    data.metatraffic_unicast = vec![source];
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let bytes = sample(prefix(number), EntityId::SPDP_WRITER, 1, &payload);
    let to = net.hosts[0].address;
    net.inject(source, to, bytes);
    let mut bytes = Vec::new();
    let mut answer = MessageWriter::new(&mut bytes, prefix(number));
    answer.info_destination(prefix(1));
    answer.acknack(&AckNack {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        state: SequenceNumberSet::empty(SequenceNumber(1)),
        count: 1,
        is_final: true,
    });
    net.inject(source, to, bytes);
}

#[test]
fn inventions_that_answer_and_never_end_leave_room_for_others() {
    let mut net = Net::new(0);
    let mut config_of_first = config(1);
    config_of_first.limits.discovery.participants = 20;
    net.add(config_of_first);
    let known = |net: &Net| net.hosts[0].layer.status().participants.len();
    // From one address, and without end.
    for round in 0..3 {
        for number in 0..50 {
            announce_proven(&mut net, 1000 + 50 * round + number, address(1));
            net.run(Duration::from_millis(10));
        }
    }
    let slot = net.attach(0);
    net.declare(0, endpoint(slot, 1, READER));
    net.add(config(2));
    let other = net.attach(1);
    let writer = net.declare(1, endpoint(other, 1, WRITER));
    net.run(6 * SECOND);
    assert_eq!(matches(&net.replies(0)), [writer]);
    // From any number of addresses, until the table is full.
    for number in 0..50 {
        announce_proven(&mut net, 2000 + number, address(2000 + number));
        net.run(Duration::from_millis(10));
    }
    assert_eq!(known(&net), 20);
    assert_eq!(net.replies(0), [], "who is known stays");
    net.add(config(3));
    let third = net.attach(2);
    let writer = net.declare(2, endpoint(third, 1, WRITER));
    net.run(10 * SECOND);
    assert_eq!(net.replies(0), []);
    net.run(120 * SECOND);
    assert_eq!(
        matches(&net.replies(0)),
        [writer],
        "they have fallen silent"
    );
    assert_eq!(known(&net), 20);
}

#[test]
fn nothing_is_sent_to_addresses_that_cannot_be_meant() {
    let mut net = Net::new(1);
    let odd = [
        "127.0.0.1:7411",
        "0.0.0.3:7400",
        "255.255.255.255:7411",
        "239.255.0.1:7401",
        "10.0.0.66:0",
        "[::1]:7411",
        "[ff02::1]:7411",
        "[fe80::1]:7411",
    ];
    let odd = odd.map(|address| address.parse::<SocketAddr>().unwrap());
    let many = odd.into_iter().chain((0..1000).map(address));
    let many: Vec<_> = many.collect();
    let mut invented = ParticipantData::new(prefix(1000));
    invented.metatraffic_unicast = many.clone();
    invented.default_unicast = many.clone();
    let mut payload = Vec::new();
    invented.encode(&mut payload);
    let bytes = sample(prefix(1000), EntityId::SPDP_WRITER, 1, &payload);
    let source = address(5000);
    let to = net.hosts[0].address;
    net.inject(source, to, bytes);
    net.run(SECOND);
    let known = |net: &Net| {
        let known = net.hosts[0].layer.discovery.participant(prefix(1000));
        known.map(|known| {
            (
                known.is_proven(),
                known.metatraffic.clone(),
                known.user.clone(),
            )
        })
    };
    let answered = vec![SocketAddr::new(source.ip(), 7410)];
    let expected = Some((false, answered.clone(), answered.clone()));
    assert_eq!(known(&net), expected, "only where it is");
    announce_proven(&mut net, 1000, source);
    let mut writer = invented_writer(1000, 1);
    writer.unicast = many;
    let entity = writer.guid.entity;
    payload.clear();
    writer.encode(&mut payload);
    let announcer = EntityId::SEDP_PUBLICATIONS_WRITER;
    let bytes = sample(prefix(1000), announcer, 1, &payload);
    net.inject(source, to, bytes);
    net.run(SECOND);
    let (_, metatraffic, _) = known(&net).unwrap();
    assert_eq!(metatraffic, answered);
    let known = net.hosts[0].layer.discovery.participant(prefix(1000));
    let endpoint = known.unwrap().endpoint(entity).unwrap();
    let is_meant = |address: &SocketAddr| address.ip().is_ipv4() && !odd.contains(address);
    assert!(endpoint.unicast.iter().all(is_meant), "{endpoint:?}");
    assert!((1..=16).contains(&endpoint.unicast.len()));
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
        let bytes = sample(prefix(1000), writer, sequence, payload);
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
    let bytes = sample(prefix(1), EntityId::SPDP_WRITER, 2, &payload);
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
    let bytes = sample(prefix(1000), EntityId::SPDP_WRITER, 1, &payload);
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

/// A message of another participant as what `relay` says in its name, by INFO_SRC.
fn passed_on(message: &[u8], relay: GuidPrefix) -> Vec<u8> {
    let (header, submessages) = message.split_at(20);
    let (version, source) = header.split_at(8);
    let info_source = [0x0c, 1, 20, 0, 0, 0, 0, 0, 2, 5, 1, 1];
    [version, &relay.0, &info_source, source, submessages].concat()
}

#[test]
fn nobody_ends_a_match_of_others() {
    let (mut net, writer, _) = matched();
    let bytes = disposal(writer, EntityId::SEDP_PUBLICATIONS_WRITER, 2);
    let to = net.hosts[1].address;
    net.inject(address(666), to, bytes.clone());
    net.run(SECOND);
    assert_eq!(net.replies(1), []);
    assert_eq!(net.hosts[1].layer.status().refused.foreign, 1);
    // Who is known by its own address cannot pass it on, either.
    announce(&mut net, 666);
    net.inject(address(666), to, passed_on(&bytes, prefix(666)));
    net.run(SECOND);
    assert_eq!(net.replies(1), []);
    assert_eq!(net.hosts[1].layer.status().refused.foreign, 2);
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
    let bytes = sample(prefix(1000), EntityId::SPDP_WRITER, 1, &payload);
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
fn a_thousand_participants_are_known() {
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
