//! How far a remote built-in writer has got, where the low-level layer cannot know it and is told.

use std::time::Duration;

use super::matched;
use crate::layer::tests::sim::prefix;
use crate::wire::{
    Data, EntityId, Heartbeat, InlineQos, MessageWriter, PayloadKind, SequenceNumber,
};

/// A HEARTBEAT of the second host's writer of publications for the first host.
fn heartbeat(first: i64, last: i64, count: i32) -> Vec<u8> {
    let mut bytes = directed();
    MessageWriter::resume(&mut bytes).heartbeat(&Heartbeat {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        first: SequenceNumber(first),
        last: SequenceNumber(last),
        count,
        is_final: false,
        liveliness: false,
        group: None,
    });
    bytes
}

/// A sample of the same writer.
fn data(sequence: i64) -> Vec<u8> {
    let mut bytes = directed();
    MessageWriter::resume(&mut bytes).data(&Data {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        sequence: SequenceNumber(sequence),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload: &[0, 3, 0, 0, 1, 0, 0, 0],
    });
    bytes
}

fn directed() -> Vec<u8> {
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, prefix(2)).info_destination(prefix(1));
    bytes
}

#[test]
fn numbers_that_the_low_level_layer_cannot_know_it_is_told() {
    let (mut net, _, reader) = matched();
    let (from, to) = (net.hosts[1].address, net.hosts[0].address);
    net.inject(from, to, heartbeat(8, 7, 10_000));
    net.run(Duration::from_millis(1));
    let peer = net.kernel(0).peers[&reader.prefix];
    assert_eq!(peer.writers[0].next, 8);
}

#[test]
fn a_number_that_the_low_level_layer_has_lost_is_told_again() {
    let (mut net, _, reader) = matched();
    net.hosts[1].is_connected = false;
    let (from, to) = (net.hosts[1].address, net.hosts[0].address);
    net.inject(from, to, heartbeat(8, 7, 10_000));
    net.run(Duration::from_millis(100));
    net.kernel(0).peers.get_mut(&reader.prefix).unwrap().writers[0].next = 1;
    for turn in 0..20 {
        net.inject(from, to, data(8));
        net.run(Duration::from_millis(100));
        net.inject(from, to, heartbeat(8, 8, 10_001 + turn));
        net.run(Duration::from_millis(200));
    }
    let peer = net.kernel(0).peers[&reader.prefix];
    assert_eq!(peer.writers[0].next, 9);
}
