//! Reliable samples, both ways, with each vendor and between hosts of ours.

use anyhow::Result;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};

use crate::flow::{self, Arguments};
use crate::layers::{on_both_layers, on_every_layer, on_pairs_of_layers};
use crate::stage::Stage;

const SAMPLES: u64 = 300;

on_every_layer! {
    cyclone_to_two_apps,
    fast_dds_to_two_apps,
    app_to_cyclone,
    app_to_fast_dds,
    app_to_both_vendors_at_once,
}

on_both_layers! {
    xcdr2_from_cyclone,
    xcdr2_to_cyclone,
}

on_pairs_of_layers! { between_hosts }

fn cyclone_to_two_apps(layer: Layer) -> Result<()> {
    peer_to_two_apps(layer, &peers::cyclone()?)
}

fn fast_dds_to_two_apps(layer: Layer) -> Result<()> {
    peer_to_two_apps(layer, &peers::fast_dds()?)
}

fn peer_to_two_apps(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("two-apps")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let apps = [
        host.app(&arguments.subscriber)?,
        host.app(&arguments.subscriber)?,
    ];
    let publisher = stage.peer(peer, &arguments.publisher)?;
    flow::complete(publisher, apps, SAMPLES, 0)
}

fn app_to_cyclone(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::cyclone()?, "")
}

fn app_to_fast_dds(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::fast_dds()?, "")
}

fn xcdr2_to_cyclone(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::cyclone()?, "--xcdr 2")
}

fn app_to_peer(layer: Layer, peer: &Peer, common: &str) -> Result<()> {
    let stage = Stage::new("to-peer")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, common);
    let subscriber = stage.peer(peer, &arguments.subscriber)?;
    flow::complete(host.app(&arguments.publisher)?, [subscriber], SAMPLES, 0)
}

fn xcdr2_from_cyclone(layer: Layer) -> Result<()> {
    let stage = Stage::new("xcdr2")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "--xcdr 2");
    let app = host.app(&arguments.subscriber)?;
    let publisher = stage.peer(&peers::cyclone()?, &arguments.publisher)?;
    flow::complete(publisher, [app], SAMPLES, 0)
}

fn app_to_both_vendors_at_once(layer: Layer) -> Result<()> {
    let stage = Stage::new("vendors")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let subscribers = [
        stage.peer(&peers::cyclone()?, &arguments.subscriber)?,
        stage.peer(&peers::fast_dds()?, &arguments.subscriber)?,
    ];
    let publisher = host.app(&arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}

fn between_hosts(near: Layer, far: Layer) -> Result<()> {
    let stage = Stage::new("hosts")?;
    let (near, far) = (stage.near(near)?, stage.far(far)?);
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let subscribers = [
        far.app(&arguments.subscriber)?,
        far.app(&arguments.subscriber)?,
    ];
    let publisher = near.app(&arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}
