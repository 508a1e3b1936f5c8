//! Hostile input from the network, while a stream goes on: a flood of it, and each way to damage a real message.

use std::net::UdpSocket;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::unistd::Pid;
use rtps_tests::layer::Layer;
use rtps_tests::process::resident;
use rtps_tests::stage::{Stage, counter};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

use crate::hostile::{self, Hostile};

const FLOOD: Duration = Duration::from_secs(3);
/// Datagrams in one go, and the pause between two: up to 50,000 a second.
const BURST: u64 = 100;
const PERIOD: Duration = Duration::from_millis(2);
/// What bounded tables and buffers of one process may take in all, in bytes.
const MEMORY: u64 = 200 << 20;
/// Reasons for which a flood like this one must have been refused.
const REASONS: [&str; 6] = [
    "malformed_too_short",
    "malformed_bad_magic",
    "malformed_submessage_header",
    "malformed_submessage_length",
    "malformed_submessage_too_short",
    "drop_malformed",
];

#[test]
fn a_flood_on_the_kernel_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("flood")?;
    let mut layer = stage.load(&stage.ours)?;
    let real = hostile::record(&stage, Layer::Kernel)?;
    let ends = (End::Ours(Layer::Kernel), End::Cyclone);
    let mut streams = [
        Stream::start(&stage, "Square", (ends.1, ends.0), 8 * RATE)?,
        Stream::start(&stage, "Circle", ends, 8 * RATE)?,
    ];
    for stream in &mut streams {
        stream.wait_for(500)?;
    }
    let before = layer.status()?;
    flood(&stage, &real)?;
    let programs = [
        layer.process().pid(),
        streams[0].subscriber().pid(),
        streams[1].publisher().pid(),
    ];
    is_bounded(&programs)?;
    let after = layer.status()?;
    for reason in REASONS {
        let count = |status| counter(status, reason);
        ensure!(count(&after) > count(&before), "{reason} was not counted");
    }
    for stream in streams {
        stream.finish()?;
    }
    ensure!(
        after.rtpsd == layer.status()?.rtpsd,
        "rtpsd did not live through it"
    );
    // Who comes now is found among all the false participants.
    Stream::start(&stage, "After", ends, 100)?
        .finish()
        .map(drop)
}

#[test]
fn a_flood_on_the_in_process_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("flood-in-process")?;
    let real = hostile::record(&stage, Layer::InProcess)?;
    let ends = (End::Cyclone, End::Ours(Layer::InProcess));
    let mut stream = Stream::start(&stage, "Square", ends, 8 * RATE)?;
    stream.wait_for(500)?;
    flood(&stage, &real)?;
    is_bounded(&[stream.subscriber().pid()])?;
    stream.finish().map(drop)
}

/// Sends bad messages to every port, as many as the machine can, up to the rate.
fn flood(stage: &Stage, real: &[Vec<u8>]) -> Result<()> {
    let targets = hostile::targets(stage.ours.interface.v4);
    let socket = attacker(stage)?;
    let mut hostile = Hostile::new(real);
    let (begin, mut sent) = (Instant::now(), 0);
    while begin.elapsed() < FLOOD {
        for number in 0..BURST {
            let target = targets[(number % targets.len() as u64) as usize];
            // The sending side may be out of room.
            sent += u64::from(socket.send_to(&hostile.message(), target).is_ok());
        }
        thread::sleep(PERIOD);
    }
    ensure!(sent > 5_000, "{sent} datagrams are no flood");
    Ok(())
}

fn attacker(stage: &Stage) -> Result<UdpSocket> {
    let address = stage.theirs.interface.v4;
    let socket = stage.theirs.netns.enter(|| UdpSocket::bind((address, 0)))?;
    Ok(socket)
}

fn is_bounded(programs: &[Pid]) -> Result<()> {
    for pid in programs {
        let memory = resident(*pid).with_context(|| format!("process {pid} has ended"))?;
        ensure!(memory < MEMORY, "process {pid} takes {memory} bytes");
    }
    Ok(())
}

#[test]
fn damaged_messages_on_the_kernel_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("damaged")?;
    let layer = stage.load(&stage.ours)?;
    damage(&stage, Layer::Kernel)?;
    ensure!(counter(&layer.status()?, "drop_malformed") > 0);
    Ok(())
}

#[test]
fn damaged_messages_on_the_in_process_layer() -> Result<()> {
    skip_unless!(require::root());
    damage(&Stage::new("damaged-in-process")?, Layer::InProcess)
}

/// Messages of an earlier conversation, cut after each byte and with each byte turned over.
fn damage(stage: &Stage, layer: Layer) -> Result<()> {
    let real = hostile::record(stage, layer)?;
    let ends = (End::Cyclone, End::Ours(layer));
    let mut stream = Stream::start(stage, "Square", ends, 5 * RATE)?;
    stream.wait_for(100)?;
    let socket = attacker(stage)?;
    let targets = hostile::targets(stage.ours.interface.v4);
    for message in hostile::one_of_each_kind(&real) {
        for position in 0..message.len() {
            let mut turned = message.clone();
            turned[position] = !turned[position];
            for target in targets {
                socket.send_to(&message[..position], target)?;
                socket.send_to(&turned, target)?;
            }
        }
        // Not a flood: what is lost before it arrives tests nothing.
        thread::sleep(PERIOD);
    }
    is_bounded(&[stream.subscriber().pid()])?;
    stream.finish()?;
    Stream::start(stage, "After", ends, 100)?.finish().map(drop)
}
