//! `cargo xtask`: everything a developer types. One subcommand, one module.

mod bench;
mod build_ebpf;
mod demo;
mod interrupt;
mod load;
mod status;
mod test;
mod unload;

use std::process::ExitCode;

use clap::Parser;

/// Builds, loads, demonstrates, tests and measures the project.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
enum Command {
    /// Build the kernel programs into rtps-ebpf/rtps-ebpf.o.
    BuildEbpf(build_ebpf::Arguments),
    /// Load the kernel layer into this network namespace (root).
    Load(rtpsd::Options),
    /// Remove the kernel layer from this network namespace (root).
    Unload,
    /// Show what the kernel layer of this network namespace is doing.
    Status {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Show an unmodified Cyclone DDS talking to two apps through the kernel layer.
    Demo(demo::Demo),
    /// One of the demo's apps (started by the demo itself).
    #[command(hide = true)]
    DemoApp(demo::app::App),
    /// Run every check and test.
    Test,
    /// Measure.
    #[command(subcommand)]
    Bench(bench::Bench),
}

fn main() -> ExitCode {
    match run(Command::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::BuildEbpf(arguments) => build_ebpf::run(&arguments),
        Command::Load(options) => load::run(&options),
        Command::Unload => unload::run(),
        Command::Status { json } => status::run(json),
        Command::Demo(demo) => demo.run(),
        Command::DemoApp(app) => app.run(),
        Command::Test => test::run(),
        Command::Bench(bench) => bench.run(),
    }
}
