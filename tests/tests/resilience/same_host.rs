//! Apps of one host exchange samples through shared memory: without the network, without rtpsd, and whatever becomes of
//! the other app.

use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::stage::{PATIENCE, Stage, counter, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

const OURS: End = End::Ours(Layer::Kernel);

#[test]
fn samples_do_not_touch_the_network() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("same-host")?;
    let layer = stage.load(&stage.ours)?;
    Stream::start(&stage, "Square", (OURS, OURS), RATE)?.finish()?;
    let delivered = counter(&layer.status()?, "delivered_messages");
    ensure!(delivered == 0, "{delivered} messages came by the kernel");
    Ok(())
}

#[test]
fn a_stream_goes_on_while_rtpsd_is_killed_and_started_again() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("same-host-killed")?;
    let mut layer = stage.load(&stage.ours)?;
    let mut stream = Stream::start(&stage, "Square", (OURS, OURS), 15 * RATE)?;
    for round in ["First", "Second"] {
        stream.wait_for(stream.position() + 200)?;
        layer.kill()?;
        stream
            .wait_for(stream.position() + RATE)
            .context("while rtpsd was gone")?;
        layer = stage.load(&stage.ours)?;
        eventually("both apps come back", || {
            let status = layer.status()?;
            let back = status.apps.iter().filter(|app| app.pid.is_some());
            Ok((back.count() == 2).then_some(()))
        })?;
        stream.wait_for(stream.position() + 200)?;
        Stream::start(&stage, round, (OURS, OURS), 100)?.finish()?;
    }
    stream.finish().map(drop)
}

#[test]
fn a_reader_that_is_killed_holds_up_nobody() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("same-host-reader")?;
    let layer = stage.load(&stage.ours)?;
    let app = |arguments: &str| {
        let common = "--reliable --history-keep-all --durability transient-local --timeout 120";
        stage.app(&stage.ours, Layer::Kernel, &format!("{arguments} {common}"))
    };
    let victim = app("--sub")?;
    let mut survivor = app("--sub --count 4000 --linger 0.5")?;
    let mut publisher = app("--pub --count 4000 --period-us 500 --wait-match 2")?;
    let first = |event: &serde_json::Value| event["event"] == "sample";
    survivor.wait_json_event(first, PATIENCE)?;
    victim.signal(Signal::SIGSTOP)?;
    // What is written meanwhile fills the ring to it.
    thread::sleep(Duration::from_millis(500));
    victim.signal(Signal::SIGKILL)?;
    publisher.wait_success(PATIENCE)?;
    survivor.wait_success(PATIENCE)?;
    eventually("all slots are free", || {
        Ok(layer.status()?.apps.is_empty().then_some(()))
    })
}
