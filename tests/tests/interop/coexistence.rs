//! One host: apps of ours with each other, with another vendor's programs, and those among themselves.

use anyhow::Result;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};

use crate::flow::{self, Arguments};
use crate::layers::{on_both_layers, on_every_layer};
use crate::stage::Stage;

const SAMPLES: u64 = 300;
const LARGE: u64 = 20_000;

on_every_layer! {
    cyclone_to_app,
    app_to_cyclone,
    fast_dds_to_app,
    app_to_fast_dds,
    cyclone_to_cyclone_beside_us,
    cyclone_across_beside_us,
}

on_both_layers! {
    app_to_app,
    large_samples_app_to_app,
}

fn app_to_app(layer: Layer) -> Result<()> {
    apps_of_one_host(layer, SAMPLES, 0)
}

fn large_samples_app_to_app(layer: Layer) -> Result<()> {
    apps_of_one_host(layer, 30, LARGE)
}

fn apps_of_one_host(layer: Layer, samples: u64, size: u64) -> Result<()> {
    let stage = Stage::new("loopback")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(samples, 2, &format!("--size {size}"));
    let subscribers = [
        host.app(&arguments.subscriber)?,
        host.app(&arguments.subscriber)?,
    ];
    let publisher = host.app(&arguments.publisher)?;
    flow::complete(publisher, subscribers, samples, size)
}

fn cyclone_to_app(layer: Layer) -> Result<()> {
    peer_to_app(layer, &peers::cyclone()?)
}

fn fast_dds_to_app(layer: Layer) -> Result<()> {
    peer_to_app(layer, &peers::fast_dds()?)
}

fn peer_to_app(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("same-host")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let app = host.app(&arguments.subscriber)?;
    let publisher = host.peer(peer, &arguments.publisher)?;
    flow::complete(publisher, [app], SAMPLES, 0)
}

fn app_to_cyclone(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::cyclone()?)
}

fn app_to_fast_dds(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::fast_dds()?)
}

fn app_to_peer(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("same-host")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let subscriber = host.peer(peer, &arguments.subscriber)?;
    let publisher = host.app(&arguments.publisher)?;
    flow::complete(publisher, [subscriber], SAMPLES, 0)
}

/// Cyclone's programs of one host talk to each other while an app of ours listens in.
fn cyclone_to_cyclone_beside_us(layer: Layer) -> Result<()> {
    let stage = Stage::new("beside")?;
    let host = stage.near(layer)?;
    let cyclone = peers::cyclone()?;
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let subscribers = [
        host.peer(&cyclone, &arguments.subscriber)?,
        host.app(&arguments.subscriber)?,
    ];
    let publisher = host.peer(&cyclone, &arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}

/// The same across the link, so that Cyclone's multicast passes our XDP program.
fn cyclone_across_beside_us(layer: Layer) -> Result<()> {
    let stage = Stage::new("across")?;
    let host = stage.near(layer)?;
    let cyclone = peers::cyclone()?;
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let subscribers = [
        host.peer(&cyclone, &arguments.subscriber)?,
        host.app(&arguments.subscriber)?,
    ];
    let publisher = stage.peer(&cyclone, &arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}
