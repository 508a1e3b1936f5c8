//! Keyed instances and their ends, seen on the other side.

use std::collections::BTreeSet;

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;

use crate::flow::{self, EVERYTHING};
use crate::layers::on_both_layers;
use crate::stage::Stage;

const SAMPLES: u64 = 30;
const COLORS: [&str; 3] = ["BLUE", "BLUE1", "BLUE2"];

on_both_layers! {
    cyclone_disposes,
    cyclone_unregisters,
    fast_dds_disposes_by_key_hash,
    fast_dds_unregisters_by_key_hash,
    app_disposes_for_cyclone,
    app_unregisters_for_cyclone,
    app_disposes_for_fast_dds,
    app_unregisters_for_fast_dds,
    app_disposes_for_app,
}

fn cyclone_disposes(layer: Layer) -> Result<()> {
    peer_ends(layer, &peers::cyclone()?, "dispose", "disposed")
}

fn cyclone_unregisters(layer: Layer) -> Result<()> {
    peer_ends(layer, &peers::cyclone()?, "unregister", "unregistered")
}

fn fast_dds_disposes_by_key_hash(layer: Layer) -> Result<()> {
    peer_ends(layer, &peers::fast_dds()?, "dispose", "disposed")
}

fn fast_dds_unregisters_by_key_hash(layer: Layer) -> Result<()> {
    peer_ends(layer, &peers::fast_dds()?, "unregister", "unregistered")
}

fn app_disposes_for_cyclone(layer: Layer) -> Result<()> {
    app_ends(layer, &peers::cyclone()?, "dispose", "disposed")
}

fn app_unregisters_for_cyclone(layer: Layer) -> Result<()> {
    app_ends(layer, &peers::cyclone()?, "unregister", "unregistered")
}

fn app_disposes_for_fast_dds(layer: Layer) -> Result<()> {
    app_ends(layer, &peers::fast_dds()?, "dispose", "disposed")
}

fn app_unregisters_for_fast_dds(layer: Layer) -> Result<()> {
    app_ends(layer, &peers::fast_dds()?, "unregister", "unregistered")
}

fn app_disposes_for_app(layer: Layer) -> Result<()> {
    let stage = Stage::new("instances")?;
    let (near, far) = (stage.near(layer)?, stage.far(layer)?);
    let subscriber = near.app(&subscriber())?;
    let publisher = far.app(&publisher("dispose"))?;
    ensure_ends(publisher, subscriber, "disposed")
}

fn peer_ends(layer: Layer, peer: &Peer, end: &str, event: &str) -> Result<()> {
    let stage = Stage::new("instances")?;
    let host = stage.near(layer)?;
    let app = host.app(&subscriber())?;
    let publisher = stage.peer(peer, &publisher(end))?;
    ensure_ends(publisher, app, event)
}

fn app_ends(layer: Layer, peer: &Peer, end: &str, event: &str) -> Result<()> {
    let stage = Stage::new("instances")?;
    let host = stage.near(layer)?;
    let subscriber = stage.peer(peer, &subscriber())?;
    let app = host.app(&publisher(end))?;
    ensure_ends(app, subscriber, event)
}

/// Runs on when the samples are there: the ends come after them.
pub(crate) fn subscriber() -> String {
    format!("--sub {EVERYTHING}")
}

/// Stays after the ends: a writer that goes takes its instances with it.
pub(crate) fn publisher(end: &str) -> String {
    format!(
        "--pub {EVERYTHING} --count {SAMPLES} --instances {} --period-us 500 --{end} --linger 50",
        COLORS.len()
    )
}

pub(crate) fn ensure_ends(publisher: Process, mut subscriber: Process, event: &str) -> Result<()> {
    let mut missing = BTreeSet::from(COLORS);
    while !missing.is_empty() {
        let end = subscriber.wait_json_event(|seen| seen["event"] == event, flow::END)?;
        let color = end["color"].as_str().unwrap_or_default();
        ensure!(missing.remove(color), "{end}; {}", subscriber.text());
    }
    let mut numbers = flow::numbers(&subscriber);
    // A reader may hand out one instance after the other.
    for instance in 0..COLORS.len() as u64 {
        let of_instance = |number: &&u64| **number % COLORS.len() as u64 == instance;
        ensure!(
            numbers.iter().filter(of_instance).is_sorted(),
            "{numbers:?}"
        );
    }
    numbers.sort_unstable();
    ensure!(numbers == Vec::from_iter(0..SAMPLES), "{numbers:?}");
    let others = ["disposed", "unregistered"];
    let wrong = subscriber.events().into_iter().find(|seen| {
        let name = seen["event"].as_str().unwrap_or_default();
        name != event && others.contains(&name)
    });
    ensure!(wrong.is_none(), "{wrong:?}");
    drop(publisher);
    Ok(())
}
