//! Longer than every lease, with everybody at once: nobody is forgotten, nothing goes stale.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::link::Bridge;
use rtps_tests::peers::Peer;
use rtps_tests::process::Process;
use rtps_tests::stage::{binaries, spawn_peer};
use rtps_tests::{require, skip_unless};
use serde_json::Value;

use super::Direction;
use super::scenario::Scenario;
use super::table::{self, Outcome};
use super::vendor::Vendor;
use crate::flow::{self, EVERYTHING};
use crate::stage::Host;

/// Longer than the leases: ours 5 s (kernel layer) or 20 s, Cyclone's 10 s, Fast DDS's 20 s, dust_dds' 100 s; that of
/// RustDDS is infinite, but it forgets others after 60 s that announce none.
const SOAK: Duration = Duration::from_secs(180);
const PERIOD: Duration = Duration::from_millis(100);
const SAMPLES: u64 = (SOAK.as_millis() / PERIOD.as_millis()) as u64;
const LAYERS: [Layer; 3] = [Layer::Kernel, Layer::UserDiscovery, Layer::InProcess];

/// Samples on their way from one writer to one reader.
struct Flow {
    layer: Layer,
    vendor: Vendor,
    direction: Direction,
    subscriber: Process,
}

/// A host for each layer and one for the vendors. Each vendor writes to an app on each layer, and reads from one.
#[test]
fn everybody_outlives_the_leases() -> Result<()> {
    skip_unless!(require::root());
    binaries()?;
    let bridge = Bridge::new("soak", 4, 1500)?;
    for host in &bridge.hosts {
        // One of the vendors lacks it.
        host.netns.disable_ipv6()?;
    }
    let (theirs, ours) = bridge.hosts.split_last().context("four hosts")?;
    let hosts: Vec<Host<'_>> = (ours.iter().zip(LAYERS))
        .map(|(host, layer)| Host::new(host, layer, &["--lease", "5"]))
        .collect::<Result<_>>()?;
    let peers: Vec<(Vendor, Peer)> = (Vendor::ALL.into_iter())
        .map(|vendor| Ok((vendor, vendor.peer()?)))
        .collect::<Result<_>>()?;
    let spawn = |peer: &Peer, arguments: &str| {
        spawn_peer(&theirs.netns, &theirs.interface, peer, arguments)
    };
    let started = Instant::now();
    let mut flows = Vec::new();
    for (host, layer) in hosts.iter().zip(LAYERS) {
        for (vendor, peer) in &peers {
            let mut add = |direction, subscriber| {
                let vendor = *vendor;
                flows.push(Flow {
                    layer,
                    vendor,
                    direction,
                    subscriber,
                });
            };
            add(Direction::FromPeer, host.app(&subscriber(peer.name()))?);
            add(Direction::ToPeer, spawn(peer, &subscriber(topic(layer)))?);
        }
    }
    let from_us = hosts.iter().zip(LAYERS).map(|(host, layer)| {
        let arguments = publisher(topic(layer), Vendor::ALL.len());
        host.app(&arguments)
    });
    let from_peers = peers.iter().map(|(_, peer)| {
        let arguments = publisher(peer.name(), LAYERS.len());
        spawn(peer, &arguments)
    });
    let publishers: Vec<Process> = from_us.chain(from_peers).collect::<Result<_>>()?;
    let outcomes: Vec<Result<()>> = flows.iter_mut().map(Flow::finish).collect();
    ensure!(started.elapsed() >= SOAK, "the soak was too short");
    drop(publishers);
    let failures = outcomes.into_iter().filter_map(Result::err);
    let failures: Vec<String> = failures.map(|error| format!("{error:#}")).collect();
    ensure!(failures.is_empty(), "{}", failures.join("\n"));
    Ok(())
}

/// The topic of the app that writes on a layer.
fn topic(layer: Layer) -> &'static str {
    match layer {
        Layer::Kernel => "Kernel",
        Layer::UserDiscovery => "UserDiscovery",
        Layer::InProcess => "InProcess",
    }
}

fn publisher(topic: &str, readers: usize) -> String {
    let period = PERIOD.as_micros();
    let count = format!("--count {SAMPLES} --linger 300");
    format!(
        "--pub {EVERYTHING} --timeout 300 {count} --topic {topic} --period-us {period} --wait-match {readers}"
    )
}

/// It stays until all have everything: whoever goes is news to the others.
fn subscriber(topic: &str) -> String {
    format!("--sub {EVERYTHING} --timeout 300 --topic {topic}")
}

impl Flow {
    /// Waits for the last sample, looks at all of them, and records how it went.
    fn finish(&mut self) -> Result<()> {
        let checked = self.check();
        let outcome = Outcome::of(&checked);
        table::record(
            self.layer,
            self.vendor,
            self.direction,
            Scenario::Soak,
            outcome,
        )?;
        checked.with_context(|| {
            let (layer, vendor) = (self.layer, self.vendor.name());
            format!("{vendor}, {:?}, {layer:?}", self.direction)
        })
    }

    fn check(&mut self) -> Result<()> {
        let is_last = |event: &Value| event["event"] == "sample" && event["x"] == SAMPLES - 1;
        let patience = SOAK + flow::END;
        self.subscriber.wait_json_event(is_last, patience)?;
        flow::ensure_all(&self.subscriber, SAMPLES, 0)?;
        self.ensure_constant()
    }

    /// A reader saw its one writer come, and nobody else come or go.
    fn ensure_constant(&self) -> Result<()> {
        let events = self.subscriber.events();
        let matches: Vec<_> = events
            .iter()
            .filter(|event| event["event"] == "matched")
            .map(|event| event["current"].as_u64())
            .collect();
        ensure!(matches == [Some(1)], "{}", self.subscriber.last_text());
        Ok(())
    }
}
