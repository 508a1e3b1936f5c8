//! A participant is where it was discovered: nobody else speaks in its name, unless that check is turned off.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::stage::{Stage, counter, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};
use rtps_user::wire::{EntityId, Guid, GuidPrefix, Heartbeat, MessageWriter, SequenceNumber};

use crate::crowd::Crowd;
use crate::support::{LONG_LEASE, known_crowd, knows, participants};

/// Another address of the host that the participants are on.
const ELSEWHERE: Ipv4Addr = Ipv4Addr::new(10, 1, 0, 3);
const TIMES: (Duration, Duration) = (Duration::from_millis(200), LONG_LEASE);
/// Where the host receives samples of domain 0 (RTPS 2.5, 9.6.2.3).
const USER_UNICAST: u16 = 7411;

#[test]
fn nobody_elsewhere_takes_a_participant_away() -> Result<()> {
    skip_unless!(require::root());
    let stage = stage_with_two_addresses("foreign")?;
    let layer = stage.load(&stage.ours)?;
    let mut crowd = known_crowd(&stage, 1, TIMES)?;
    let victim = crowd.remotes[0].prefix;
    let before = dropped(&layer)?;
    impostor(&stage)?.send(&crowd.remotes[0].farewell())?;
    eventually("the datagram is dropped", || {
        Ok((dropped(&layer)? > before).then_some(()))
    })?;
    ensure!(knows(&layer, victim)?, "it is gone");
    // From where it belongs, the same says that it goes.
    crowd.send(&crowd.remotes[0].farewell())?;
    crowd.truncate(0);
    eventually("it is gone", || Ok((!knows(&layer, victim)?).then_some(())))
}

#[test]
fn with_any_source_everybody_may_speak() -> Result<()> {
    skip_unless!(require::root());
    let stage = stage_with_two_addresses("any-source")?;
    let layer = stage.load_with(&stage.ours, "--any-source")?;
    let crowd = known_crowd(&stage, 1, TIMES)?;
    let victim = crowd.remotes[0].prefix;
    ensure!(knows(&layer, victim)?);
    impostor(&stage)?.send(&crowd.remotes[0].farewell())?;
    eventually("it is gone", || Ok((!knows(&layer, victim)?).then_some(())))?;
    ensure!(dropped(&layer)? == 0);
    Ok(())
}

/// A HEARTBEAT can make a reader skip everything: one from elsewhere does not get to the app.
#[test]
fn nobody_elsewhere_makes_readers_skip_samples() -> Result<()> {
    skip_unless!(require::root());
    let stage = stage_with_two_addresses("skip")?;
    let layer = stage.load(&stage.ours)?;
    let ends = (End::Cyclone, End::Ours(Layer::Kernel));
    let mut stream = Stream::start(&stage, "Square", ends, 4 * RATE)?;
    stream.wait_for(100)?;
    let (prefix, writer) = remote_writer(&layer)?;
    let mut message = Vec::new();
    MessageWriter::new(&mut message, prefix).heartbeat(&Heartbeat {
        reader: EntityId::UNKNOWN,
        writer,
        first: SequenceNumber(1 << 40),
        last: SequenceNumber((1 << 40) + 1),
        count: i32::MAX,
        is_final: false,
        liveliness: false,
        group: None,
    });
    let before = dropped(&layer)?;
    let socket = stage
        .theirs
        .netns
        .enter(|| UdpSocket::bind((ELSEWHERE, 0)))?;
    socket.send_to(&message, (stage.ours.interface.v4, USER_UNICAST))?;
    eventually("the datagram is dropped", || {
        Ok((dropped(&layer)? > before).then_some(()))
    })?;
    stream.finish().map(drop)
}

fn stage_with_two_addresses(label: &str) -> Result<Stage> {
    let stage = Stage::new(label)?;
    let name = &stage.theirs.interface.name;
    stage
        .theirs
        .netns
        .ip(&format!("address add {ELSEWHERE}/24 dev {name}"))?;
    Ok(stage)
}

/// Sends from elsewhere.
fn impostor(stage: &Stage) -> Result<Crowd> {
    Crowd::at(
        (&stage.theirs, ELSEWHERE),
        stage.ours.interface.v4,
        0,
        TIMES,
    )
}

fn dropped(layer: &KernelLayer<'_>) -> Result<u64> {
    Ok(counter(&layer.status()?, "drop_foreign_source"))
}

/// The one remote writer of user data.
fn remote_writer(layer: &KernelLayer<'_>) -> Result<(GuidPrefix, EntityId)> {
    let participants = participants(layer)?;
    let endpoints = participants
        .iter()
        .filter_map(|one| one["endpoints"].as_array());
    let mut writers = endpoints.flatten().filter(|one| one["kind"] == "writer");
    let writer = writers.next().context("no remote writer is known")?;
    let guid = writer["guid"].as_str().context("it has no GUID")?;
    let digits: Vec<char> = guid.chars().filter(char::is_ascii_hexdigit).collect();
    let bytes = digits
        .chunks(2)
        .map(|pair| Ok(u8::from_str_radix(&pair.iter().collect::<String>(), 16)?))
        .collect::<Result<Vec<u8>>>()?;
    let bytes: [u8; 16] = bytes
        .try_into()
        .ok()
        .with_context(|| format!("no GUID: {guid}"))?;
    let guid = Guid::from_bytes(bytes);
    Ok((guid.prefix, guid.entity))
}
