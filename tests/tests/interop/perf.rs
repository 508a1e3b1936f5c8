//! `rtps perf` and Cyclone DDS's ddsperf, either of them at either end.

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use serde_json::Value;

use crate::flow::END;
use crate::layers::{on_both_layers, on_pairs_of_layers};
use crate::stage::Stage;

on_both_layers! {
    pings_that_ddsperf_answers,
    pings_of_ddsperf,
    data_to_ddsperf,
    data_of_ddsperf,
    every_topic_to_ddsperf,
    bursts_wake_who_sleeps,
}

on_pairs_of_layers! { pings_between_hosts, data_between_hosts }

fn pings_that_ddsperf_answers(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-ping")?;
    let host = stage.near(layer)?;
    let _pong = stage.ddsperf("pong")?;
    let mut ping = host.perf("ping --size 100 --duration 0.3")?;
    ping.wait_success(END)?;
    ensure_round_trips(&ping)
}

fn pings_of_ddsperf(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-pong")?;
    let host = stage.near(layer)?;
    let pong = host.perf("pong")?;
    let mut ping = stage.ddsperf("ping size 100")?;
    // It pings once a second for as long as it gets no answer.
    ping.wait_line("size 100 mean", END)?;
    let summary = end(pong)?;
    ensure!(number(&summary, "count") > 10, "{summary}");
    Ok(())
}

fn data_to_ddsperf(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-pub")?;
    let host = stage.near(layer)?;
    // In fragments.
    publish_to_ddsperf(&stage, "", || {
        host.perf("pub --rate 500 --size 20k --duration 1.5")
    })
}

fn every_topic_to_ddsperf(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-topics")?;
    let host = stage.near(layer)?;
    for options in ["-T K32", "-T K256 -u", "-T OU"] {
        let publisher = format!("pub {options} --rate 100 --duration 1.2");
        publish_to_ddsperf(&stage, options, || host.perf(&publisher))?;
    }
    Ok(())
}

/// ddsperf ends with an error if it has missed a reliable sample or got few in all.
fn publish_to_ddsperf(
    stage: &Stage,
    options: &str,
    publisher: impl FnOnce() -> Result<Process>,
) -> Result<()> {
    let mut subscriber = stage.ddsperf(&format!("{options} -Q samples:50 sub"))?;
    let mut publisher = publisher()?;
    publisher.wait_success(END)?;
    ensure!(number(&summary(&publisher)?, "count") > 50);
    let counted = subscriber.wait_line(" total ", END)?;
    ensure!(counted.contains(" lost 0 "), "{counted}");
    subscriber.signal(Signal::SIGINT)?;
    subscriber.wait_success(END)
}

fn data_of_ddsperf(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-sub")?;
    let host = stage.near(layer)?;
    let subscriber = host.perf("sub")?;
    let mut publisher = stage.ddsperf("pub 2kHz burst 5 size 1k")?;
    ensure_flow(subscriber, &mut publisher)
}

fn pings_between_hosts(near: Layer, far: Layer) -> Result<()> {
    let stage = Stage::new("perf-pings")?;
    let (near, far) = (stage.near(near)?, stage.far(far)?);
    let pong = far.perf("pong")?;
    // They may be one participant, and must not take each other's answers.
    let pings = [
        near.perf("ping --rate 1000 --duration 0.3")?,
        near.perf("ping --size 500 --busy-poll 20 --duration 0.3")?,
    ];
    for mut ping in pings {
        ping.wait_success(END)?;
        ensure_round_trips(&ping)?;
    }
    let summary = end(pong)?;
    ensure!(number(&summary, "count") > 100, "{summary}");
    Ok(())
}

/// A large sample comes as a burst of more than 40 datagrams. Whom bursts do not wake waits for a timer, which comes to a
/// fiftieth of the round trips of single datagrams.
fn bursts_wake_who_sleeps(layer: Layer) -> Result<()> {
    let stage = Stage::new("perf-bursts")?;
    let (near, far) = (stage.near(layer)?, stage.far(layer)?);
    let _pong = far.perf("pong --busy-poll 0")?;
    let round_trips = |size: u32| -> Result<u64> {
        let arguments = format!("ping --size {size} --busy-poll 0 --duration 1");
        let mut ping = near.perf(&arguments)?;
        ping.wait_success(END)?;
        Ok(number(&summary(&ping)?, "count"))
    };
    let (bursts, datagrams) = (round_trips(60_000)?, round_trips(100)?);
    ensure!(bursts * 10 > datagrams, "{bursts} to {datagrams}");
    Ok(())
}

fn data_between_hosts(near: Layer, far: Layer) -> Result<()> {
    let stage = Stage::new("perf-data")?;
    let (near, far) = (stage.near(near)?, stage.far(far)?);
    let subscriber = far.perf("sub")?;
    let mut publisher = near.perf("pub --size 100")?;
    ensure_flow(subscriber, &mut publisher)
}

/// Lets samples flow for a second, after which none may be missing.
fn ensure_flow(mut subscriber: Process, publisher: &mut Process) -> Result<()> {
    let flows = |event: &Value| event["event"] == "second" && number(event, "count") > 100;
    let second = subscriber.wait_json_event(flows, END);
    second.with_context(|| format!("the publisher's output:\n{}", publisher.last_text()))?;
    let received = end(subscriber)?;
    ensure!(number(&received, "lost") == 0, "{received}");
    publisher.signal(Signal::SIGINT)?;
    publisher.wait_success(END)
}

fn ensure_round_trips(ping: &Process) -> Result<()> {
    let summary = summary(ping)?;
    let times = ["p50_us", "p90_us", "p99_us", "p999_us", "max_us"];
    let times = times.map(|name| summary[name].as_f64().unwrap_or_default());
    ensure!(number(&summary, "count") > 10, "{summary}");
    ensure!(number(&summary, "lost") == 0, "{summary}");
    ensure!(times[0] > 0.0 && times.is_sorted(), "{summary}");
    Ok(())
}

/// Ends a program that runs until it is told, and gives its summary.
fn end(mut process: Process) -> Result<Value> {
    process.signal(Signal::SIGTERM)?;
    process.wait_success(END)?;
    summary(&process)
}

fn summary(process: &Process) -> Result<Value> {
    let mut events = process.events().into_iter();
    let summary = events.find(|event| event["event"] == "summary");
    summary.with_context(|| format!("no summary:\n{}", process.last_text()))
}

fn number(event: &Value, name: &str) -> u64 {
    event[name].as_u64().unwrap_or_default()
}
