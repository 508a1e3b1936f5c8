//! IPv6: alone, beside IPv4, with nothing but link-local addresses, and not at all.

use anyhow::Result;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;

use crate::flow::{self, Arguments};
use crate::layers::{on_both_layers, on_every_layer, on_pairs_of_layers};
use crate::stage::Stage;

const SAMPLES: u64 = 300;

on_every_layer! {
    cyclone_to_app,
    app_to_cyclone,
    fast_dds_to_app,
    app_to_fast_dds,
}

on_both_layers! {
    peers_of_both_families,
    a_host_without_ipv6,
    an_address_that_comes_late,
}

on_pairs_of_layers! {
    between_hosts,
    by_link_local_addresses,
}

fn cyclone_to_app(layer: Layer) -> Result<()> {
    peer_to_app(layer, &peers::cyclone()?)
}

fn fast_dds_to_app(layer: Layer) -> Result<()> {
    peer_to_app(layer, &peers::fast_dds()?)
}

fn peer_to_app(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = ipv6_only("from-v6")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let app = host.app(&arguments.subscriber)?;
    let publisher = spawn(&stage, peer, &arguments.publisher)?;
    flow::complete(publisher, [app], SAMPLES, 0)
}

fn app_to_cyclone(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::cyclone()?)
}

fn app_to_fast_dds(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::fast_dds()?)
}

fn app_to_peer(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = ipv6_only("to-v6")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let subscriber = spawn(&stage, peer, &arguments.subscriber)?;
    flow::complete(host.app(&arguments.publisher)?, [subscriber], SAMPLES, 0)
}

fn between_hosts(near: Layer, far: Layer) -> Result<()> {
    between(&ipv6_only("hosts-v6")?, near, far)
}

/// As on a link that nobody configured.
fn by_link_local_addresses(near: Layer, far: Layer) -> Result<()> {
    let stage = ipv6_only("link-local")?;
    for host in stage.hosts() {
        let name = &host.interface.name;
        let flush = format!("-6 address flush dev {name} scope global");
        host.netns.ip(&flush)?;
    }
    between(&stage, near, far)
}

fn between(stage: &Stage, near: Layer, far: Layer) -> Result<()> {
    let (near, far) = (stage.near(near)?, stage.far(far)?);
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let subscribers = [
        far.app(&arguments.subscriber)?,
        far.app(&arguments.subscriber)?,
    ];
    let publisher = near.app(&arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}

/// A writer of ours reaches each reader by the family that it has.
fn peers_of_both_families(layer: Layer) -> Result<()> {
    let stage = Stage::new("both")?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 2, "");
    let cyclone = peers::cyclone()?;
    let subscribers = [
        stage.peer(&cyclone, &arguments.subscriber)?,
        spawn(&stage, &cyclone, &arguments.subscriber)?,
    ];
    let publisher = host.app(&arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)
}

/// The other host has both families, and announces both.
fn a_host_without_ipv6(layer: Layer) -> Result<()> {
    let stage = Stage::new("no-v6")?;
    let [near, _far] = stage.hosts();
    near.netns.disable_ipv6()?;
    between(&stage, layer, layer)
}

/// Until then nothing of ours reaches the peer.
fn an_address_that_comes_late(layer: Layer) -> Result<()> {
    let stage = ipv6_only("late")?;
    let [near, _far] = stage.hosts();
    let name = &near.interface.name;
    let flush = format!("-6 address flush dev {name} scope global");
    near.netns.ip(&flush)?;
    let host = stage.near(layer)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let app = host.app(&arguments.subscriber)?;
    let publisher = spawn(&stage, &peers::cyclone()?, &arguments.publisher)?;
    let add = format!("address add {}/120 dev {name} nodad", near.interface.v6);
    near.netns.ip(&add)?;
    flow::complete(publisher, [app], SAMPLES, 0)
}

/// Two hosts without IPv4 addresses.
fn ipv6_only(label: &str) -> Result<Stage> {
    let stage = Stage::new(label)?;
    for host in stage.hosts() {
        let flush = format!("-4 address flush dev {}", host.interface.name);
        host.netns.ip(&flush)?;
    }
    Ok(stage)
}

/// Starts another vendor's program on the other host, which is to use IPv6 only.
fn spawn(stage: &Stage, peer: &Peer, arguments: &str) -> Result<Process> {
    let [_near, far] = stage.hosts();
    let mut command = peer.command_over_ipv6(&far.netns, &far.interface, arguments);
    let label = format!("{} over IPv6: {arguments}", peer.name());
    Process::spawn(&label, &mut command)
}
