//! Samples larger than a datagram: others' IP fragments are received, ours are DATA_FRAGs that fit the MTU.

use anyhow::{Result, ensure};
use rtps_tests::capture::Capture;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;

use crate::flow::{self, Arguments};
use crate::layers::{on_both_layers, on_pairs_of_layers};
use crate::stage::{Host, Stage};

/// Octets of a sample, and how many of them are sent.
const FROM_PEERS: [(u64, u64); 2] = [(20_000, 30), (100_000, 10)];
const FROM_US: [(u64, u64); 3] = [(20_000, 30), (100_000, 10), (1_000_000, 3)];
/// What tshark calls an IPv4 fragment.
const IP_FRAGMENT: &str = "ip.flags.mf == 1 || ip.frag_offset > 0";

on_both_layers! {
    from_cyclone,
    from_fast_dds,
    to_cyclone,
    to_fast_dds,
}

on_pairs_of_layers! { between_hosts }

fn from_cyclone(layer: Layer) -> Result<()> {
    from_peer(layer, &peers::cyclone()?)
}

fn from_fast_dds(layer: Layer) -> Result<()> {
    from_peer(layer, &peers::fast_dds()?)
}

/// Two apps: what is delivered after reassembly goes to each.
fn from_peer(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("large-from")?;
    let host = stage.near(layer)?;
    for (size, samples) in FROM_PEERS {
        let arguments = Arguments::reliable(samples, 2, &format!("--size {size}"));
        let apps = [
            host.app(&arguments.subscriber)?,
            host.app(&arguments.subscriber)?,
        ];
        let publisher = stage.peer(peer, &arguments.publisher)?;
        flow::complete(publisher, apps, samples, size)?;
    }
    Ok(())
}

fn to_cyclone(layer: Layer) -> Result<()> {
    to_peer(layer, &peers::cyclone()?)
}

fn to_fast_dds(layer: Layer) -> Result<()> {
    to_peer(layer, &peers::fast_dds()?)
}

fn to_peer(layer: Layer, peer: &Peer) -> Result<()> {
    let stage = Stage::new("large-to")?;
    let host = stage.near(layer)?;
    send_unfragmented(&host, |arguments| stage.peer(peer, arguments))
}

fn between_hosts(near: Layer, far: Layer) -> Result<()> {
    let stage = Stage::new("large-hosts")?;
    let (near, far) = (stage.near(near)?, stage.far(far)?);
    send_unfragmented(&near, |arguments| far.app(arguments))
}

/// Sends samples of each size from `host`, and looks at its interface whether IP had to fragment any of it.
fn send_unfragmented(host: &Host<'_>, subscriber: impl Fn(&str) -> Result<Process>) -> Result<()> {
    let capture = Capture::start(host.netns(), &host.interface().name)?;
    for (size, samples) in FROM_US {
        let arguments = Arguments::reliable(samples, 1, &format!("--size {size}"));
        let subscriber = subscriber(&arguments.subscriber)?;
        let publisher = host.app(&arguments.publisher)?;
        flow::complete(publisher, [subscriber], samples, size)?;
    }
    let decoded = capture.finish()?;
    let ours = format!("ip.src == {}", host.interface().v4);
    let fragmented = decoded.frames(&format!("{ours} && ({IP_FRAGMENT})"))?;
    ensure!(
        fragmented == 0,
        "{fragmented} of our packets are IP fragments"
    );
    let malformed = decoded.malformed_from(host.interface().v4);
    ensure!(malformed.is_empty(), "{malformed:?}");
    Ok(())
}
