//! Who may make the kernel work, and how much: floods of strangers, and those who pass for others.

use std::time::Instant;

use anyhow::Result;
use rtps_ebpf::{
    ABI_VERSION,
    abi::{Config, DISCOVERY_KERNEL, DOORBELL_RING, PEER_PROVEN, Peer, name},
    entity::GuidPrefix,
    frame::mapped,
};
use rtps_tests::{
    packet::{Frame, Message, at_socket, reader_of, writer_of},
    require, skip_unless,
};

use crate::{
    layer::{ADDRESS_V4, Layer, METATRAFFIC_PORT, REMOTE, UNICAST_PORT},
    stage::{FOR_EVER, REMOTE_V4, Stage, announcement},
    valid::layer,
};

/// The app that everything is for.
const APP: u8 = 1;

fn invented(number: u32) -> GuidPrefix {
    let mut prefix = *b"invented----";
    prefix[8..].copy_from_slice(&number.to_le_bytes());
    prefix
}

#[test]
fn a_flood_of_strangers_leaves_peers_alone() -> Result<()> {
    skip_unless!(require::root());
    const FLOOD: u32 = 6_000;
    let mut stage = Stage::new()?;
    stage.know_remote()?;
    let socket = stage.socket(REMOTE_V4)?;
    stage.tell(&socket, &announcement(REMOTE, b"one!"))?;
    let before = stage.peer()?;

    stage.layer.reset_counters()?;
    for number in 0..FLOOD {
        let message = announcement(invented(number), b"here");
        stage
            .layer
            .run_filter_undrained(&at_socket(METATRAFFIC_PORT, message.bytes()))?;
    }
    let counts = stage.layer.counts()?;
    // All of them come from one address: its burst, and what a busy machine's seconds add.
    let strangers = counts["strangers"];
    assert!((1_024..FLOOD.into()).contains(&strangers), "{counts:?}");
    assert_eq!(counts["budget_new"], u64::from(FLOOD) - strangers);
    assert!(stage.stranger(invented(0))?.is_some());
    assert!(stage.stranger(invented(FLOOD - 1))?.is_none());

    assert_eq!(stage.peer()?, before);
    let heard = stage.tell(&socket, &announcement(REMOTE, b"one!"))?;
    assert_eq!(heard.counts["discovery_quiet"], 1);
    Ok(())
}

/// Who announces itself again and again is answered as long as the budget lasts.
#[test]
fn answers_to_one_participant_are_limited() -> Result<()> {
    skip_unless!(require::root());
    const BURST: f64 = 1e6;
    const RATE: f64 = 2e6;
    let mut stage = Stage::new()?;
    let socket = stage.socket(REMOTE_V4)?;
    let message = announcement(REMOTE, b"one!");
    let to = (stage.veth.a.v4, METATRAFFIC_PORT);
    let start = Instant::now();
    stage.reset_counters()?;
    for _ in 0..10_000 {
        socket.send_to(message.bytes(), to)?;
    }
    let counts = stage.hear(&socket)?.counts;
    let limit = BURST + RATE * start.elapsed().as_secs_f64();
    assert!(counts["answer_bytes"] as f64 <= limit, "{counts:?}");
    let refused = counts.get("budget_peer").copied().unwrap_or_default();
    assert_eq!(counts["answers"] + refused, counts["ingress_messages"]);
    Ok(())
}

#[test]
fn who_passes_for_a_peer_is_dropped() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let mut peer = Peer {
        flags: PEER_PROVEN,
        ..Peer::default()
    };
    peer.addresses[2] = mapped([198, 51, 100, 9]);
    stage.layer.insert(name::PEERS, REMOTE, peer)?;
    let socket = stage.socket(REMOTE_V4)?;
    let heard = stage.tell(&socket, &announcement(REMOTE, b"mine"))?;
    assert_eq!(heard.counts["drop_foreign_source"], 1);
    assert!(heard.news.is_empty() && heard.answers.is_empty());
    assert_eq!(stage.peer()?, peer, "not renewed either");
    Ok(())
}

/// A message for an app, seen by XDP and by the filter: whether each delivers it.
fn delivered(layer: &mut Layer) -> Result<[bool; 2]> {
    let message = Message::from(REMOTE).data(reader_of(APP), writer_of(3), 40);
    let frame = Frame::v4(ADDRESS_V4, UNICAST_PORT).carrying(message.bytes());
    let outcomes = [
        layer.run_xdp(&frame)?,
        layer.run_filter(&at_socket(UNICAST_PORT, message.bytes()))?,
    ];
    Ok(outcomes.map(|outcome| {
        let is_delivered = outcome.records.contains_key(&APP);
        let is_dropped = outcome.counts.contains_key("drop_foreign_source");
        assert_ne!(is_delivered, is_dropped, "{outcome:?}");
        is_delivered
    }))
}

#[test]
fn data_of_peers_and_strangers_is_taken_from_their_addresses_only() -> Result<()> {
    skip_unless!(require::root());
    for map in [name::PEERS, name::STRANGERS] {
        let mut layer = layer(DOORBELL_RING)?;
        assert_eq!(delivered(&mut layer)?, [true; 2], "nobody is known");
        let mut peer = Peer::default();
        peer.addresses[0] = mapped([198, 51, 100, 9]);
        layer.insert(map, REMOTE, peer)?;
        assert_eq!(delivered(&mut layer)?, [false; 2], "{map}");
        peer.addresses[1] = mapped(Frame::SOURCE_V4);
        layer.insert(map, REMOTE, peer)?;
        // A test run has no source address for the filter.
        assert_eq!(delivered(&mut layer)?, [true, false], "{map}");
        layer.configure(Config {
            abi_version: ABI_VERSION,
            discovery: DISCOVERY_KERNEL,
            doorbell: DOORBELL_RING,
            any_source: 1,
            answer_until_ns: FOR_EVER,
        })?;
        assert_eq!(delivered(&mut layer)?, [true; 2], "any source will do");
    }
    Ok(())
}
