//! What is printed: when the ends have found each other, once a second, and in the end.

use std::fmt;
use std::io::Write;
use std::time::Duration;

use serde::Serialize;
use serde_json::Value;

use super::histogram::Histogram;

/// Prints the lines of one role.
#[derive(Debug)]
pub(crate) struct Report {
    role: &'static str,
    json: bool,
}

/// What a line is about.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
enum Event {
    Ready,
    Second,
    Summary,
}

#[derive(Serialize)]
struct Line<F> {
    event: Event,
    role: &'static str,
    #[serde(flatten)]
    figures: F,
}

/// Round trips, there and back.
#[derive(Debug, Serialize)]
pub(crate) struct RoundTrips {
    count: u64,
    /// Answers that did not come in time.
    lost: u64,
    seconds: f64,
    p50_us: f64,
    p90_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
}

/// Samples that were received.
#[derive(Debug, Serialize)]
pub(crate) struct Received {
    pub(crate) count: u64,
    /// Numbers that were left out.
    pub(crate) lost: u64,
    pub(crate) seconds: f64,
    pub(crate) samples_per_s: f64,
    pub(crate) bytes_per_s: f64,
}

/// Samples that were sent.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Sent {
    count: u64,
    seconds: f64,
    samples_per_s: f64,
}

impl RoundTrips {
    pub(crate) fn new(histogram: &Histogram, lost: u64, time: Duration) -> Self {
        let percentile = |part| micros(histogram.percentile(part));
        Self {
            count: histogram.count(),
            lost,
            seconds: time.as_secs_f64(),
            p50_us: percentile(0.5),
            p90_us: percentile(0.9),
            p99_us: percentile(0.99),
            p999_us: percentile(0.999),
            max_us: micros(histogram.max()),
        }
    }
}

impl Sent {
    pub(crate) fn new(count: u64, time: Duration) -> Self {
        Self {
            count,
            seconds: time.as_secs_f64(),
            samples_per_s: per_second(count, time),
        }
    }
}

impl Report {
    pub(crate) fn new(role: &'static str, json: bool) -> Self {
        Self { role, json }
    }

    /// The ends have found each other.
    pub(crate) fn ready(&self) {
        self.print(Event::Ready, serde_json::Map::new());
    }

    /// What happened in the last second.
    pub(crate) fn second(&self, figures: impl Serialize) {
        self.print(Event::Second, figures);
    }

    /// What happened in all.
    pub(crate) fn summary(&self, figures: impl Serialize) {
        self.print(Event::Summary, figures);
    }

    fn print(&self, event: Event, figures: impl Serialize) {
        let line = Line {
            event,
            role: self.role,
            figures,
        };
        let line = serde_json::to_value(line).unwrap_or_default();
        let mut out = std::io::stdout().lock();
        // Where nobody reads any more there will be a signal.
        let _ = match self.json {
            true => writeln!(out, "{line}"),
            false => writeln!(out, "{}", Text(&line)),
        };
    }
}

/// How many a second; 0 in no time.
pub(crate) fn per_second(count: u64, time: Duration) -> f64 {
    match time.is_zero() {
        true => 0.0,
        false => count as f64 / time.as_secs_f64(),
    }
}

fn micros(span: Duration) -> f64 {
    span.as_nanos() as f64 / 1000.0
}

/// A line for people.
struct Text<'a>(&'a Value);

impl fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = |name| self.0[name].as_str().unwrap_or_default();
        write!(f, "{:7} {:4}", word("event"), word("role"))?;
        for (name, value) in self.0.as_object().into_iter().flatten() {
            match value {
                Value::Number(number) if number.is_f64() => {
                    write!(f, "  {name} {:.3}", number.as_f64().unwrap_or_default())?;
                }
                Value::Number(number) => write!(f, "  {name} {number}")?,
                _ => {}
            }
        }
        Ok(())
    }
}
