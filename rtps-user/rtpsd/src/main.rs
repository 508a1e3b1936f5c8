//! rtpsd: see the library.

use std::io::{self, IsTerminal};
use std::process::ExitCode;

use clap::Parser;
use rtpsd::Options;
use tracing::error;
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let options = Options::parse();
    start_log(options.verbose);
    match rtpsd::run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            error!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn start_log(verbose: bool) {
    let default = if verbose { "debug,aya=info" } else { "info" };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        // Where nobody reads the log any more, to say so there would be the end of the process.
        .log_internal_errors(false)
        .init();
}
