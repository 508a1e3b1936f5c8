//! rtpsd does not run for a while: a newcomer finds the host and all that is on it nevertheless, but not for ever.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage};
use rtps_tests::{require, skip_unless};

use crate::crowd::Crowd;
use crate::support::{LONG_LEASE, knows, while_stopped};

const SAMPLES: u64 = 200;
const COMMON: &str = "--reliable --durability transient-local --timeout 100";
/// A third of it is more than a program takes to start.
const LEASE: Duration = Duration::from_secs(20);

#[test]
fn cyclone_finds_the_host_and_every_endpoint() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("newcomer")?;
    let mut layer = stage.load_with(&stage.ours, &format!("--lease {}", LEASE.as_secs()))?;
    let app = |arguments: String| stage.app(&stage.ours, Layer::Kernel, &arguments);
    let subscriber = format!("--sub --topic Square {COMMON} --count {SAMPLES}");
    let mut readers = [
        app(subscriber.clone())?,
        app(subscriber.clone())?,
        app(subscriber)?,
    ];
    let publisher = |color: &str| {
        app(format!(
            "--pub --topic Circle --color {color} {COMMON} --count {SAMPLES} --linger 100"
        ))
    };
    let _writers = [publisher("RED")?, publisher("GREEN")?];
    // A first newcomer, with rtpsd there, shows that all endpoints are announced.
    let mut witness = stage.cyclone(&format!("--sub --topic Circle {COMMON}"))?;
    wait_matched(&mut witness, 2, PATIENCE)?;
    drop(witness);

    let (mut publisher, mut subscriber) = while_stopped(&mut layer, || {
        let deadline = Instant::now() + LEASE / 3;
        let left = || deadline.saturating_duration_since(Instant::now());
        let publisher = format!("--pub --topic Square {COMMON} --count {SAMPLES} --wait-match 3");
        let mut publisher = stage.cyclone(&publisher)?;
        let subscriber = format!("--sub --topic Circle {COMMON} --count {}", 2 * SAMPLES);
        let mut subscriber = stage.cyclone(&subscriber)?;
        wait_matched(&mut publisher, 3, left()).context("the apps' readers")?;
        wait_matched(&mut subscriber, 2, left()).context("the apps' writers")?;
        Ok((publisher, subscriber))
    })?;

    for reader in &mut readers {
        reader.wait_success(PATIENCE)?;
        ensure!(samples(reader) == SAMPLES, "{}", reader.last_text());
    }
    subscriber.wait_success(PATIENCE)?;
    ensure!(
        samples(&subscriber) == 2 * SAMPLES,
        "{}",
        subscriber.last_text()
    );
    publisher.wait_success(PATIENCE)
}

fn wait_matched(process: &mut Process, count: u64, time: Duration) -> Result<()> {
    let wanted =
        |event: &serde_json::Value| event["event"] == "matched" && event["current"] == count;
    process.wait_json_event(wanted, time).map(drop)
}

fn samples(subscriber: &Process) -> u64 {
    let events = subscriber.events();
    let samples = events.iter().filter(|event| event["event"] == "sample");
    samples.count() as u64
}

/// A host that nobody cares for must not look alive.
#[test]
fn nobody_is_answered_after_half_a_lease() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("half-a-lease")?;
    let mut layer = stage.load_with(&stage.ours, "--lease 4")?;
    let times = (Duration::from_secs(1), LONG_LEASE);
    let stranger = || Crowd::new(&stage.theirs, stage.ours.interface.v4, 1, times);
    let (early, mut late) = (stranger()?, stranger()?);
    while_stopped(&mut layer, || {
        early.send(&early.remotes[0].announcement())?;
        ensure!(early.hears_something(PATIENCE)?, "no answer at first");
        thread::sleep(Duration::from_millis(2_500));
        late.send(&late.remotes[0].announcement())?;
        ensure!(!late.hears_something(Duration::from_secs(1))?, "an answer");
        Ok(())
    })?;
    // What it has said meanwhile has not been forgotten.
    ensure!(
        late.hears_something(PATIENCE)?,
        "rtpsd does not answer either"
    );
    late.run_until_content()?;
    ensure!(knows(&layer, late.remotes[0].prefix)?);
    Ok(())
}
