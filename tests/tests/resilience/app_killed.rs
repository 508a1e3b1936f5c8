//! An app dies (SIGKILL): others learn it at once, and its slot serves again.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::stream::{End, Stream};
use rtps_tests::{require, skip_unless};

use crate::control_socket::ControlSocket;

/// How soon the remote side must know.
const WITHDRAWN: Duration = Duration::from_secs(2);

#[test]
fn its_endpoints_are_withdrawn_and_others_go_on() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("app-killed")?;
    let layer = stage.load(&stage.ours)?;
    let mut cyclone = stage.cyclone("--sub --timeout 120")?;
    let publish = |color: &str| {
        let arguments = format!("--pub --color {color} --period-us 5000 --timeout 120");
        stage.app(&stage.ours, Layer::Kernel, &arguments)
    };
    let (victim, survivor) = (publish("RED")?, publish("GREEN")?);
    wait_samples(&mut cyclone, "RED")?;
    wait_samples(&mut cyclone, "GREEN")?;
    let slot = slot_of(&layer, &victim)?;
    let killed = Instant::now();
    victim.signal(Signal::SIGKILL)?;
    wait_matched(&mut cyclone, 1)?;
    ensure!(killed.elapsed() < WITHDRAWN, "{:?}", killed.elapsed());
    wait_samples(&mut cyclone, "GREEN")?;
    let status = layer.status()?;
    ensure!(
        status.apps.iter().all(|app| app.slot != slot),
        "{:?}",
        status.apps
    );
    let killed = Instant::now();
    survivor.signal(Signal::SIGKILL)?;
    wait_matched(&mut cyclone, 0)?;
    ensure!(killed.elapsed() < WITHDRAWN, "{:?}", killed.elapsed());
    reuse_slot(&stage, &layer, slot)
}

/// Slots rest as long as possible: all others have their turn first.
fn reuse_slot(stage: &Stage, layer: &KernelLayer<'_>, slot: u8) -> Result<()> {
    let before = if slot == 1 { u8::MAX } else { slot - 1 };
    let netns = &stage.ours.netns;
    let mut last = ControlSocket::connect(netns)?.slot()?;
    for _ in 0..=u8::MAX {
        if last == before {
            break;
        }
        last = ControlSocket::connect(netns)?.slot()?;
    }
    let ends = (End::Ours(Layer::Kernel), End::Cyclone);
    let mut stream = Stream::start(stage, "Circle", ends, 2000)?;
    stream.wait_for(0)?;
    ensure!(slot_of(layer, stream.publisher())? == slot);
    stream.finish().map(drop)
}

fn slot_of(layer: &KernelLayer<'_>, app: &Process) -> Result<u8> {
    let pid = Some(app.pid().as_raw());
    let status = layer.status()?;
    let seat = status.apps.iter().find(|app| app.pid == pid);
    Ok(seat.context("rtpsd does not know the app")?.slot)
}

fn wait_samples(subscriber: &mut Process, color: &str) -> Result<()> {
    let wanted = |event: &serde_json::Value| event["event"] == "sample" && event["color"] == color;
    subscriber.wait_json_event(wanted, PATIENCE).map(drop)
}

fn wait_matched(subscriber: &mut Process, current: u64) -> Result<()> {
    let wanted =
        |event: &serde_json::Value| event["event"] == "matched" && event["current"] == current;
    subscriber.wait_json_event(wanted, PATIENCE).map(drop)
}

/// The other way round: a reader of ours dies, and a writer that waits for its acknowledgments is not held up.
#[test]
fn a_writer_does_not_wait_for_a_dead_reader() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("reader-killed")?;
    let layer = stage.load(&stage.ours)?;
    let mut victim = stage.app(&stage.ours, Layer::Kernel, "--sub --timeout 120")?;
    let mut publisher = stage.cyclone(
        "--pub --reliable --history-keep-all --count 3000 --period-us 1000 --timeout 120",
    )?;
    wait_samples(&mut victim, "BLUE")?;
    victim.signal(Signal::SIGKILL)?;
    publisher.wait_success(PATIENCE)?;
    eventually("the slot is free", || {
        Ok(layer.status()?.apps.is_empty().then_some(()))
    })
}
