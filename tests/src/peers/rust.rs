//! Peers in Rust, on libraries that crates.io has: a workspace of their own in `tests/peers`.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use super::source;

pub(super) const SOURCES: &[&str] = &[
    "Cargo.lock",
    "Cargo.toml",
    "shapes/Cargo.toml",
    "shapes/src/events.rs",
    "shapes/src/lib.rs",
    "shapes/src/options.rs",
    "rustdds/Cargo.toml",
    "rustdds/src/figures.rs",
    "rustdds/src/main.rs",
    "rustdds/src/octets.rs",
    "rustdds/src/shapes.rs",
    "dustdds/Cargo.toml",
    "dustdds/src/main.rs",
];

/// A program of the workspace, copied out of where cargo puts it. All are built at once: they share most of their parts,
/// and cargo builds those of one while it waits for another.
pub(super) fn build(directory: &Path, program: &str) -> Result<PathBuf> {
    let target = directory.join("rust.build");
    super::run(
        Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            .args([
                "build",
                "--quiet",
                "--release",
                "--locked",
                "--bin",
                program,
            ])
            .arg("--manifest-path")
            .arg(source("Cargo.toml"))
            .arg("--target-dir")
            .arg(&target),
    )?;
    let copy = directory.join(format!("{program}.new"));
    std::fs::copy(target.join("release").join(program), &copy)?;
    Ok(copy)
}
