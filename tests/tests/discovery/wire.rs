//! What the kernel sends, as Wireshark's RTPS dissector sees it.

use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use rtps_tests::capture::Capture;
use rtps_tests::debian::{self, Package};
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::Host;
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::{require, skip_unless};

use crate::crowd::Crowd;
use crate::support::{LONG_LEASE, while_stopped};

const ETHTOOL: Package = Package::new("ethtool", "/usr/sbin/ethtool");
/// submessageIds (RTPS 2.5, 9.4.5.1.1).
const SUBMESSAGES: [(u8, &str); 6] = [
    (0x06, "ACKNACK"),
    (0x07, "HEARTBEAT"),
    (0x08, "GAP"),
    (0x09, "INFO_TS"),
    (0x0e, "INFO_DST"),
    (0x15, "DATA"),
];
/// Entity ids of the built-in writers that announce the participant, its writers and its readers.
const WRITERS: [&str; 3] = ["0x000100c2", "0x000003c2", "0x000004c2"];

/// rtpsd stands still and the apps know nobody, so everything that the host sends is the kernel's.
#[test]
fn what_the_kernel_sends_decodes() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("kernel-decodes")?;
    for host in [&stage.ours, &stage.theirs] {
        compute_checksums(host)?;
    }
    let mut layer = stage.load(&stage.ours)?;
    let app = |arguments: &str| stage.app(&stage.ours, Layer::Kernel, arguments);
    let app_that_goes = app("--pub --topic Gone")?;
    let _apps = [
        app("--sub --topic Square --timeout 100")?,
        app("--pub --topic Circle --timeout 100")?,
    ];
    wait_for_endpoints(&layer, 3)?;
    // What it had announced is in the history no more: the kernel says so by GAP.
    drop(app_that_goes);
    wait_for_endpoints(&layer, 2)?;

    let ours = stage.ours.interface.v4;
    let capture = while_stopped(&mut layer, || {
        let capture = Capture::start(&stage.theirs.netns, &stage.theirs.interface.name)?;
        let times = (Duration::from_millis(100), LONG_LEASE);
        let mut stranger = Crowd::new(&stage.theirs, ours, 1, times)?;
        stranger.add_endpoints(5)?;
        stranger.run_until_content()?;
        let mut cyclone = stage.cyclone("--sub --topic Circle --timeout 100")?;
        cyclone.wait_json_event(|event| event["event"] == "matched", PATIENCE)?;
        Ok(capture)
    })?;
    let decoded = capture.finish()?;

    let malformed = decoded.malformed_from(ours);
    ensure!(malformed.is_empty(), "{malformed:?}");
    let wrong = decoded.bad_checksums_from(ours)?;
    ensure!(wrong == 0, "{wrong} datagrams have a wrong checksum");
    for (id, name) in SUBMESSAGES {
        ensure!(decoded.count(ours, id) > 0, "no {name} was sent");
    }
    for writer in WRITERS {
        let filter =
            format!("ip.src == {ours} && rtps.sm.id == 0x15 && rtps.sm.wrEntityId == {writer}");
        ensure!(decoded.frames(&filter)? > 0, "no DATA of {writer}");
    }
    Ok(())
}

/// Makes a host compute the checksums of what it sends, instead of leaving them to an interface that does not.
fn compute_checksums(host: &Host) -> Result<()> {
    debian::ensure_installed(&[ETHTOOL])?;
    let output = host
        .netns
        .command(ETHTOOL.probe)
        .args(["-K", &host.interface.name, "tx", "off"])
        .output()
        .context("running ethtool")?;
    if !output.status.success() {
        bail!(
            "ethtool: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    Ok(())
}

/// Until the apps of the host have so many endpoints.
fn wait_for_endpoints(layer: &KernelLayer<'_>, count: usize) -> Result<()> {
    eventually("the apps have their endpoints", || {
        let status = layer.status()?;
        let discovery = status
            .domains
            .first()
            .and_then(|domain| domain.discovery.as_ref());
        let apps = discovery.and_then(|discovery| discovery["apps"].as_array());
        let endpoints = apps.into_iter().flatten();
        let endpoints = endpoints.filter_map(|app| app["endpoints"].as_array());
        Ok((endpoints.map(Vec::len).sum::<usize>() == count).then_some(()))
    })
}
