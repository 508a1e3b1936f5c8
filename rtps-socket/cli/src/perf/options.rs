//! The options that all roles have.

use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use rtps_socket::LayerChoice;

use super::topic::Topic;
use crate::stop;

/// What all roles have in common.
#[derive(Args, Clone, Debug)]
pub(crate) struct Options {
    /// The DDS domain, as ddsperf's -i.
    #[arg(short = 'i', long, default_value_t = 0)]
    pub(crate) domain: u32,
    /// The layer to use; the best one there is unless given.
    #[arg(long)]
    layer: Option<Layer>,
    /// The topic, as ddsperf's -T.
    #[arg(short = 'T', long, default_value = "KS")]
    pub(crate) topic: Topic,
    /// Best effort instead of reliable, as ddsperf's -u.
    #[arg(short = 'u', long)]
    pub(crate) best_effort: bool,
    /// Seconds to measure; until SIGINT or SIGTERM unless given.
    #[arg(short = 'D', long, value_parser = seconds)]
    duration: Option<Duration>,
    /// Seconds before that which don't count.
    #[arg(long, value_parser = seconds, default_value = "0")]
    warm_up: Duration,
    /// Look for samples so many microseconds before sleeping: a second unless a number is given.
    #[arg(long, value_name = "MICROSECONDS", num_args = 0..=1, default_missing_value = "1000000")]
    pub(crate) busy_poll: Option<u64>,
    /// Print JSON objects, one a line.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Layer {
    Kernel,
    InProcess,
}

impl Options {
    pub(crate) fn layer(&self) -> LayerChoice {
        match self.layer {
            None => LayerChoice::Automatic,
            Some(Layer::Kernel) => LayerChoice::Kernel,
            Some(Layer::InProcess) => LayerChoice::InProcess,
        }
    }

    /// The time to measure in, if the measurement begins, with its warm-up, at `begin`.
    pub(crate) fn period(&self, begin: Instant) -> Period {
        let start = begin + self.warm_up;
        Period {
            start,
            end: self.duration.map(|duration| start + duration),
        }
    }
}

/// When is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Period {
    /// The end of the warm-up.
    pub(crate) start: Instant,
    end: Option<Instant>,
}

impl Period {
    /// Whether the measurement is over, by time or by signal.
    pub(crate) fn is_over(&self, now: Instant) -> bool {
        stop::requested() || self.end.is_some_and(|end| end <= now)
    }
}

/// A time span given in seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number of seconds")?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// A size in bytes, which may end with k or M, as ddsperf takes it.
pub(crate) fn bytes(text: &str) -> Result<u32, String> {
    let digits = text.trim_end_matches(|letter: char| letter.is_ascii_alphabetic());
    let factor = match text.get(digits.len()..).unwrap_or_default() {
        "" | "B" => 1,
        "k" | "kB" | "KiB" => 1 << 10,
        "M" | "MB" | "MiB" => 1 << 20,
        other => return Err(format!("{other:?} is no unit: use k or M")),
    };
    let number: u32 = digits.parse().map_err(|_| "not a number of bytes")?;
    let bytes = number.checked_mul(factor);
    bytes.ok_or_else(|| "more than RTPS can carry".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(bytes("100"), Ok(100));
        assert_eq!(bytes("64k"), Ok(65_536));
        assert_eq!(bytes("4MiB"), Ok(4 << 20));
        for wrong in ["", "k", "1G", "5000M", "-1", "1.5k"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn spans() {
        assert_eq!(seconds("0.25"), Ok(Duration::from_millis(250)));
        for wrong in ["", "-1", "inf", "1s"] {
            assert!(seconds(wrong).is_err(), "{wrong}");
        }
    }
}
