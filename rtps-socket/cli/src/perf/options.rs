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
