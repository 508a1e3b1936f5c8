//! Readers that come late: TRANSIENT_LOCAL gives them what the history holds.

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;

use crate::flow::{self, EVERYTHING};
use crate::layers::{on_both_layers, on_every_layer};
use crate::stage::Stage;

pub(crate) const SAMPLES: u64 = 60;
const DEPTH: u64 = 5;

on_every_layer! {
    app_joins_late_to_cyclone,
    app_joins_late_to_fast_dds,
    cyclone_joins_late_to_app,
    fast_dds_joins_late_to_app,
}

on_both_layers! {
    keep_last_of_cyclone,
    keep_last_of_fast_dds,
    keep_last_for_cyclone,
    keep_last_for_fast_dds,
    volatile_reader_gets_what_follows,
}

fn app_joins_late_to_cyclone(layer: Layer) -> Result<()> {
    app_joins_late(layer, &peers::cyclone()?, "--history-keep-all", SAMPLES)
}

fn app_joins_late_to_fast_dds(layer: Layer) -> Result<()> {
    app_joins_late(layer, &peers::fast_dds()?, "--history-keep-all", SAMPLES)
}

fn cyclone_joins_late_to_app(layer: Layer) -> Result<()> {
    peer_joins_late(layer, &peers::cyclone()?, "--history-keep-all", SAMPLES)
}

fn fast_dds_joins_late_to_app(layer: Layer) -> Result<()> {
    peer_joins_late(layer, &peers::fast_dds()?, "--history-keep-all", SAMPLES)
}

fn keep_last_of_cyclone(layer: Layer) -> Result<()> {
    app_joins_late(layer, &peers::cyclone()?, &keep_last(), DEPTH)
}

fn keep_last_of_fast_dds(layer: Layer) -> Result<()> {
    app_joins_late(layer, &peers::fast_dds()?, &keep_last(), DEPTH)
}

fn keep_last_for_cyclone(layer: Layer) -> Result<()> {
    peer_joins_late(layer, &peers::cyclone()?, &keep_last(), DEPTH)
}

fn keep_last_for_fast_dds(layer: Layer) -> Result<()> {
    peer_joins_late(layer, &peers::fast_dds()?, &keep_last(), DEPTH)
}

fn keep_last() -> String {
    format!("--keep-last {DEPTH}")
}

/// The writer goes on living after its last sample.
pub(crate) fn publisher(history: &str) -> String {
    format!("--pub {EVERYTHING} --count {SAMPLES} --wait-match 0 --linger 50 {history}")
}

pub(crate) fn subscriber(count: u64) -> String {
    format!("--sub {EVERYTHING} --count {count}")
}

fn app_joins_late(layer: Layer, peer: &Peer, history: &str, kept: u64) -> Result<()> {
    let stage = Stage::new("late-app")?;
    let host = stage.near(layer)?;
    let _publisher = stage.peer(peer, &publisher(history))?;
    // When the first reader has the last sample, all are written.
    let mut first = host.app(&subscriber(0))?;
    flow::wait_sample(&mut first, SAMPLES - 1)?;
    ensure_kept(host.app(&subscriber(kept))?, kept)
}

fn peer_joins_late(layer: Layer, peer: &Peer, history: &str, kept: u64) -> Result<()> {
    let stage = Stage::new("late-peer")?;
    let host = stage.near(layer)?;
    let _publisher = host.app(&publisher(history))?;
    let mut first = stage.peer(peer, &subscriber(0))?;
    flow::wait_sample(&mut first, SAMPLES - 1)?;
    ensure_kept(stage.peer(peer, &subscriber(kept))?, kept)
}

/// The late reader gets the last `kept` samples and none before them.
pub(crate) fn ensure_kept(mut late: Process, kept: u64) -> Result<()> {
    late.wait_success(flow::END)?;
    let numbers = flow::numbers(&late);
    ensure!(
        numbers == Vec::from_iter(SAMPLES - kept..SAMPLES),
        "{numbers:?}"
    );
    Ok(())
}

/// A reader that does not want the history starts somewhere, and then misses nothing.
fn volatile_reader_gets_what_follows(layer: Layer) -> Result<()> {
    let stage = Stage::new("volatile")?;
    let host = stage.near(layer)?;
    let publisher = format!("--pub {EVERYTHING} --wait-match 0 --period-us 2000");
    let _publisher = stage.peer(&peers::cyclone()?, &publisher)?;
    let mut first = host.app(&subscriber(0))?;
    flow::wait_sample(&mut first, SAMPLES)?;
    let mut late = host.app(&format!(
        "--sub --reliable --durability volatile --timeout 50 --count {SAMPLES}"
    ))?;
    late.wait_success(flow::END)?;
    let numbers = flow::numbers(&late);
    let start = *numbers.first().unwrap_or(&0);
    ensure!(start >= SAMPLES, "{numbers:?}");
    let end = start + numbers.len() as u64;
    ensure!(numbers == Vec::from_iter(start..end), "{numbers:?}");
    Ok(())
}
