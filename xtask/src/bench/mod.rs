//! `cargo xtask bench`: speed, always against a peer in the same run, because the machines are noisy.

mod latency;
mod round_trips;
mod udp;

use anyhow::Result;
use clap::Subcommand;

/// What to measure.
#[derive(Debug, Subcommand)]
pub(crate) enum Bench {
    /// Round trips of a reliable 100 B sample between two namespaces: kernel layer, in-process layer, raw UDP.
    Latency(latency::Latency),
    /// One end of the raw UDP floor (started by the benchmark itself).
    #[command(hide = true)]
    UdpEnd(udp::UdpEnd),
}

impl Bench {
    /// Measures and prints.
    pub(crate) fn run(&self) -> Result<()> {
        match self {
            Self::Latency(latency) => latency.run(),
            Self::UdpEnd(end) => end.run(),
        }
    }
}
