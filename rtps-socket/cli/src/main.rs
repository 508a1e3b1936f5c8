//! `rtps`: what can be done with the RTPS-socket API from a shell.
//!
//! `rtps perf` measures round trips and throughput between two programs, of which either may be Cyclone DDS's ddsperf.
#![forbid(unsafe_code)]

mod perf;
mod stop;

use clap::{Parser, Subcommand};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

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

/// Logs to standard error what RUST_LOG asks for, else errors. The filter is only made where it is needed: it would take
/// a good part of the memory that is measured.
fn log() {
    let log = tracing_subscriber::fmt().with_writer(std::io::stderr);
    match std::env::var_os("RUST_LOG") {
        Some(_) => log.with_env_filter(EnvFilter::from_default_env()).init(),
        None => log.with_max_level(LevelFilter::ERROR).init(),
    }
}
