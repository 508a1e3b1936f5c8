//! Who is matched with whom: incompatible QoS is told to both sides, partitions keep apart in silence.

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtps_tests::{require, skip_unless};

use crate::flow::{self, EVERYTHING};
use crate::layers::on_every_layer;
use crate::stage::Stage;

const SAMPLES: u64 = 50;
/// What is offered is less than what is requested.
pub(crate) const OFFER: &str = "--pub --best-effort --timeout 50";
pub(crate) const REQUEST: &str = "--sub --reliable --timeout 50";

on_every_layer! {
    cyclone_offers_too_little,
    fast_dds_offers_too_little,
    cyclone_requests_too_much,
    fast_dds_requests_too_much,
    partitions_with_cyclone,
    partitions_with_fast_dds,
    cyclone_goes_and_comes_back,
}

fn cyclone_offers_too_little(layer: Layer) -> Result<()> {
    offers_too_little(layer, &peers::cyclone()?)
}

fn fast_dds_offers_too_little(layer: Layer) -> Result<()> {
    offers_too_little(layer, &peers::fast_dds()?)
}

fn cyclone_requests_too_much(layer: Layer) -> Result<()> {
    requests_too_much(layer, &peers::cyclone()?)
}

fn fast_dds_requests_too_much(layer: Layer) -> Result<()> {
    requests_too_much(layer, &peers::fast_dds()?)
}

fn offers_too_little(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("offers")?;
    let host = stage.near(layer)?;
    let app = host.app(REQUEST)?;
    ensure_told([stage.peer(peer, OFFER)?, app])
}

fn requests_too_much(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("requests")?;
    let host = stage.near(layer)?;
    let app = host.app(OFFER)?;
    ensure_told([stage.peer(peer, REQUEST)?, app])
}

/// Both ends live until both have been told.
pub(crate) fn ensure_told(mut ends: [Process; 2]) -> Result<()> {
    for end in &mut ends {
        let told = end.wait_json_event(|event| event["event"] == "incompatible_qos", flow::END)?;
        ensure!(told["policy"] == "RELIABILITY", "{told}");
        let matched = end.events().iter().any(|event| event["event"] == "matched");
        ensure!(!matched, "{}", end.text());
    }
    Ok(())
}

fn partitions_with_cyclone(layer: Layer) -> Result<()> {
    partitions(layer, &peers::cyclone()?)
}

fn partitions_with_fast_dds(layer: Layer) -> Result<()> {
    partitions(layer, &peers::fast_dds()?)
}

/// A reader in another partition is there before the one that gets everything, and gets nothing.
fn partitions(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("partitions")?;
    let host = stage.near(layer)?;
    let both = format!("{EVERYTHING} --count {SAMPLES}");
    let subscriber = |partition: &str| format!("--sub {both} --partition {partition}");
    let publisher = |partition: &str| format!("--pub {both} --partition {partition}");

    let elsewhere = host.app(&subscriber("elsewhere"))?;
    let here = host.app(&subscriber("here"))?;
    flow::complete(stage.peer(peer, &publisher("here"))?, [here], SAMPLES, 0)?;
    ensure_alone(&elsewhere)?;

    let elsewhere = stage.peer(peer, &subscriber("elsewhere"))?;
    let there = stage.peer(peer, &subscriber("there"))?;
    flow::complete(host.app(&publisher("there"))?, [there], SAMPLES, 0)?;
    ensure_alone(&elsewhere)
}

/// Cyclone tells of partitions that differ, and the standard does not forbid it.
pub(crate) fn ensure_alone(process: &Process) -> Result<()> {
    let events = process.events();
    let mut kinds = events.iter().map(|event| &event["event"]);
    ensure!(
        kinds.all(|kind| kind == "incompatible_qos"),
        "{}",
        process.text()
    );
    Ok(())
}

/// A writer that ends takes its match with it; a new one is found again.
fn cyclone_goes_and_comes_back(layer: Layer) -> Result<()> {
    let stage = Stage::new("comes-back")?;
    let host = stage.near(layer)?;
    let mut app = host.app(&format!("--sub {EVERYTHING}"))?;
    let cyclone = peers::cyclone()?;
    for _ in 0..2 {
        let mut publisher = stage.peer(&cyclone, &format!("--pub {EVERYTHING} --count 10"))?;
        flow::wait_matched(&mut app, 1)?;
        flow::wait_sample(&mut app, 9)?;
        publisher.wait_success(flow::END)?;
        flow::wait_matched(&mut app, 0)?;
    }
    Ok(())
}

#[test]
fn cyclone_forgets_us_and_finds_us_again() -> Result<()> {
    skip_unless!(require::root());
    forgotten_and_found(&peers::cyclone()?)
}

#[test]
fn fast_dds_forgets_us_and_finds_us_again() -> Result<()> {
    skip_unless!(require::root());
    forgotten_and_found(&peers::fast_dds()?)
}

/// rtpsd is silent for longer than its lease, but not for longer than the other's: only the other side has to begin
/// anew.
fn forgotten_and_found(peer: &Peer) -> Result<()> {
    let stage = Stage::new("forgotten")?;
    let mut host = stage.near_with(Layer::Kernel, &["--lease", "2"])?;
    // Samples and ACKNACKs of the apps would be signs of life.
    let silent = |topic: &str| format!("{EVERYTHING} --topic {topic} --linger 50");
    let mut ends = [
        (
            host.app(&format!("--sub {}", silent("Square")))?,
            "app's reader",
        ),
        (
            host.app(&format!("--pub --count 1 {}", silent("Circle")))?,
            "app's writer",
        ),
        (
            stage.peer(peer, &format!("--pub --count 1 {}", silent("Square")))?,
            "peer's writer",
        ),
        (
            stage.peer(peer, &format!("--sub {}", silent("Circle")))?,
            "peer's reader",
        ),
    ];
    for (end, name) in &mut ends {
        flow::wait_matched(end, 1).context(*name)?;
    }
    let rtpsd = host.daemon().context("the layer is a kernel layer")?;
    rtpsd.process().signal(Signal::SIGSTOP)?;
    let [_, _, theirs @ ..] = &mut ends;
    for (end, name) in &mut *theirs {
        flow::wait_matched(end, 0).context(*name)?;
    }
    rtpsd.process().signal(Signal::SIGCONT)?;
    for (end, name) in &mut *theirs {
        flow::wait_matched(end, 1).context(*name)?;
    }
    Ok(())
}
