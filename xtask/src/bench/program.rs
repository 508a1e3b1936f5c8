//! A program that takes part in an exchange, and what it tells in the end.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use rtps_tests::process::Process;
use serde_json::Value;

use super::ddsperf;
use super::figures::Figures;

/// What discovery and the start of a program may take on a busy machine.
const START: Duration = Duration::from_secs(30);
/// What the end of a program may take.
const END: Duration = Duration::from_secs(20);
/// Measuring begins so long after the programs have found each other.
pub(super) const WARM_UP: Duration = Duration::from_millis(500);

/// What a program does.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Role {
    /// Sends a sample and waits for it to come back, again and again.
    Ping,
    /// Sends every sample back.
    Pong,
    /// Writes.
    Publish,
    /// Reads.
    Subscribe,
}

impl Role {
    /// On the command lines of all programs.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ping => "ping",
            Self::Pong => "pong",
            Self::Publish => "pub",
            Self::Subscribe => "sub",
        }
    }
}

/// How a program tells what it has measured.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Dialect {
    /// A JSON object a line: `ready` when matched, `summary` at the end.
    Json,
    /// Lines of text a second.
    Ddsperf,
}

/// A running program, killed with the value.
pub(super) struct Program {
    process: Process,
    role: Role,
    dialect: Dialect,
}

/// What a measuring program has seen.
#[derive(Clone, Debug)]
pub(super) struct Outcome {
    pub(super) figures: Figures,
    /// Samples that arrived in a second at either end; a round trip is two.
    pub(super) samples_per_s: f64,
}

impl Program {
    pub(super) fn new(process: Process, role: Role, dialect: Dialect) -> Self {
        Self {
            process,
            role,
            dialect,
        }
    }

    pub(super) fn pid(&self) -> Pid {
        self.process.pid()
    }

    /// Waits until a measuring program has found its match and the samples flow evenly.
    pub(super) fn wait_steady(&mut self) -> Result<()> {
        match self.dialect {
            Dialect::Json => {
                let ready = |event: &Value| event["event"] == "ready";
                self.process.wait_json_event(ready, START)?;
                thread::sleep(WARM_UP);
                Ok(())
            }
            Dialect::Ddsperf => self.wait_told(1),
        }
    }

    /// How often a program that tells something each second has done so.
    pub(super) fn told(&self) -> usize {
        match self.dialect {
            Dialect::Json => 0,
            Dialect::Ddsperf => ddsperf::statistics(&self.text()),
        }
    }

    /// Waits until a program that tells something each second has done so that often.
    pub(super) fn wait_told(&mut self, wanted: usize) -> Result<()> {
        const LOOK: Duration = Duration::from_millis(20);
        let deadline = Instant::now() + START;
        while self.dialect == Dialect::Ddsperf && self.told() < wanted {
            ensure!(
                Instant::now() < deadline && self.process.wait_exit(Duration::ZERO).is_err(),
                "it does not measure:\n{}",
                self.process.last_text()
            );
            thread::sleep(LOOK);
        }
        Ok(())
    }

    /// What has been printed so far.
    pub(super) fn text(&self) -> String {
        self.process.text()
    }

    /// Ends it, with the time to tell what it has to.
    pub(super) fn end(&mut self) -> Result<()> {
        self.process.signal(Signal::SIGTERM)?;
        self.process.wait_exit(END).map(drop)
    }

    /// What an ended program has measured; `steady` is what it had printed before the other side was ended.
    pub(super) fn outcome(&self, steady: &str) -> Result<Outcome> {
        let text = self.text();
        let outcome = match (self.dialect, self.role) {
            (Dialect::Json, _) => self.summary(),
            (Dialect::Ddsperf, Role::Ping | Role::Pong) => ddsperf::round_trips(steady),
            (Dialect::Ddsperf, Role::Publish | Role::Subscribe) => ddsperf::samples(steady, &text),
        };
        outcome.with_context(|| format!("it printed:\n{}", self.process.last_text()))
    }

    fn summary(&self) -> Result<Outcome> {
        let mut events = self.process.events().into_iter().rev();
        let summary = events
            .find(|event| event["event"] == "summary")
            .context("there is no summary")?;
        read_summary(&summary)
    }
}

fn read_summary(summary: &Value) -> Result<Outcome> {
    let figure = |name: &str| summary[name].as_f64();
    let round_trips = figure("count").zip(figure("seconds"));
    let round_trips = round_trips.map(|(count, seconds)| count / seconds);
    let figures = Figures {
        p50_us: figure("p50_us"),
        p90_us: figure("p90_us"),
        p99_us: figure("p99_us"),
        p999_us: figure("p999_us"),
        max_us: figure("max_us"),
        samples_per_s: figure("samples_per_s"),
        lost: summary["lost"].as_u64(),
        ..Figures::default()
    };
    let samples_per_s = figures
        .samples_per_s
        .or_else(|| round_trips.map(|rate| 2.0 * rate));
    Ok(Outcome {
        samples_per_s: samples_per_s
            .filter(|rate| *rate > 0.0)
            .with_context(|| format!("nothing was exchanged: {summary}"))?,
        figures,
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_round_trip_is_two_samples() {
        let summary = json!({"event": "summary", "role": "ping", "count": 100, "lost": 1, "seconds": 0.5, "p50_us": 7.5});
        let outcome = read_summary(&summary).unwrap();
        assert_eq!(outcome.samples_per_s, 400.0);
        assert_eq!(
            (outcome.figures.p50_us, outcome.figures.lost),
            (Some(7.5), Some(1))
        );
        assert_eq!(outcome.figures.samples_per_s, None);
    }

    #[test]
    fn nothing_is_no_outcome() {
        let summary = json!({"event": "summary", "role": "sub", "count": 0, "lost": 0, "seconds": 0.0, "samples_per_s": 0.0});
        assert!(read_summary(&summary).is_err());
    }
}
