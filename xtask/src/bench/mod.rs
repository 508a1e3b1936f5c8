//! `cargo xtask bench`: speed, always against peers in the same run, because the machines are noisy.
//!
//! Each benchmark is a list of [cases](row::Case), measured [round](rounds) after round, each case once a round, so that
//! the noise of the machine meets all of them alike. A run of a case is an [exchange](exchange) between
//! [programs](programs) on [hosts](hosts) made of network namespaces; what it costs is read from [the machine](machine).

mod cpu;
mod ddsperf;
mod discovery;
mod exchange;
mod fanout;
mod figures;
mod hosts;
mod idle;
mod large;
mod latency;
mod machine;
mod options;
mod picture;
mod plan;
mod program;
mod programs;
mod round_trips;
mod rounds;
mod row;
mod soak;
mod table;
mod throughput;
mod udp;

use anyhow::Result;
use clap::Subcommand;

use crate::interrupt;
use options::Options;
use row::Row;

/// What to measure.
#[derive(Debug, Subcommand)]
pub(crate) enum Bench {
    /// Round trips of a reliable 100 B sample, between two hosts and on one.
    Latency(Options),
    /// Samples a second from one writer to one reader, by size.
    Throughput(Options),
    /// Samples a second from one writer to a reader on each of 8 hosts, unicast.
    Fanout(Options),
    /// Samples of 64 kB to 16 MB, and 4 MB while packets get lost.
    Large(Options),
    /// What a sample costs at a fixed rate, and what an idle app with 20 readers does.
    Cpu(Options),
    /// All of these, and the picture docs/bench.svg.
    All(Options),
    /// Minutes at 80 % of the peak rate: memory and losses.
    Soak(soak::Soak),
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

/// Measures the cases that the options ask for.
type Measure = fn(&Options) -> Result<Vec<Row>>;

const ALL: [Measure; 5] = [
    latency::measure,
    throughput::measure,
    fanout::measure,
    large::measure,
    cpu::measure,
];

impl Bench {
    /// Measures and prints.
    pub(crate) fn run(&self) -> Result<()> {
        match self {
            Self::Latency(options) => run(options, &[latency::measure]),
            Self::Throughput(options) => run(options, &[throughput::measure]),
            Self::Fanout(options) => run(options, &[fanout::measure]),
            Self::Large(options) => run(options, &[large::measure]),
            Self::Cpu(options) => run(options, &[cpu::measure]),
            Self::All(options) => run(&options.with_picture(), &ALL),
            Self::Soak(soak) => soak.run(),
            Self::Discovery(discovery) => discovery.run(),
            Self::DiscoveryApp(app) => app.run(),
            Self::DiscoveryCrowd(generator) => generator.run(),
            Self::DiscoveryProbe(probe) => probe.run(),
            Self::UdpEnd(end) => end.run(),
        }
    }
}

fn run(options: &Options, measures: &[Measure]) -> Result<()> {
    // A quick run tells nothing of speed, for which a build of minutes would be too much.
    if !options.quick {
        discovery::as_release_build()?;
    }
    interrupt::catch()?;
    let mut rows = Vec::new();
    for measure in measures {
        rows.extend(measure(options)?);
    }
    if let Some(path) = &options.picture {
        picture::write(path, &rows)?;
    }
    table::print(&rows, options.json)
}
