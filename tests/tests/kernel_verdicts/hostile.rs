//! Malformed messages: dropped or cut short, each under the counter of its reason.
#![expect(clippy::too_many_lines, reason = "tables of cases")]

use std::collections::BTreeSet;

use anyhow::Result;
use rtps_ebpf::{
    Counter, Reason, Routes, SlotSet,
    abi::{DOORBELL_RING, MAX_SUBMESSAGES},
    entity::{Guid, guid},
    examine,
};
use rtps_tests::{
    packet::{ANYBODY, AT_SOCKET_MAX, Message, SPDP_WRITER, at_socket, reader_of, writer_of},
    require, skip_unless,
};

use crate::{
    layer::{Layer, MULTICAST_PORT, OWN, REMOTE, UNICAST_PORT},
    valid::{MATCHED_WRITER, XDP_DROP, counts, layer, remote, slots, unicast},
};

/// The reasons that a submessage can have, with one that has it.
fn malformed() -> Vec<(Reason, Message)> {
    let data = |octets: u16, flags: u8, number: u8, payload: usize| {
        let number = [0, 0, 0, 0, number, 0, 0, 0];
        remote().submessage(
            0x15,
            flags,
            &[
                &[0, 0],
                &octets.to_le_bytes(),
                &reader_of(1),
                &writer_of(3),
                &number,
                &vec![0; payload],
            ],
        )
    };
    let acknack = |base, bits, words| remote().acknack(writer_of(1), base, bits, words);
    let fragments = |fragments, payload| remote().data_frag(reader_of(1), fragments, payload);
    let locators = u32::MAX.to_le_bytes();
    vec![
        (Reason::SubmessageHeader, remote().raw(&[0x15, 1, 0])),
        (
            Reason::SubmessageLength,
            remote().lying(0x15, 5, 4000, &[&[0; 40]]),
        ),
        (
            Reason::ZeroLength,
            remote().lying(0x0e, 0, 0, &[&OWN, &[1, 1, 0, 0]]),
        ),
        (
            Reason::SubmessageTooShort,
            remote().submessage(0x07, 0, &[&[0; 24]]),
        ),
        (Reason::NumberSetBits, acknack(1, 257, 9)),
        (Reason::NumberSetBits, acknack(1, u32::MAX, 1)),
        (Reason::NumberSetBitmap, acknack(1, 64, 1)),
        (
            Reason::NumberSetBitmap,
            remote().gap(reader_of(1), 1, 5, 256),
        ),
        (Reason::NumberSetBase, acknack(-1, 0, 0)),
        (Reason::NumberSetBase, acknack(i64::MAX, 0, 0)),
        (Reason::SequenceNumber, data(16, 4, 0, 8)),
        (
            Reason::HeartbeatRange,
            remote().heartbeat(reader_of(1), writer_of(3), 0, 1),
        ),
        (
            Reason::HeartbeatRange,
            remote().heartbeat(reader_of(1), writer_of(3), 1, -1),
        ),
        (
            Reason::HeartbeatRange,
            remote().heartbeat(reader_of(1), writer_of(3), 9, 1),
        ),
        (Reason::GapStart, remote().gap(reader_of(1), 0, 5, 0)),
        (Reason::GapStart, remote().gap(reader_of(1), -1, 5, 0)),
        (Reason::InlineQosOffset, data(0, 4, 1, 8)),
        (Reason::InlineQosOffset, data(u16::MAX, 4, 1, 8)),
        (Reason::Payload, data(16, 4 | 8, 1, 8)),
        (Reason::Payload, data(16, 2, 1, 0)),
        (Reason::FragmentSize, fragments([1, 1, 0, 100], 0)),
        (Reason::FragmentSize, fragments([1, 1, 200, 100], 100)),
        (Reason::FragmentCount, fragments([1, 0, 10, 100], 0)),
        (Reason::FragmentStart, fragments([0, 1, 10, 100], 10)),
        (Reason::FragmentRange, fragments([11, 1, 10, 100], 10)),
        (
            Reason::FragmentRange,
            fragments([u32::MAX, 65_535, 65_535, u32::MAX], 10),
        ),
        (Reason::FragmentBytes, fragments([1, 2, 10, 100], 10)),
        (
            Reason::LocatorList,
            remote().submessage(0x0f, 0, &[&locators, &[0; 24]]),
        ),
    ]
}

/// The reasons that the message's own header can have.
fn bad_headers() -> Vec<(Reason, Message)> {
    let message = remote().data(reader_of(1), writer_of(3), 8);
    vec![
        (Reason::TooShort, message.truncated(19)),
        (Reason::TooShort, message.truncated(1)),
        (Reason::TooShort, message.truncated(0)),
        (Reason::BadMagic, message.clone().with(3, b'X')),
        (Reason::BadVersion, message.with(4, 1)),
    ]
}

fn too_many() -> Message {
    (0..=MAX_SUBMESSAGES).fold(remote(), |message, _| message.submessage(1, 0, &[]))
}

#[test]
fn malformed_messages_are_dropped_with_their_reason() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let rows = [
        malformed(),
        bad_headers(),
        vec![(Reason::TooManySubmessages, too_many())],
    ]
    .concat();
    for (reason, message) in &rows {
        let expected = |hook| {
            counts(&[
                (hook, 1),
                ("drop_malformed", 1),
                (reason.counter().name(), 1),
            ])
        };
        let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
        assert_eq!(outcome.verdict, XDP_DROP, "{reason:?}");
        assert_eq!(outcome.counts, expected("xdp_messages"), "{reason:?}");
        assert!(outcome.records.is_empty(), "{reason:?}");

        if message.bytes().len() > AT_SOCKET_MAX {
            continue;
        }
        let outcome = layer.run_filter(&at_socket(UNICAST_PORT, message.bytes()))?;
        assert_eq!(outcome.verdict, 0, "{reason:?}");
        assert_eq!(outcome.counts, expected("filter_messages"), "{reason:?}");
        assert!(outcome.records.is_empty(), "{reason:?}");
    }
    let covered: BTreeSet<Counter> = rows.iter().map(|(reason, _)| reason.counter()).collect();
    for reason in Reason::ALL {
        assert!(covered.contains(&reason.counter()), "{reason:?} has no row");
    }
    Ok(())
}

#[test]
fn what_came_before_the_malformed_part_counts() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let header = remote().bytes().len();
    for (reason, tail) in malformed() {
        let tail = &tail.bytes()[header..];
        let message = remote().data(ANYBODY, MATCHED_WRITER, 16).raw(tail);
        let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
        assert_eq!(outcome.verdict, XDP_DROP, "{reason:?}");
        assert_eq!(slots(&outcome, &message), [2, 9], "{reason:?}");
        assert_eq!(outcome.counts[reason.counter().name()], 1, "{reason:?}");

        let message = remote().data(ANYBODY, SPDP_WRITER, 16).raw(tail);
        let outcome = layer.run_filter(&at_socket(MULTICAST_PORT, message.bytes()))?;
        assert_eq!(
            outcome.verdict as usize,
            message.bytes().len() + 8,
            "{reason:?}"
        );
        assert_eq!(outcome.counts[reason.counter().name()], 1, "{reason:?}");
    }
    Ok(())
}

#[test]
fn messages_for_nobody_here_are_dropped() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let foreign = remote()
        .destination(REMOTE)
        .data(reader_of(1), writer_of(3), 8);
    let rows = [
        ("foreign", foreign, "drop_foreign_destination"),
        ("header only", remote(), "drop_unroutable"),
        (
            "unmatched writer",
            remote().data(ANYBODY, writer_of(3), 8),
            "drop_unroutable",
        ),
    ];
    for (description, message, counter) in rows {
        let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
        assert_eq!(outcome.verdict, XDP_DROP, "{description}");
        assert_eq!(
            outcome.counts,
            counts(&[("xdp_messages", 1), (counter, 1)]),
            "{description}"
        );
        let outcome = layer.run_filter(&at_socket(MULTICAST_PORT, message.bytes()))?;
        assert_eq!(outcome.verdict, 0, "{description}");
        assert_eq!(outcome.counts[counter], 1, "{description}");
    }
    Ok(())
}

#[test]
fn a_datagram_of_many_small_submessages_is_walked_to_its_end() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let message = (0..1000).fold(remote(), |message, _| {
        message.data(ANYBODY, [9, 9, 9, 2], 4)
    });
    let message = message.data(reader_of(255), writer_of(3), 4);
    let outcome = layer.run_xdp(&unicast().carrying(message.bytes()))?;
    assert_eq!(slots(&outcome, &message), [255]);
    Ok(())
}

/// The routes that `layer` has put into the kernel's map.
struct KernelRoutes;

impl Routes for KernelRoutes {
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        if *writer == guid(&REMOTE, MATCHED_WRITER) {
            slots.insert(2);
            slots.insert(9);
        }
    }
}

/// What the kernel's walk and the one in user space make of the same bytes.
fn assert_agreement(layer: &mut Layer, message: &[u8]) -> Result<()> {
    let findings = examine(message, OWN, &KernelRoutes);
    let outcome = layer.run_filter(&at_socket(UNICAST_PORT, message))?;
    let reason = findings.malformed.map(|reason| reason.counter().name());
    let counted = outcome
        .counts
        .keys()
        .find(|name| name.starts_with("malformed_"));
    assert_eq!(counted, reason.as_ref(), "{message:02x?}");
    assert_eq!(outcome.verdict != 0, findings.built_in, "{message:02x?}");
    let attached = [1, 2, 9, 255]
        .into_iter()
        .filter(|&slot| findings.targets.contains(slot));
    assert!(
        outcome.records.keys().copied().eq(attached),
        "{message:02x?}"
    );
    if let Err(counter) = findings.concerned() {
        assert_eq!(outcome.counts[counter.name()], 1, "{message:02x?}");
    }
    Ok(())
}

#[test]
fn both_walks_agree_on_every_prefix_and_every_flipped_byte() -> Result<()> {
    skip_unless!(require::root());
    let mut layer = layer(DOORBELL_RING)?;
    let whole = remote()
        .destination(OWN)
        .data(reader_of(1), writer_of(3), 12)
        .acknack(writer_of(2), 1, 40, 2)
        .source(REMOTE)
        .heartbeat(ANYBODY, MATCHED_WRITER, 1, 3)
        .gap(reader_of(9), 1, 4, 0)
        .data_frag(reader_of(255), [2, 1, 8, 20], 8)
        .data(ANYBODY, SPDP_WRITER, 8);
    for len in 0..whole.bytes().len() {
        assert_agreement(&mut layer, whole.truncated(len).bytes())?;
    }
    for index in 0..whole.bytes().len() {
        for value in [0, 1, 0x7f, 0x80, 0xff] {
            assert_agreement(&mut layer, whole.clone().with(index, value).bytes())?;
        }
    }
    Ok(())
}
