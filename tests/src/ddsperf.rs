//! ddsperf, which Cyclone DDS measures itself with, taken unmodified from Debian.

use std::path::Path;

use anyhow::Result;

use crate::debian::{self, Package};
use crate::netns::Netns;
use crate::process::Process;

const DDSPERF: Package = Package::new("cyclonedds-tools", "/usr/bin/ddsperf");

/// Starts it on a host with one network interface, with arguments separated by spaces.
///
/// # Errors
/// When it cannot be installed or started.
pub fn spawn(netns: &Netns, arguments: &str) -> Result<Process> {
    debian::ensure_installed(&[DDSPERF])?;
    let mut command = netns.command(Path::new(DDSPERF.probe));
    command.args(arguments.split_whitespace());
    Process::spawn(&format!("ddsperf {arguments}"), &mut command)
}
