//! `shape_main` with other vendors' programs: samples, keys that end, and incompatible policies.

use anyhow::{Result, ensure};
use rtps_tests::peers::{self, Peer};
use rtps_tests::stage::PATIENCE;

use crate::lines::{self, wait_line};
use crate::stage::{Ends, on_the_in_process_layer};

on_the_in_process_layer! {
    cyclone,
    fast_dds,
}

/// A sample of the peers counts in x what `shape_main` counts in the size.
const COUNT: usize = 50;

fn cyclone(ends: &Ends<'_>) -> Result<()> {
    publishes(ends, &peers::cyclone()?)?;
    subscribes(ends, &peers::cyclone()?)?;
    does_not_match(ends, &peers::cyclone()?)
}

fn fast_dds(ends: &Ends<'_>) -> Result<()> {
    publishes(ends, &peers::fast_dds()?)?;
    subscribes(ends, &peers::fast_dds()?)?;
    does_not_match(ends, &peers::fast_dds()?)
}

fn publishes(ends: &Ends<'_>, peer: &Peer) -> Result<()> {
    for version in [1, 2] {
        let mut subscriber = ends.subscriber(&format!("-D l -k 0 -x {version}"))?;
        let arguments = format!(
            "--pub --durability transient-local --history-keep-all --xcdr {version} --count {COUNT} --dispose \
             --color GREEN --size 5 --linger 50"
        );
        let _publisher = ends.near_peer(peer, &arguments)?;
        let samples = lines::wait_samples(&subscriber, COUNT)?;
        ensure!(
            samples.iter().map(|sample| sample.x as usize).eq(0..COUNT),
            "{samples:?}"
        );
        ensure!(
            samples.iter().all(|sample| sample.color == "GREEN"),
            "{samples:?}"
        );
        ensure!(
            samples.iter().all(|sample| sample.payload.is_some()),
            "{samples:?}"
        );
        wait_line(
            &mut subscriber,
            "Square     GREEN      NOT_ALIVE_DISPOSED_INSTANCE_STATE",
        )?;
    }
    Ok(())
}

fn subscribes(ends: &Ends<'_>, peer: &Peer) -> Result<()> {
    for version in [1, 2] {
        let both = format!("--durability transient-local --history-keep-all --xcdr {version}");
        let mut subscriber =
            ends.far_peer(peer, &format!("--sub {both} --count {COUNT} --linger 50"))?;
        let arguments = "--additional-payload-size 7 --final-instance-state d --write-period 1";
        let _publisher = ends.publisher(&format!(
            "-D l -k 0 -z 0 -c GREEN -x {version} --num-iterations {COUNT} {arguments}"
        ))?;
        subscriber.wait_json_event(|event| event["event"] == "disposed", PATIENCE)?;
        let events = subscriber.events();
        let samples = events.iter().filter(|event| event["event"] == "sample");
        let right = samples.filter(|event| event["color"] == "GREEN" && event["size"] == 7);
        ensure!(right.count() == COUNT, "{events:?}");
    }
    Ok(())
}

fn does_not_match(ends: &Ends<'_>, peer: &Peer) -> Result<()> {
    let mut subscriber = ends.subscriber("-D l")?;
    let _publisher = ends.near_peer(peer, "--pub --wait-match 0")?;
    let line = wait_line(&mut subscriber, "on_requested_incompatible_qos()")?;
    ensure!(line.ends_with(": 2 (DURABILITY)"), "{line}");
    Ok(())
}
