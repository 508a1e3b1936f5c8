//! Interfaces and addresses come and go, and there may be several: the kernel answers wherever the host is.

use std::net::Ipv4Addr;

use anyhow::{Context, Result};
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::{self, Host, Veth};
use rtps_tests::netns::Netns;
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::stream::{End, Stream};
use rtps_tests::{require, skip_unless};

use crate::support::{ensure_answers_from_kernel, ensure_kernel_answers};

const ENDS: (End, End) = (End::Cyclone, End::Ours(Layer::Kernel));

#[test]
fn an_interface_goes_down_and_comes_back() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("down-up")?;
    let mut layer = stage.load(&stage.ours)?;
    let name = &stage.ours.interface.name;
    for state in ["down", "up"] {
        stage.ours.netns.ip(&format!("link set {name} {state}"))?;
    }
    goes_on(&stage, &mut layer, stage.ours.interface.v4)
}

#[test]
fn an_interface_is_deleted_and_made_again() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("made-again")?;
    let mut layer = stage.load(&stage.ours)?;
    let before = index(&layer)?;
    stage
        .ours
        .netns
        .ip(&format!("link delete {}", stage.ours.interface.name))?;
    link::join_again(&stage.ours, &stage.theirs, 1500)?;
    eventually("the layer is on the new interface", || {
        let now = index(&layer)?;
        Ok((now.is_some() && now != before).then_some(()))
    })?;
    goes_on(&stage, &mut layer, stage.ours.interface.v4)
}

/// Of the one interface that the layer is on, if it is.
fn index(layer: &KernelLayer<'_>) -> Result<Option<u32>> {
    let status = layer.status()?;
    Ok(status.interfaces.first().map(|interface| interface.index))
}

#[test]
fn an_address_changes() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("changes")?;
    let mut layer = stage.load(&stage.ours)?;
    let Host { netns, interface } = &stage.ours;
    let new = Ipv4Addr::new(10, 1, 0, 77);
    for what in [format!("delete {}", interface.v4), format!("add {new}")] {
        netns.ip(&format!("address {what}/24 dev {}", interface.name))?;
    }
    goes_on(&stage, &mut layer, new)
}

/// What the kernel sends in somebody's stead nobody would fragment, and the other end of a veth drops what is too large.
#[test]
fn answers_fit_an_mtu_that_has_become_smaller() -> Result<()> {
    skip_unless!(require::root());
    const WRITERS: u64 = 8;
    let stage = Stage::new("mtu")?;
    let mut layer = stage.load(&stage.ours)?;
    let publisher = "--pub --topic Small --reliable --count 1 --wait-match 1 --timeout 100";
    let writers = (0..WRITERS).map(|_| stage.app(&stage.ours, Layer::Kernel, publisher));
    let _writers = writers.collect::<Result<Vec<_>>>()?;
    eventually("all writers are there", || {
        let status = layer.status()?;
        let endpoints = status.apps.len() as u64;
        Ok((endpoints == WRITERS).then_some(()))
    })?;
    for host in [&stage.ours, &stage.theirs] {
        let name = &host.interface.name;
        host.netns.ip(&format!("link set {name} mtu 1280"))?;
    }
    // Once more, for the first may be asked before the change is noticed.
    layer.status()?;
    ensure_answers_from_kernel(&layer, 1)?;
    ensure_kernel_answers(&mut layer, &stage.theirs, stage.ours.interface.v4)
}

/// The kernel answers newcomers alone, and who has come that way can be talked to.
fn goes_on(stage: &Stage, layer: &mut KernelLayer<'_>, address: Ipv4Addr) -> Result<()> {
    eventually("the kernel answers", || {
        Ok(ensure_answers_from_kernel(layer, 1).ok())
    })?;
    ensure_kernel_answers(layer, &stage.theirs, address)?;
    Stream::start(stage, "After", ENDS, 100)?.finish().map(drop)
}

#[test]
fn remotes_on_two_links() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("two-links")?;
    let netns = Netns::new("two-links-3")?;
    let [near, far] = [1, 2].map(|host| Ipv4Addr::new(10, 2, 0, host));
    let veth = Veth::between(&stage.ours.netns, &netns, near, far, 1500)?;
    let others = Host {
        netns,
        interface: veth.b,
    };
    let mut layer = stage.load_with(&stage.ours, &format!("--iface {}", veth.a.name))?;
    ensure_answers_from_kernel(&layer, 2)?;
    ensure_kernel_answers(&mut layer, &stage.theirs, stage.ours.interface.v4)?;
    ensure_kernel_answers(&mut layer, &others, near)?;

    let common = "--reliable --durability transient-local --count 100 --timeout 100";
    let subscriber = format!("--sub {common} --linger 0.5");
    let subscribers = [
        stage.cyclone(&subscriber)?,
        // It sends to the first address that we announce, which therefore has to be the one on its link.
        stage.cyclone_on(&others, &subscriber)?,
    ];
    let publisher = format!("--pub {common} --wait-match 2");
    let mut publisher = stage.app(&stage.ours, Layer::Kernel, &publisher)?;
    for mut subscriber in subscribers {
        let ended = subscriber.wait_success(PATIENCE);
        ended.with_context(|| format!("the publisher's output:\n{}", publisher.text()))?;
    }
    publisher.wait_success(PATIENCE)
}
