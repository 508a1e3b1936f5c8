//! Samples of 4 MB, 20 a second, while single packets get lost: they arrive complete and in time.

use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::link::Bridge;
use rtps_tests::loss::{Loss, LossCount};
use rtps_tests::process::{Process, peak_resident};
use rtps_tests::require;
use rtps_tests::skip_unless;
use rtps_tests::stage::binaries;
use serde_json::Value;

use crate::flow::{self, END};
use crate::layers::on_both_layers;
use crate::stage::Host;

on_both_layers! { between_hosts }

const SIZE: u64 = 4 << 20;
const SAMPLES: u64 = 90;
const PERIOD: Duration = Duration::from_millis(50);
/// Of the packets in both directions.
const LOSS: f64 = 0.05;
/// A writer that waited longer for room would say so.
const MAX_BLOCKING: Duration = Duration::from_secs(1);
/// Where samples pile up, it is more.
const MEMORY: u64 = 100 << 20;

fn between_hosts(layer: Layer) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    binaries()?;
    let bridge = Bridge::new("large-lossy", 2, 1500)?;
    let lossy = bridge.lose(Loss::Random(
        std::env::var("XLOSS").map_or(LOSS, |t| t.parse().unwrap()),
    ))?;
    let [near, far] = [0, 1].map(|host| Host::new(&bridge.hosts[host], layer, &[]));
    let (near, far) = (near?, far?);
    let both = format!("--reliable --count {SAMPLES} --size {SIZE} --pattern --timeout 50");
    let mut subscriber = far.app(&format!("--sub {both} --linger 1"))?;
    let mut publisher = near.app(&format!(
        "--pub {both} --period-us {} --max-blocking {} --linger 1",
        PERIOD.as_micros(),
        MAX_BLOCKING.as_secs_f64()
    ))?;
    flow::wait_sample(&mut subscriber, SAMPLES - 1)
        .with_context(|| format!("the publisher's output:\n{}", publisher.last_text()))?;
    for app in [&publisher, &subscriber] {
        let memory = peak_resident(app.pid())?;
        ensure!(memory < MEMORY, "{memory} bytes");
    }
    publisher.wait_success(END)?;
    subscriber.wait_success(END)?;
    ensure_in_time(&publisher)?;
    flow::ensure_all(&subscriber, SAMPLES, SIZE)?;
    ensure_intact(&subscriber)?;
    let [there, back] = lossy.as_slice() else {
        bail!("two hosts");
    };
    ensure_lost(there.count()?, back.count()?)
}

/// The writer held its rate, and waited for room for less than it may.
fn ensure_in_time(publisher: &Process) -> Result<()> {
    let events = publisher.events();
    let done = events.iter().find(|event| event["event"] == "done");
    let seconds = done.and_then(|event| event["written_in_s"].as_f64());
    let due = PERIOD * u32::try_from(SAMPLES)?;
    ensure!(
        seconds < Some((due + MAX_BLOCKING).as_secs_f64()),
        "{events:?}"
    );
    let timeout = events.iter().find(|event| event["event"] == "timeout");
    ensure!(timeout.is_none(), "{events:?}");
    Ok(())
}

fn ensure_intact(subscriber: &Process) -> Result<()> {
    let events = subscriber.events();
    let samples = events.iter().filter(|event| event["event"] == "sample");
    let damaged: Vec<&Value> = samples.filter(|sample| sample["intact"] != true).collect();
    ensure!(damaged.is_empty(), "{damaged:?}");
    Ok(())
}

/// Each packet of the samples was seen alone, and those that are too many to be chance were lost.
fn ensure_lost(there: LossCount, back: LossCount) -> Result<()> {
    let packets = SAMPLES * SIZE / 1500;
    let is_lossy = there.dropped as f64 > 0.9 * LOSS * packets as f64;
    ensure!(
        there.seen > packets && is_lossy && back.dropped > 0,
        "{there:?}, {back:?}"
    );
    Ok(())
}
