//! Reliability over links that lose packets in both directions.

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::loss::{Loss, Lossy};
use rtps_tests::peers::{self, Peer};
use rtps_tests::require;
use rtps_tests::skip_unless;

use crate::flow::{self, Arguments};
use crate::layers::{on_both_layers, on_every_layer};
use crate::stage::Stage;

const LITTLE: Loss = Loss::Random(0.1);
const MUCH: Loss = Loss::Random(0.3);
const SAMPLES: u64 = 200;
const FRAGMENTED: u64 = 20;
const FRAGMENTED_SIZE: u64 = 20_000;

on_every_layer! {
    cyclone_to_app,
    app_to_cyclone,
    fast_dds_to_app,
    app_to_fast_dds,
    host_to_host,
}

on_both_layers! {
    fragments_from_cyclone,
    fragments_to_cyclone,
    fragments_host_to_host,
}

fn cyclone_to_app(layer: Layer) -> Result<()> {
    for loss in [LITTLE, MUCH] {
        peer_to_app(layer, &peers::cyclone()?, loss, SAMPLES, 0)?;
    }
    Ok(())
}

fn app_to_cyclone(layer: Layer) -> Result<()> {
    for loss in [LITTLE, MUCH] {
        app_to_peer(layer, &peers::cyclone()?, loss, SAMPLES, 0)?;
    }
    Ok(())
}

fn fast_dds_to_app(layer: Layer) -> Result<()> {
    peer_to_app(layer, &peers::fast_dds()?, LITTLE, SAMPLES, 0)
}

fn app_to_fast_dds(layer: Layer) -> Result<()> {
    app_to_peer(layer, &peers::fast_dds()?, LITTLE, SAMPLES, 0)
}

/// A lost packet of IP takes a whole datagram of Cyclone with it, up to ten packets.
fn fragments_from_cyclone(layer: Layer) -> Result<()> {
    let (loss, size) = (Loss::Random(0.05), FRAGMENTED_SIZE);
    peer_to_app(layer, &peers::cyclone()?, loss, FRAGMENTED, size)
}

fn fragments_to_cyclone(layer: Layer) -> Result<()> {
    let size = FRAGMENTED_SIZE;
    app_to_peer(layer, &peers::cyclone()?, LITTLE, FRAGMENTED, size)
}

fn peer_to_app(layer: Layer, peer: &Peer, loss: Loss, samples: u64, size: u64) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let stage = Stage::new("loss-from")?;
    let lossy = stage.lose(loss)?;
    let host = stage.near(layer)?;
    let arguments = arguments(samples, size);
    let app = host.app(&arguments.subscriber)?;
    let publisher = stage.peer(peer, &arguments.publisher)?;
    flow::complete(publisher, [app], samples, size)?;
    ensure_lost(&lossy)
}

fn app_to_peer(layer: Layer, peer: &Peer, loss: Loss, samples: u64, size: u64) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let stage = Stage::new("loss-to")?;
    let lossy = stage.lose(loss)?;
    let host = stage.near(layer)?;
    let arguments = arguments(samples, size);
    let subscriber = stage.peer(peer, &arguments.subscriber)?;
    let publisher = host.app(&arguments.publisher)?;
    flow::complete(publisher, [subscriber], samples, size)?;
    ensure_lost(&lossy)
}

fn host_to_host(layer: Layer) -> Result<()> {
    for loss in [LITTLE, MUCH] {
        between_hosts(layer, loss, SAMPLES, 0)?;
    }
    Ok(())
}

fn fragments_host_to_host(layer: Layer) -> Result<()> {
    for loss in [LITTLE, MUCH] {
        between_hosts(layer, loss, FRAGMENTED, FRAGMENTED_SIZE)?;
    }
    Ok(())
}

fn between_hosts(layer: Layer, loss: Loss, samples: u64, size: u64) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let stage = Stage::new("loss-hosts")?;
    let lossy = stage.lose(loss)?;
    let (near, far) = (stage.near(layer)?, stage.far(layer)?);
    let arguments = arguments(samples, size);
    let subscriber = far.app(&arguments.subscriber)?;
    let publisher = near.app(&arguments.publisher)?;
    flow::complete(publisher, [subscriber], samples, size)?;
    ensure_lost(&lossy)
}

/// The reader stays until its last acknowledgement has got through: whoever waits for it would wait for ever.
pub(crate) fn arguments(samples: u64, size: u64) -> Arguments {
    let mut arguments = Arguments::reliable(samples, 1, &format!("--size {size}"));
    arguments.subscriber += " --linger 2";
    arguments
}

/// Without this the tests would prove nothing. Few packets go towards the writer: perhaps none of them is lost.
pub(crate) fn ensure_lost([near, far]: &[Lossy; 2]) -> Result<()> {
    let (near, far) = (near.count()?, far.count()?);
    ensure!(near.dropped + far.dropped > 0, "{near:?}, {far:?}");
    Ok(())
}
