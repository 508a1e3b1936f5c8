//! One writer and readers on several hosts: on the kernel layer a datagram leaves the app once.

use anyhow::{Result, ensure};
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::{Bridge, Host};
use rtps_tests::loss::{Direction, Loss, Lossy};
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtps_tests::stage::{binaries, counter, spawn_app, spawn_peer};
use rtps_tests::{require, skip_unless};

use crate::flow::{self, Arguments};

const SAMPLES: u64 = 400;
/// Of a list, before rtpsd is asked for it, and until it has answered; and a few more.
const BEFORE: u64 = 100;

/// The hosts that a scenario has: one that writes, others that read.
struct Stage {
    bridge: Bridge,
}

impl Stage {
    fn new(label: &str, hosts: u8) -> Result<Self> {
        binaries()?;
        let bridge = Bridge::new(label, hosts, 1500)?;
        Ok(Self { bridge })
    }

    fn load(&self, host: usize) -> Result<KernelLayer<'_>> {
        let host = self.host(host);
        let rtpsd = binaries()?.rtpsd();
        KernelLayer::start(&rtpsd, &host.netns, &host.interface.name, &[])
    }

    fn app(&self, host: usize, arguments: &str) -> Result<Process> {
        spawn_app(&self.host(host).netns, Layer::Kernel, "shapes", arguments)
    }

    fn peer(&self, host: usize, peer: &Peer, arguments: &str) -> Result<Process> {
        let host = self.host(host);
        spawn_peer(&host.netns, &host.interface, peer, arguments)
    }

    fn host(&self, host: usize) -> &Host {
        &self.bridge.hosts[host]
    }
}

/// What the writer's host counted.
fn counted(layer: &KernelLayer<'_>, name: &str) -> Result<u64> {
    Ok(counter(&layer.status()?, name))
}

/// Fails unless most samples left the app once and the host `copies` times.
fn ensure_fanned_out(layer: &KernelLayer<'_>, copies: u64) -> Result<()> {
    let bursts = counted(layer, "fan_outs")?;
    let copied = counted(layer, "fan_out_copies")?;
    ensure!(bursts >= SAMPLES - BEFORE, "{bursts} bursts");
    ensure!(copied == bursts * copies, "{copied} copies of {bursts}");
    ensure!(counted(layer, "drop_fan_out_denied")? == 0, "denied");
    ensure!(layer.status()?.fan_out == "kernel");
    Ok(())
}

#[test]
fn a_datagram_for_several_hosts_leaves_the_app_once() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("fan-out", 5)?;
    let [ours, _second, _third] = [stage.load(0)?, stage.load(1)?, stage.load(2)?];
    let cyclone = peers::cyclone()?;
    let arguments = Arguments::reliable(SAMPLES, 4, "");
    let subscribers = [
        stage.app(1, &arguments.subscriber)?,
        stage.app(2, &arguments.subscriber)?,
        stage.peer(3, &cyclone, &arguments.subscriber)?,
        stage.peer(4, &cyclone, &arguments.subscriber)?,
    ];
    let publisher = stage.app(0, &arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)?;
    ensure_fanned_out(&ours, 4)
}

/// Other apps and stacks of the writer's own host are not on the list.
#[test]
fn readers_on_the_same_host_get_theirs() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("near-far", 3)?;
    let [ours, _second, _third] = [stage.load(0)?, stage.load(1)?, stage.load(2)?];
    let cyclone = peers::cyclone()?;
    let arguments = Arguments::reliable(SAMPLES, 4, "");
    let subscribers = [
        stage.app(0, &arguments.subscriber)?,
        stage.peer(0, &cyclone, &arguments.subscriber)?,
        stage.app(1, &arguments.subscriber)?,
        stage.app(2, &arguments.subscriber)?,
    ];
    let publisher = stage.app(0, &arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, 0)?;
    ensure_fanned_out(&ours, 2)
}

/// Fragments leave in bursts, which the kernel copies as they are; what is lost is repaired.
#[test]
fn large_samples_survive_loss() -> Result<()> {
    skip_unless!(require::root());
    const LARGE: u64 = 20_000;
    let stage = Stage::new("large", 3)?;
    let [ours, _second, _third] = [stage.load(0)?, stage.load(1)?, stage.load(2)?];
    let host = stage.host(0);
    let loss = Loss::Random(0.02);
    let _lossy = Lossy::attach(&host.netns, &host.interface, Direction::Egress, loss)?;
    let arguments = Arguments::reliable(SAMPLES, 2, &format!("--size {LARGE}"));
    let subscribers = [
        stage.app(1, &arguments.subscriber)?,
        stage.app(2, &arguments.subscriber)?,
    ];
    let publisher = stage.app(0, &arguments.publisher)?;
    flow::complete(publisher, subscribers, SAMPLES, LARGE)?;
    ensure!(counted(&ours, "fan_outs")? > 0, "nothing was fanned out");
    Ok(())
}

/// The program and its lists are pinned: they go on without rtpsd, and with the next one.
#[test]
fn rtpsd_killed_and_started_again_goes_unnoticed() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("killed", 3)?;
    let [ours, _second, _third] = [stage.load(0)?, stage.load(1)?, stage.load(2)?];
    let samples = 4 * SAMPLES;
    let arguments = Arguments::reliable(samples, 2, "");
    let mut subscribers = [
        stage.app(1, &arguments.subscriber)?,
        stage.app(2, &arguments.subscriber)?,
    ];
    let publisher = stage.app(0, &arguments.publisher)?;
    flow::wait_sample(&mut subscribers[0], SAMPLES)?;
    let before = counted(&ours, "fan_outs")?;
    ours.kill()?;
    flow::wait_sample(&mut subscribers[0], 2 * SAMPLES)?;
    let again = stage.load(0)?;
    flow::complete(publisher, subscribers, samples, 0)?;
    let after = counted(&again, "fan_outs")?;
    ensure!(before > 0, "nothing was fanned out before");
    ensure!(after - before > 2 * SAMPLES, "{before}, then {after}");
    Ok(())
}
