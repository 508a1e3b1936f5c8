//! What is not the layer's passes untouched; what is reaches the rings it concerns, once each.
#![expect(clippy::too_many_lines, reason = "tables of cases")]

use anyhow::Result;
use rtps_ebpf::{
    abi::{
        APP_ATTACHED, APP_FREE, App, Config, DOORBELL_PACKET, DOORBELL_RING, HOOK_FILTER, HOOK_XDP,
    },
    entity::guid,
    frame::mapped,
};
use rtps_tests::{
    packet::{
        ANYBODY, AT_SOCKET_MAX, Frame, Message, SPDP_READER, SPDP_WRITER, at_socket, reader_of,
        writer_of,
    },
    require, skip_unless,
};

use crate::layer::{
    ADDRESS_V4, ADDRESS_V6, Counts, DOMAIN, Layer, MULTICAST_PORT, OWN, Outcome, REMOTE,
    UNICAST_PORT,
};

pub(crate) const XDP_DROP: u32 = 1;
pub(crate) const XDP_PASS: u32 = 2;
/// TCX_NEXT and TCX_DROP (linux/bpf.h).
pub(crate) const TCX_NEXT: u32 = u32::MAX;
pub(crate) const TCX_DROP: u32 = 2;
const RING_BYTES: u32 = 1 << 18;
pub(crate) const DOORBELL_PORT: u16 = 40_000;
/// Matched with readers of the apps 2 and 9.
pub(crate) const MATCHED_WRITER: [u8; 4] = [0, 0, 5, 0x02];

pub(crate) fn layer(doorbell: u32) -> Result<Layer> {
    let mut layer = Layer::new(doorbell)?;
    for slot in [1, 2, 9, 255] {
        layer.attach_app(slot, DOORBELL_PORT + u16::from(slot), RING_BYTES)?;
    }
    layer.route(guid(&REMOTE, MATCHED_WRITER), &[2, 9])?;
    Ok(layer)
}

pub(crate) fn unicast() -> Frame {
    Frame::v4(ADDRESS_V4, UNICAST_PORT)
}

pub(crate) fn remote() -> Message {
    Message::from(REMOTE)
}

fn directed() -> Message {
    remote().data(reader_of(1), writer_of(3), 100)
}

pub(crate) fn counts(expected: &[(&'static str, u64)]) -> Counts {
    expected.iter().copied().collect()
}

/// The slots that got the message, each of them once and whole.
pub(crate) fn slots(outcome: &Outcome, message: &Message) -> Vec<u8> {
    outcome
        .records
        .iter()
        .map(|(&slot, records)| {
            assert_eq!(records.len(), 1, "slot {slot} gets one record");
            assert_eq!(records[0].message, message.bytes(), "slot {slot}");
            slot
        })
        .collect()
}

#[test]
fn frames_that_are_not_the_layers_pass_untouched() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_PACKET)?;
    let stranger_v6 = [0x20, 1, 0xd, 0xb8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3];
    let mut multicast_v6 = ADDRESS_V6;
    multicast_v6[0] = 0xff;
    let v6 = Frame::v6(ADDRESS_V6, UNICAST_PORT);
    let rows = [
        ("ARP", Frame::ethertype(0x0806), "pass_not_ip"),
        ("three VLAN tags", unicast().vlan_tags(3), "pass_not_ip"),
        ("TCP", unicast().protocol(6), "pass_not_udp"),
        ("TCP over IPv6", v6.clone().protocol(6), "pass_not_udp"),
        ("hop-by-hop options", v6.clone().protocol(0), "pass_not_udp"),
        (
            "a first fragment",
            unicast().fragment(0x2000),
            "pass_fragment",
        ),
        (
            "a later fragment",
            unicast().fragment(0x00b9),
            "pass_fragment",
        ),
        ("an IPv6 fragment", v6.clone().protocol(44), "pass_fragment"),
        (
            "multicast",
            Frame::v4([239, 255, 0, 1], 7401),
            "pass_multicast",
        ),
        (
            "broadcast",
            Frame::v4([255; 4], UNICAST_PORT),
            "pass_multicast",
        ),
        (
            "IPv6 multicast",
            Frame::v6(multicast_v6, 7401),
            "pass_multicast",
        ),
        (
            "another port",
            Frame::v4(ADDRESS_V4, 7413),
            "pass_not_our_port",
        ),
        (
            "a shared port",
            Frame::v4(ADDRESS_V4, MULTICAST_PORT),
            "pass_not_our_port",
        ),
        (
            "to be routed",
            Frame::v4([192, 0, 2, 3], UNICAST_PORT),
            "pass_not_our_address",
        ),
        (
            "IPv6 to be routed",
            Frame::v6(stranger_v6, UNICAST_PORT),
            "pass_not_our_address",
        ),
        (
            "a UDP length beyond IP's",
            unicast().udp_surplus(1),
            "pass_bad_lengths",
        ),
        (
            "a UDP length below 8",
            unicast().udp_surplus(-145),
            "pass_bad_lengths",
        ),
    ];
    let payload = directed();
    for (description, frame, counter) in rows {
        let frame = frame.carrying(payload.bytes());
        let outcome = layer.run_xdp(&frame)?;
        assert_eq!(outcome.verdict, XDP_PASS, "{description}");
        assert_eq!(outcome.counts, counts(&[(counter, 1)]), "{description}");
        assert!(outcome.records.is_empty(), "{description}");
        assert_eq!(outcome.packet, frame, "{description}");
    }
    Ok(())
}

#[test]
fn frames_cut_anywhere_below_udp_pass() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_PACKET)?;
    for frame in [
        unicast(),
        unicast().vlan_tags(2),
        Frame::v6(ADDRESS_V6, UNICAST_PORT),
    ] {
        let whole = frame.carrying(directed().bytes());
        // 14 bytes is the least that a test run takes.
        for len in 14..whole.len() {
            let outcome = layer.run_xdp(&whole[..len])?;
            assert_eq!(outcome.verdict, XDP_PASS, "{len} bytes");
            assert!(outcome.records.is_empty(), "{len} bytes");
        }
        assert_eq!(layer.run_xdp(&whole)?.verdict, XDP_DROP);
    }
    Ok(())
}

const RELAYED: [u8; 12] = *b"relayed-----";

/// What it is, the message, and the slots that it concerns.
type Concern = (&'static str, Message, &'static [u8]);

fn concerns() -> [Concern; 11] {
    [
        ("directed DATA", directed(), &[1]),
        (
            "INFO_DST to us",
            remote()
                .destination(OWN)
                .data(reader_of(1), writer_of(3), 8),
            &[1],
        ),
        (
            "undirected DATA",
            remote().data(ANYBODY, MATCHED_WRITER, 8),
            &[2, 9],
        ),
        (
            "HEARTBEAT",
            remote().heartbeat(ANYBODY, MATCHED_WRITER, 1, 5),
            &[2, 9],
        ),
        (
            "directed HEARTBEAT",
            remote().heartbeat(reader_of(9), MATCHED_WRITER, 1, 5),
            &[9],
        ),
        ("GAP", remote().gap(ANYBODY, 1, 5, 0), &[]),
        (
            "ACKNACK",
            remote().acknack(writer_of(255), 1, 32, 1),
            &[255],
        ),
        (
            "DATA_FRAG",
            remote().data_frag(reader_of(2), [1, 2, 8, 20], 16),
            &[2],
        ),
        (
            "relayed",
            remote().source(RELAYED).data(ANYBODY, MATCHED_WRITER, 8),
            &[255],
        ),
        (
            "one app concerned twice",
            remote().data(reader_of(1), writer_of(3), 8).heartbeat(
                reader_of(1),
                writer_of(3),
                1,
                1,
            ),
            &[1],
        ),
        (
            "all apps",
            remote()
                .data(reader_of(255), writer_of(3), 8)
                .data(ANYBODY, MATCHED_WRITER, 8)
                .data(reader_of(1), writer_of(3), 8),
            &[1, 2, 9, 255],
        ),
    ]
}

#[test]
fn messages_reach_the_rings_they_concern() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    layer.deliver_at_ingress()?;
    layer.route(guid(&RELAYED, MATCHED_WRITER), &[255])?;
    for (description, message, expected) in concerns() {
        let size = message.bytes().len() as u64;
        let records = expected.len() as u64;
        let delivered = match records {
            0 => vec![("drop_unroutable", 1)],
            _ => vec![
                ("delivered_messages", 1),
                ("delivered_records", records),
                ("delivered_bytes", records * size),
            ],
        };
        let with_hook = |hook| counts(&[&delivered[..], &[(hook, 1)]].concat());

        let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
        assert_eq!(outcome.verdict, XDP_DROP, "{description}");
        assert_eq!(outcome.counts, with_hook("xdp_messages"), "{description}");
        assert_eq!(slots(&outcome, &message), expected, "{description}");

        let outcome = layer.run_ingress(&unicast().carrying(message.bytes()), 0)?;
        assert_eq!(outcome.verdict, TCX_DROP, "{description}");
        assert_eq!(
            outcome.counts,
            with_hook("ingress_messages"),
            "{description}"
        );
        assert_eq!(slots(&outcome, &message), expected, "{description}");

        for port in [UNICAST_PORT, MULTICAST_PORT] {
            let outcome = layer.run_filter(&at_socket(port, message.bytes()))?;
            assert_eq!(outcome.verdict, 0, "{description}");
            assert_eq!(
                outcome.counts,
                with_hook("filter_messages"),
                "{description}"
            );
            assert_eq!(slots(&outcome, &message), expected, "{description}");
        }
    }
    Ok(())
}

#[test]
fn what_concerns_built_in_entities_is_left_to_the_filter() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_PACKET)?;
    let rows: [(&str, Message, &[u8]); 4] = [
        ("SPDP", remote().data(ANYBODY, SPDP_WRITER, 64), &[]),
        (
            "directed SPDP",
            remote().data(SPDP_READER, SPDP_WRITER, 64),
            &[],
        ),
        ("slot 0", remote().data(reader_of(0), writer_of(3), 64), &[]),
        (
            "rtpsd and an app",
            remote()
                .acknack([0, 0, 3, 0xc2], 1, 0, 0)
                .data(reader_of(1), writer_of(3), 8),
            &[1],
        ),
    ];
    for (description, message, expected) in rows {
        let frame = unicast().carrying(message.bytes());
        let outcome = layer.run_xdp(&frame)?;
        assert_eq!(outcome.verdict, XDP_PASS, "{description}");
        assert_eq!(outcome.packet, frame, "{description}");
        assert_eq!(
            outcome.counts,
            counts(&[("xdp_messages", 1), ("pass_built_in", 1)])
        );
        assert!(outcome.records.is_empty(), "{description}");

        let outcome = layer.run_filter(&at_socket(UNICAST_PORT, message.bytes()))?;
        assert_eq!(
            outcome.verdict as usize,
            message.bytes().len() + 8,
            "{description}"
        );
        assert_eq!(outcome.counts["to_daemon"], 1, "{description}");
        assert_eq!(slots(&outcome, &message), expected, "{description}");
    }
    Ok(())
}

#[test]
fn records_say_where_the_message_came_from() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let rows = [
        (unicast(), mapped(Frame::SOURCE_V4)),
        (
            unicast().vlan_tags(1).ip_options(3),
            mapped(Frame::SOURCE_V4),
        ),
        (
            Frame::v6(ADDRESS_V6, UNICAST_PORT).vlan_tags(2),
            Frame::SOURCE_V6,
        ),
    ];
    for (frame, source) in rows {
        let outcome = layer.run_xdp(&frame.carrying(directed().bytes()))?;
        let header = outcome.records[&1][0].header;
        assert_eq!(header.source_address, source);
        assert_eq!(header.source_port, Frame::SOURCE_PORT);
        assert_eq!(u32::from(header.domain_index), DOMAIN);
        assert_eq!(header.hook, HOOK_XDP);
        assert_eq!(header.ifindex, 1);
        assert_ne!(header.received_ns, 0);
    }
    let outcome = layer.run_filter(&at_socket(UNICAST_PORT, directed().bytes()))?;
    assert_eq!(outcome.records[&1][0].header.hook, HOOK_FILTER);
    Ok(())
}

#[test]
fn messages_of_every_size_arrive_whole() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    // Around the edges of the record sizes, 40 bytes of header included, and the largest.
    let sizes = [256, 512, 1024, 2048, 9216, 16_384].map(|record: usize| record - 40);
    let edges = sizes.iter().flat_map(|size| [size - 1, *size, size + 1]);
    for size in edges.chain([48, 65_507]) {
        let message = remote().data(reader_of(1), writer_of(3), size - 44);
        assert_eq!(message.bytes().len(), size);
        if size < AT_SOCKET_MAX {
            let outcome = layer.run_filter(&at_socket(UNICAST_PORT, message.bytes()))?;
            assert_eq!(slots(&outcome, &message), [1], "{size} bytes at the socket");
        }
        let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
        assert_eq!(slots(&outcome, &message), [1], "{size} bytes at XDP");
    }
    Ok(())
}

#[test]
fn a_sleeping_app_is_woken_by_the_datagram_itself() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_PACKET)?;
    let both = remote().data(ANYBODY, MATCHED_WRITER, 100);
    let frame = unicast().carrying(both.bytes());

    let awake = layer.run_xdp(&frame)?;
    assert_eq!(awake.verdict, XDP_DROP);

    layer.sleep(9, true)?;
    let one = layer.run_xdp(&frame)?;
    assert_eq!(one.verdict, XDP_PASS);
    assert_eq!(slots(&one, &both), [2, 9]);
    assert_eq!(one.counts["doorbell_packet"], 1);
    let udp = unicast().udp_offset();
    let mut expected = frame.clone();
    expected[udp + 2..udp + 4].copy_from_slice(&(DOORBELL_PORT + 9).to_be_bytes());
    expected[udp + 6..udp + 8].fill(0);
    assert_eq!(one.packet, expected);

    layer.sleep(2, true)?;
    let two = layer.run_xdp(&frame)?;
    assert_eq!(two.verdict, XDP_PASS);
    assert_eq!(two.counts["doorbell_packet"], 1, "of the first");
    assert_eq!(two.counts["doorbell_ring"], 1, "of the second");
    assert_eq!(
        two.packet[udp + 2..udp + 4],
        (DOORBELL_PORT + 2).to_be_bytes()
    );

    layer.sleep(2, false)?;
    layer.sleep(9, false)?;
    assert_eq!(layer.run_xdp(&frame)?.verdict, XDP_DROP);
    Ok(())
}

#[test]
fn the_ring_rings_where_the_datagram_cannot() -> Result<()> {
    skip_unless!(require::root());
    let frame = unicast().carrying(directed().bytes());
    let frame_v6 = Frame::v6(ADDRESS_V6, UNICAST_PORT).carrying(directed().bytes());

    let mut by_ring = layer(DOORBELL_RING)?;
    by_ring.sleep(1, true)?;
    let outcome = by_ring.run_xdp(&frame)?;
    assert_eq!(outcome.verdict, XDP_DROP);
    assert_eq!(outcome.counts["doorbell_ring"], 1);

    let mut by_packet = layer(DOORBELL_PACKET)?;
    by_packet.sleep(1, true)?;
    let outcome = by_packet.run_xdp(&frame_v6)?;
    assert_eq!(outcome.verdict, XDP_DROP);
    assert_eq!(outcome.counts["doorbell_ring"], 1, "IPv6 needs a checksum");
    let outcome = by_packet.run_filter(&at_socket(UNICAST_PORT, directed().bytes()))?;
    assert_eq!(
        outcome.counts["doorbell_ring"], 1,
        "a socket cannot redirect"
    );
    by_packet.attach_app(1, 0, RING_BYTES)?;
    by_packet.sleep(1, true)?;
    let outcome = by_packet.run_xdp(&frame)?;
    assert_eq!(outcome.counts["doorbell_ring"], 1, "no port to ring at");
    Ok(())
}

#[test]
fn records_without_a_place_are_counted() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let to = |slot| unicast().carrying(remote().data(reader_of(slot), writer_of(3), 1000).bytes());

    let nobody = layer.run_xdp(&to(77))?;
    assert_eq!(
        nobody.counts,
        counts(&[("xdp_messages", 1), ("lost_no_app", 1)])
    );
    for (state, domain_index) in [(APP_FREE, DOMAIN), (APP_ATTACHED, DOMAIN + 1)] {
        let app = App {
            state,
            domain_index,
            ..App::default()
        };
        layer.set_app(2, app)?;
        assert_eq!(layer.run_xdp(&to(2))?.counts["lost_no_app"], 1);
    }

    layer.attach_app(3, 0, 4096)?;
    let frame = to(3);
    layer.reset_counters()?;
    for _ in 0..5 {
        assert_eq!(layer.run_xdp_undrained(&frame)?, XDP_DROP);
    }
    // 2,048 bytes a record and 8 for its own header: one fits.
    assert_eq!(layer.counts()?["lost_ring_full"], 4);
    assert_eq!(layer.drain()[&3].len(), 1);
    Ok(())
}

#[test]
fn valid_messages_renew_their_sender() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    layer.know_peer(REMOTE)?;
    layer.run_xdp(&unicast().carrying(directed().raw(&[1]).bytes()))?;
    assert_eq!(layer.last_seen_ns(REMOTE)?, 0, "malformed");
    layer.run_xdp(&unicast().carrying(directed().bytes()))?;
    let first = layer.last_seen_ns(REMOTE)?;
    assert_ne!(first, 0);
    layer.run_filter(&at_socket(MULTICAST_PORT, directed().bytes()))?;
    assert!(layer.last_seen_ns(REMOTE)? > first);
    Ok(())
}

#[test]
fn without_a_configuration_of_its_version_everything_passes() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_PACKET)?;
    layer.configure(Config::default())?;
    let outcome = layer.run_xdp(&unicast().carrying(directed().bytes()))?;
    assert_eq!(outcome.verdict, XDP_PASS);
    assert_eq!(outcome.counts, counts(&[("pass_not_configured", 1)]));
    let datagram = at_socket(UNICAST_PORT, directed().bytes());
    let outcome = layer.run_filter(&datagram)?;
    assert_eq!(outcome.verdict as usize, datagram.len() - 14);
    assert!(outcome.records.is_empty());
    Ok(())
}
