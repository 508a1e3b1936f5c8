//! `rtps`: what can be done with the RTPS-socket API from a shell.
//!
//! `rtps perf` measures round trips and throughput between two programs, of which either may be Cyclone DDS's ddsperf.
#![forbid(unsafe_code)]

mod perf;
mod stop;

use clap::{Parser, Subcommand};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// The command-line tool of the RTPS-socket API.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure round trips and throughput; the other end may be Cyclone DDS's ddsperf.
    #[command(subcommand)]
    Perf(perf::Perf),
}

fn main() -> anyhow::Result<()> {
    let cli = Cli::parse();
    log();
    stop::catch_signals()?;
    match cli.command {
        Command::Perf(perf) => perf.run(),
    }
}

/// Logs to standard error what RUST_LOG asks for, else errors. Filters that know regular expressions would take a good
/// part of the memory that is measured.
fn log() {
    let asked = std::env::var("RUST_LOG").ok();
    let filter = asked.and_then(|directives| directives.parse().ok());
    let filter = filter.unwrap_or_else(|| Targets::new().with_default(LevelFilter::ERROR));
    let log = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .log_internal_errors(false);
    tracing_subscriber::registry().with(log).with(filter).init();
}
