//! Longer than every lease: nobody is forgotten, nothing goes stale.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers;
use rtps_tests::process::Process;

use crate::flow::{self, EVERYTHING};
use crate::layers::on_every_layer;
use crate::stage::Stage;

/// Longer than the leases: ours 5 s (kernel layer) or 20 s, Cyclone's 10 s, Fast DDS's 20 s.
const SOAK: Duration = Duration::from_secs(25);
const PERIOD: Duration = Duration::from_millis(10);

on_every_layer! { everybody_outlives_the_leases }

/// Cyclone and Fast DDS each write to an app and read from one, all with little traffic.
fn everybody_outlives_the_leases(layer: Layer) -> Result<()> {
    let stage = Stage::new("soak")?;
    let host = stage.near_with(layer, &["--lease", "5"])?;
    let samples = (SOAK.as_millis() / PERIOD.as_millis()) as u64;
    let ends = format!("{EVERYTHING} --timeout 55 --count {samples}");
    let publisher = format!(
        "--pub {ends} --period-us {} --linger 0.5",
        PERIOD.as_micros()
    );
    let subscriber = format!("--sub {ends} --linger 0.5");
    let (cyclone, fast_dds) = (peers::cyclone()?, peers::fast_dds()?);
    let started = Instant::now();
    let mut subscribers = vec![
        host.app(&format!("{subscriber} --topic Square"))?,
        host.app(&format!("{subscriber} --topic Triangle"))?,
        stage.peer(&cyclone, &format!("{subscriber} --topic Circle"))?,
        stage.peer(&fast_dds, &format!("{subscriber} --topic Circle"))?,
    ];
    let mut publishers = vec![
        stage.peer(&cyclone, &format!("{publisher} --topic Square"))?,
        stage.peer(&fast_dds, &format!("{publisher} --topic Triangle"))?,
        host.app(&format!("{publisher} --topic Circle --wait-match 2"))?,
    ];
    for subscriber in &mut subscribers {
        let ended = subscriber.wait_success(flow::END);
        ended.with_context(|| others(&publishers))?;
        flow::ensure_all(subscriber, samples, 0)?;
    }
    for publisher in &mut publishers {
        publisher.wait_success(flow::END)?;
    }
    ensure!(started.elapsed() >= SOAK, "the soak was too short");
    subscribers.iter().try_for_each(ensure_constant)
}

fn others(publishers: &[Process]) -> String {
    let outputs = publishers.iter().map(Process::text);
    format!(
        "the publishers' outputs:\n{}",
        outputs.collect::<Vec<_>>().join("\n")
    )
}

/// A reader saw its one writer come, and perhaps go at the end, but nobody in between.
fn ensure_constant(subscriber: &Process) -> Result<()> {
    let events = subscriber.events();
    let last_sample = events.iter().rposition(|event| event["event"] == "sample");
    let before = &events[..last_sample.unwrap_or(0)];
    let matches: Vec<_> = before
        .iter()
        .filter(|event| event["event"] == "matched")
        .map(|event| event["current"].as_u64())
        .collect();
    ensure!(matches == [Some(1)], "{}", subscriber.text());
    Ok(())
}
