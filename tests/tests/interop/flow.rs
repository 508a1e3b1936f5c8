//! A flow: one publisher's samples on their way to its subscribers, and what must have arrived in the end.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::process::Process;
use serde_json::Value;

/// Longer than any program waits for its count by itself.
pub(crate) const END: Duration = Duration::from_secs(60);

/// Arguments of both ends that make all samples arrive, whichever end sees the match first.
pub(crate) const EVERYTHING: &str = "--reliable --durability transient-local --timeout 50";

/// The `--pub` and the `--sub` arguments of a flow of so many samples to so many readers.
pub(crate) struct Arguments {
    pub(crate) publisher: String,
    pub(crate) subscriber: String,
}

impl Arguments {
    /// Every sample arrives; `common` is added for both ends.
    pub(crate) fn reliable(samples: u64, readers: u32, common: &str) -> Self {
        let both = format!("{EVERYTHING} --count {samples} {common}");
        Self {
            publisher: format!("--pub --wait-match {readers} --period-us 500 {both}"),
            subscriber: format!("--sub {both} --linger 0.2"),
        }
    }
}

/// Waits until everybody is content, then checks that every reader got 0..samples in order, each sample of `size`.
pub(crate) fn complete(
    mut publisher: Process,
    subscribers: impl IntoIterator<Item = Process>,
    samples: u64,
    size: u64,
) -> Result<()> {
    for mut subscriber in subscribers {
        subscriber
            .wait_success(END)
            .with_context(|| format!("the publisher's output:\n{}", publisher.text()))?;
        ensure_all(&subscriber, samples, size)?;
    }
    publisher.wait_success(END)
}

/// The events of ended subscriber hold 0..samples in order.
pub(crate) fn ensure_all(subscriber: &Process, samples: u64, size: u64) -> Result<()> {
    let numbers = numbers(subscriber);
    let wrong = numbers.iter().zip(0..).position(|(got, due)| *got != due);
    let around = wrong.map(|at| &numbers[at.saturating_sub(2)..numbers.len().min(at + 8)]);
    ensure!(around.is_none(), "from {wrong:?}: {around:?}");
    ensure!(numbers.len() as u64 == samples, "{} came", numbers.len());
    let sizes = sample_events(subscriber).map(|event| event["size"].as_u64());
    let wrong: Vec<_> = sizes.filter(|got| *got != Some(size)).collect();
    ensure!(wrong.is_empty(), "sizes other than {size}: {wrong:?}");
    Ok(())
}

/// The numbers of the samples received so far.
pub(crate) fn numbers(subscriber: &Process) -> Vec<u64> {
    sample_events(subscriber)
        .filter_map(|event| event["x"].as_u64())
        .collect()
}

fn sample_events(subscriber: &Process) -> impl Iterator<Item = Value> {
    let events = subscriber.events().into_iter();
    events.filter(|event| event["event"] == "sample")
}

/// Waits for sample `number`.
pub(crate) fn wait_sample(subscriber: &mut Process, number: u64) -> Result<()> {
    let wanted = |event: &Value| event["event"] == "sample" && event["x"] == number;
    subscriber.wait_json_event(wanted, END).map(drop)
}

/// Waits until so many remote endpoints are matched.
pub(crate) fn wait_matched(process: &mut Process, current: u64) -> Result<()> {
    let wanted = |event: &Value| event["event"] == "matched" && event["current"] == current;
    process.wait_json_event(wanted, END).map(drop)
}
