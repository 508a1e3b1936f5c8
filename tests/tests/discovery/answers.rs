//! Where the kernel answers by default: on a plain veth, whose other end has no program at all, and behind a bridge.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::Bridge;
use rtps_tests::stage::{Stage, binaries, counter};
use rtps_tests::{require, skip_unless};

use crate::support::{LONG_LEASE, ensure_answers_from_kernel, ensure_kernel_answers, known_crowd};

#[test]
fn into_a_namespace_without_programs() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("container")?;
    let mut layer = stage.load(&stage.ours)?;
    ensure_answers_from_kernel(&layer, 1)?;
    ensure_kernel_answers(&mut layer, &stage.theirs, stage.ours.interface.v4)?;
    ensure!(counter(&layer.status()?, "answer_bytes") > 0);
    Ok(())
}

#[test]
fn across_a_bridge() -> Result<()> {
    skip_unless!(require::root());
    let bridge = Bridge::new("bridged", 2, 1500)?;
    let [ours, theirs] = bridge.hosts.as_slice() else {
        anyhow::bail!("a bridge of two hosts");
    };
    let rtpsd = binaries()?.rtpsd();
    let mut layer = KernelLayer::start(&rtpsd, &ours.netns, &ours.interface.name, &[])?;
    ensure_answers_from_kernel(&layer, 1)?;
    ensure_kernel_answers(&mut layer, theirs, ours.interface.v4)
}

/// The other way round: the switch is respected, and what it turns off is what the tests above look at.
#[test]
fn nowhere_with_discovery_left_to_rtpsd() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("user")?;
    let layer = stage.load_with(&stage.ours, "--discovery user")?;
    let status = layer.status()?;
    ensure!(
        status.discovery.as_deref() == Some("user"),
        "{:?}",
        status.discovery
    );
    let interface = status.interfaces.first().context("no interface")?;
    ensure!(interface.answers.starts_with("rtpsd"), "{interface:?}");
    known_crowd(&stage, 1, (Duration::from_millis(100), LONG_LEASE))?;
    ensure!(counter(&layer.status()?, "answer_bytes") == 0);
    Ok(())
}
