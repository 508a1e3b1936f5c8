//! `cargo xtask bench`: speed, always against a peer in the same run, because the machines are noisy.

mod discovery;
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
    /// Discovery: a host joins a remote, a crowd joins a host, a stranger is answered; ours and Cyclone DDS.
    Discovery(discovery::Discovery),
    /// An app with many endpoints (started by the benchmark itself).
    #[command(hide = true)]
    DiscoveryApp(discovery::App),
    /// A crowd of simulated participants (started by the benchmark itself).
    #[command(hide = true)]
    DiscoveryCrowd(discovery::Generator),
    /// A stranger that waits for answers (started by the benchmark itself).
    #[command(hide = true)]
    DiscoveryProbe(discovery::Probe),
    /// One end of the raw UDP floor (started by the benchmark itself).
    #[command(hide = true)]
    UdpEnd(udp::UdpEnd),
}

impl Bench {
    /// Measures and prints.
    pub(crate) fn run(&self) -> Result<()> {
        match self {
            Self::Latency(latency) => latency.run(),
            Self::Discovery(discovery) => discovery.run(),
            Self::DiscoveryApp(app) => app.run(),
            Self::DiscoveryCrowd(generator) => generator.run(),
            Self::DiscoveryProbe(probe) => probe.run(),
            Self::UdpEnd(end) => end.run(),
        }
    }
}
