//! RustDDS, measured by a program of ours in `tests/peers/rustdds`, which is a workspace of its own and built on demand.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::binaries;

/// The program, built if it is not up to date. Its command line is that of `rtps perf` as far as benchmarks use it; its
/// events are `ready` and `summary`.
///
/// # Errors
/// When cargo cannot get or build RustDDS.
pub fn build() -> Result<PathBuf> {
    let manifest = binaries::workspace().join("tests/peers/rustdds/Cargo.toml");
    let target = binaries::target_folder().join("peers/rustdds-build");
    eprintln!("building the RustDDS peer");
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["build", "--quiet", "--release", "--locked"])
        .arg("--manifest-path")
        .arg(manifest)
        .arg("--target-dir")
        .arg(&target)
        .output()
        .context("cargo could not be started")?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        bail!("cargo build ended with {}:\n{words}", output.status);
    }
    Ok(target.join("release/rustdds-perf"))
}
