//! A reliable stream of numbered samples, of which none may be lost, repeated or held up.

use std::time::{Duration, Instant};

use crate::layer::Layer;
use crate::process::Process;
use crate::stage::{PATIENCE, Stage};
use anyhow::{Context, Result, ensure};

/// Samples a second.
pub const RATE: u64 = 1000;

/// Where an end of a stream is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// An app of ours on our host.
    Ours(Layer),
    /// An app of ours on the other host, on its kernel layer.
    Theirs,
    /// Cyclone DDS on the other host.
    Cyclone,
}

impl End {
    fn start(self, stage: &Stage, arguments: &str) -> Result<Process> {
        match self {
            Self::Ours(layer) => stage.app(&stage.ours, layer, arguments),
            Self::Theirs => stage.app(&stage.theirs, Layer::Kernel, arguments),
            Self::Cyclone => stage.cyclone(arguments),
        }
    }
}

/// A running stream; its writer writes `RATE` samples a second, and some of Cyclone's more slowly.
pub struct Stream {
    count: u64,
    publisher: Process,
    subscriber: Process,
}

impl Stream {
    /// Starts both ends; `count` samples will be written.
    ///
    /// # Errors
    /// When an end cannot be started.
    pub fn start(stage: &Stage, topic: &str, (from, to): (End, End), count: u64) -> Result<Self> {
        // Transient-local: the publisher may see the match before the subscriber does.
        let timeout = count / RATE + 2 * PATIENCE.as_secs();
        let common = format!(
            "--topic {topic} --reliable --durability transient-local --count {count} --timeout {timeout}"
        );
        let subscriber = to.start(stage, &format!("--sub {common} --linger 0.5"))?;
        let period = 1_000_000 / RATE;
        let publisher = from.start(stage, &format!("--pub {common} --period-us {period}"))?;
        Ok(Self {
            count,
            publisher,
            subscriber,
        })
    }

    /// Waits until sample `number` has arrived.
    ///
    /// # Errors
    /// When it does not, with the output of both ends.
    pub fn wait_for(&mut self, number: u64) -> Result<()> {
        let is_there = |event: &serde_json::Value| {
            event["event"] == "sample" && event["x"].as_u64() >= Some(number)
        };
        let arrived = self.subscriber.wait_json_event(is_there, PATIENCE);
        arrived
            .map(drop)
            .with_context(|| format!("the publisher's output:\n{}", self.publisher.last_text()))
    }

    /// The number of the last sample that has arrived.
    #[must_use]
    pub fn position(&self) -> u64 {
        let events = self.subscriber.events();
        let mut samples = events.iter().rev().filter_map(|event| event["x"].as_u64());
        samples.next().unwrap_or(0)
    }

    /// The end that writes.
    #[must_use]
    pub fn publisher(&self) -> &Process {
        &self.publisher
    }

    /// The end that reads.
    #[must_use]
    pub fn subscriber(&self) -> &Process {
        &self.subscriber
    }

    /// Waits for the end; every sample must have arrived once and in order, and neither end may have seen the other
    /// go, unless it has gone in the end.
    ///
    /// # Errors
    /// When one of that does not hold.
    pub fn finish(mut self) -> Result<Reception> {
        let time = Duration::from_secs(self.count / RATE) + 2 * PATIENCE;
        self.subscriber
            .wait_success(time)
            .with_context(|| format!("the publisher's output:\n{}", self.publisher.last_text()))?;
        let reception = Reception::of(&self.subscriber);
        let numbers = reception.0.iter().map(|(_, number)| *number);
        let out_of_order = (0..).zip(numbers).find(|(wanted, number)| wanted != number);
        ensure!(
            out_of_order.is_none(),
            "(expected, received): {out_of_order:?}"
        );
        ensure!(
            reception.0.len() as u64 == self.count,
            "{} samples",
            reception.0.len()
        );
        for end in [&self.publisher, &self.subscriber] {
            let matches = matches(end);
            ensure!(
                matches.first() == Some(&1) && matches.len() <= 2,
                "matches came and went: {matches:?}"
            );
        }
        self.publisher.wait_success(PATIENCE)?;
        Ok(reception)
    }
}

/// When which sample arrived.
pub struct Reception(Vec<(Instant, u64)>);

impl Reception {
    fn of(subscriber: &Process) -> Self {
        let events = subscriber.timed_events().into_iter();
        let samples = events.filter(|(_, event)| event["event"] == "sample");
        Self(
            samples
                .filter_map(|(at, event)| Some((at, event["x"].as_u64()?)))
                .collect(),
        )
    }

    /// The longest time without a sample, between two times.
    #[must_use]
    pub fn longest_pause(&self, from: Instant, to: Instant) -> Duration {
        let within = self.0.iter().map(|(at, _)| *at);
        let within = within.filter(|at| (from..to).contains(at));
        let times: Vec<Instant> = [from].into_iter().chain(within).chain([to]).collect();
        let pauses = times.windows(2).map(|pair| pair[1] - pair[0]);
        pauses.max().unwrap_or_default()
    }
}

/// How many remote endpoints a program had, each time that this changed.
#[must_use]
pub fn matches(program: &Process) -> Vec<u64> {
    let events = program.events();
    let matched = events.iter().filter(|event| event["event"] == "matched");
    matched
        .filter_map(|event| event["current"].as_u64())
        .collect()
}
