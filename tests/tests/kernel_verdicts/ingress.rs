//! The tc program where it delivers: single datagrams as XDP does, and several that came in one frame.

use anyhow::Result;
use rtps_ebpf::abi::{DOORBELL_PACKET, DOORBELL_RING};
use rtps_tests::{
    packet::{ANYBODY, Frame, Message, SPDP_WRITER, reader_of, writer_of},
    require, skip_unless,
};

use crate::{
    layer::{ADDRESS_V4, ADDRESS_V6, Layer, METATRAFFIC_PORT, MULTICAST_PORT, UNICAST_PORT},
    valid::{
        DOORBELL_PORT, MATCHED_WRITER, TCX_DROP, TCX_NEXT, counts, layer, remote, slots, unicast,
    },
};

fn delivering(doorbell: u32) -> Result<Layer> {
    let mut layer = layer(doorbell)?;
    layer.deliver_at_ingress()?;
    Ok(layer)
}

/// Messages of the same length but perhaps the last, one behind the other.
fn burst(messages: &[&Message]) -> (Message, u32) {
    let (first, more) = messages.split_first().expect("at least one");
    let segment = first.bytes().len() as u32;
    let append = |all: Message, message: &&Message| all.raw(message.bytes());
    (more.iter().fold((*first).clone(), append), segment)
}

/// The frame with the checksum that its IPv4 header has to have.
fn summed(description: &Frame, payload: &[u8]) -> Vec<u8> {
    let mut frame = description.carrying(payload);
    let udp = description.udp_offset();
    let version_and_length =
        |ip: &usize| frame[*ip] >> 4 == 4 && *ip + 4 * usize::from(frame[*ip] & 15) == udp;
    let ip = (14..udp)
        .step_by(4)
        .find(version_and_length)
        .expect("an IPv4 header");
    let words = frame[ip..udp].chunks_exact(2);
    let sum: u32 = words
        .map(|word| u32::from(u16::from_be_bytes([word[0], word[1]])))
        .sum();
    let sum = (sum & 0xffff) + (sum >> 16);
    frame[ip + 10..ip + 12].copy_from_slice(&(!(sum as u16)).to_be_bytes());
    frame
}

#[test]
fn what_is_not_the_layers_passes_counted() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_RING)?;
    let data = remote().data(reader_of(1), writer_of(3), 8);
    let rows = [
        ("pass_not_ip", Frame::ethertype(0x0806)),
        ("pass_not_our_port", Frame::v4(ADDRESS_V4, 7)),
        (
            "pass_not_our_address",
            Frame::v4([192, 0, 2, 77], UNICAST_PORT),
        ),
        (
            "pass_not_our_address",
            Frame::v4(ADDRESS_V4, MULTICAST_PORT),
        ),
        ("pass_multicast", Frame::v4([239, 255, 0, 1], UNICAST_PORT)),
        ("pass_metatraffic", Frame::v4(ADDRESS_V4, METATRAFFIC_PORT)),
        ("pass_fragment", unicast().fragment(0x2000)),
    ];
    for (counter, frame) in rows {
        let outcome = layer.run_ingress(&frame.carrying(data.bytes()), 0)?;
        assert_eq!(outcome.verdict, TCX_NEXT, "{counter}");
        assert_eq!(outcome.counts, counts(&[(counter, 1)]), "{counter}");
        assert!(outcome.records.is_empty(), "{counter}");
    }
    Ok(())
}

#[test]
fn next_to_xdp_it_leaves_apps_alone() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let data = remote().data(reader_of(1), writer_of(3), 8);
    let outcome = layer.run_ingress(&unicast().carrying(data.bytes()), 0)?;
    assert_eq!(outcome.verdict, TCX_NEXT);
    assert_eq!(outcome.counts, counts(&[]));
    assert!(outcome.records.is_empty());
    Ok(())
}

#[test]
fn what_concerns_built_in_entities_is_left_to_the_filter() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_PACKET)?;
    let message = remote()
        .data(ANYBODY, SPDP_WRITER, 8)
        .data(reader_of(1), writer_of(3), 8);
    let mut frame = unicast().carrying(message.bytes());
    let outcome = layer.run_ingress(&frame, 0)?;
    assert_eq!(outcome.verdict, TCX_NEXT);
    frame[..6].fill(0);
    assert_eq!(outcome.packet, frame);
    assert_eq!(outcome.counts, counts(&[]));
    assert!(outcome.records.is_empty());
    Ok(())
}

#[test]
fn a_sleeping_app_is_woken_by_the_datagram_itself() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_PACKET)?;
    let both = remote().data(ANYBODY, MATCHED_WRITER, 100);
    layer.sleep(9, true)?;
    let mut expected = unicast().carrying(both.bytes());
    let outcome = layer.run_ingress(&expected, 0)?;
    assert_eq!(outcome.verdict, TCX_NEXT);
    assert_eq!(slots(&outcome, &both), [2, 9]);
    assert_eq!(outcome.counts["doorbell_packet"], 1);
    let udp = unicast().udp_offset();
    expected[..6].fill(0);
    expected[udp + 2..udp + 4].copy_from_slice(&(DOORBELL_PORT + 9).to_be_bytes());
    expected[udp + 6..udp + 8].fill(0);
    assert_eq!(outcome.packet, expected);

    let v6 = Frame::v6(ADDRESS_V6, UNICAST_PORT).carrying(both.bytes());
    let outcome = layer.run_ingress(&v6, 0)?;
    assert_eq!(outcome.verdict, TCX_DROP);
    assert_eq!(outcome.counts["doorbell_ring"], 1, "IPv6 needs a checksum");
    Ok(())
}

#[test]
fn whoever_is_concerned_by_one_datagram_of_a_burst_gets_all() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_RING)?;
    layer.sleep(1, true)?;
    let first = remote().data(reader_of(1), writer_of(3), 100);
    let second = remote().data(reader_of(2), writer_of(3), 100);
    let nobody = remote().data(ANYBODY, writer_of(3), 100);
    let last = remote().data(reader_of(1), writer_of(3), 8);
    for messages in [
        vec![&first, &second, &last],
        vec![&first, &second],
        vec![&nobody, &first, &nobody, &second, &nobody],
    ] {
        let (all, segment) = burst(&messages);
        let len = all.bytes().len() as u64;
        for frame in [unicast(), unicast().ip_options(2), unicast().vlan_tags(1)] {
            let outcome = layer.run_ingress(&frame.carrying(all.bytes()), segment)?;
            assert_eq!(outcome.verdict, TCX_DROP);
            let expected = counts(&[
                ("ingress_messages", messages.len() as u64),
                ("delivered_messages", 1),
                ("delivered_records", 2),
                ("delivered_bytes", 2 * len),
                ("doorbell_ring", 1),
            ]);
            assert_eq!(outcome.counts, expected);
            assert_eq!(slots(&outcome, &all), [1, 2]);
            assert_eq!(u32::from(outcome.records[&1][0].header.segment), segment);
        }
    }
    Ok(())
}

#[test]
fn a_sleeping_app_is_woken_by_what_is_left_of_a_burst() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_PACKET)?;
    let message = remote().data(ANYBODY, MATCHED_WRITER, 100);
    let (all, segment) = burst(&[&message, &message, &message]);
    layer.sleep(9, true)?;
    for frame in [unicast(), unicast().ip_options(2), unicast().vlan_tags(1)] {
        let outcome = layer.run_ingress(&summed(&frame, all.bytes()), segment)?;
        assert_eq!(outcome.verdict, TCX_NEXT);
        assert_eq!(slots(&outcome, &all), [2, 9]);
        assert_eq!(outcome.counts["doorbell_packet"], 1);
        let mut expected = summed(&frame, &[]);
        expected[..6].fill(0);
        let udp = frame.udp_offset();
        expected[udp + 2..udp + 4].copy_from_slice(&(DOORBELL_PORT + 9).to_be_bytes());
        expected[udp + 6..udp + 8].fill(0);
        assert_eq!(outcome.packet, expected);
    }
    Ok(())
}

#[test]
fn a_burst_for_nobody_is_left_to_the_stack() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_RING)?;
    let message = remote().data(ANYBODY, writer_of(3), 100);
    let (all, segment) = burst(&[&message, &message]);
    let outcome = layer.run_ingress(&unicast().carrying(all.bytes()), segment)?;
    assert_eq!(outcome.verdict, TCX_NEXT);
    assert_eq!(outcome.counts, counts(&[]));
    Ok(())
}

#[test]
fn a_burst_that_holds_anything_else_is_left_to_the_stack() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = delivering(DOORBELL_RING)?;
    let data = remote().data(reader_of(1), writer_of(3), 100);
    let others = [
        ("built-in", remote().data(ANYBODY, SPDP_WRITER, 100)),
        ("malformed", data.clone().with(0, b'X')),
    ];
    for (description, other) in &others {
        for messages in [
            [other, &data, &data],
            [&data, other, &data],
            [&data, &data, other],
        ] {
            let (all, segment) = burst(&messages);
            let outcome = layer.run_ingress(&unicast().carrying(all.bytes()), segment)?;
            assert_eq!(outcome.verdict, TCX_NEXT, "{description}");
            assert_eq!(outcome.counts, counts(&[]), "{description}");
            assert!(outcome.records.is_empty(), "{description}");
        }
    }
    Ok(())
}
