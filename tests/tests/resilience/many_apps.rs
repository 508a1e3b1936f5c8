//! Fifty apps on one host are one participant on the wire.

use std::net::{IpAddr, Ipv4Addr};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rtps_tests::capture::Capture;
use rtps_tests::layer::Layer;
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::{require, skip_unless};

const APPS: usize = 50;
const SAMPLES: u64 = 100;
/// The group and port of SPDP in domain 0 (RTPS 2.5, 9.6.2.4.1).
const GROUP: IpAddr = IpAddr::V4(Ipv4Addr::new(239, 255, 0, 1));
const SPDP_PORT: u16 = 7400;
/// The time between two announcements of a layer that has been there for a while.
const PERIOD: Duration = Duration::from_secs(5);
/// At first announcements come more often: after 0.1 s, 0.2 s, 0.4 s...
const EARLY: usize = 7;

#[test]
fn announcements_do_not_multiply_and_each_app_gets_its_samples() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("many")?;
    let capture = Capture::start(&stage.ours.netns, &stage.ours.interface.name)?;
    let begin = Instant::now();
    let layer = stage.load(&stage.ours)?;
    let arguments = format!("--sub --count {SAMPLES} --timeout 120 --linger 1");
    let mut apps = (0..APPS)
        .map(|_| stage.app(&stage.ours, Layer::Kernel, &arguments))
        .collect::<Result<Vec<_>>>()?;
    eventually("all apps are attached", || {
        Ok((layer.status()?.apps.len() == APPS).then_some(()))
    })?;
    let mut publisher = stage.cyclone(&format!(
        "--pub --reliable --count {SAMPLES} --period-us 5000 --wait-match {APPS} --settle 2 --timeout 120"
    ))?;
    for (number, app) in apps.iter_mut().enumerate() {
        app.wait_success(2 * PATIENCE)
            .with_context(|| format!("app {number}"))?;
    }
    publisher.wait_success(PATIENCE)?;
    let periods = begin.elapsed().as_secs() / PERIOD.as_secs();
    let decoded = capture.finish()?;
    let announcements = decoded
        .from(stage.ours.interface.v4)
        .filter(|packet| packet.destination == GROUP && packet.destination_port == SPDP_PORT)
        .count();
    let expected = EARLY + periods as usize;
    ensure!(
        (1..=expected).contains(&announcements),
        "{announcements} announcements, at most {expected} expected"
    );
    Ok(())
}
