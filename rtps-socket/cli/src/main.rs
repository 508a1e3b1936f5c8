//! `rtps`: what can be done with the RTPS-socket API from a shell.
//!
//! `rtps perf` measures round trips and throughput between two programs, of which either may be Cyclone DDS's ddsperf.
#![forbid(unsafe_code)]

mod perf;
mod stop;

use clap::{Parser, Subcommand};

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
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .init();
    stop::catch_signals()?;
    match cli.command {
        Command::Perf(perf) => perf.run(),
    }
}
