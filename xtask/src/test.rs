//! `cargo xtask test`: everything that must hold, in one run with one closing line.
//!
//! Formatting, lints and the committed BPF object are checked first, because they are quick to tell; then the
//! binaries and peers that the network tests start are built, then every test of the workspace runs. Tests that need
//! root, or a program that can't be had here, print why they skip.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

use rtps_tests::{binaries, peers};

use crate::build_ebpf;

/// Runs all steps; an error when any of them failed.
pub(crate) fn run() -> Result<()> {
    let mut tally = Tally::default();
    tally.step("cargo fmt --check", || {
        succeed(&["fmt", "--all", "--check"])
    });
    tally.step("cargo clippy", || {
        succeed(&[
            "clippy",
            "--quiet",
            "--workspace",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ])
    });
    tally.step("the BPF object is what its source says", object_check);
    tally.step("the binaries that the tests start", || {
        binaries::build().map(|_| ())
    });
    tally.step("other vendors' programs", peers_build);
    tally.cargo_test()?;
    println!("{} passed, {} failed", tally.passed, tally.failed);
    if tally.failed > 0 {
        bail!("{} of the tests failed", tally.failed);
    }
    Ok(())
}

/// Rebuilds the object where the tools for it can be had; whoever is not root only uses the committed one.
fn object_check() -> Result<()> {
    if !nix::unistd::geteuid().is_root() {
        println!(
            "skipped: installing the BPF tool chain needs root; the committed object is used as it is"
        );
        return Ok(());
    }
    build_ebpf::run(&build_ebpf::Arguments { check: true })
}

/// Before the tests, whose programs would be slow beside a compiler.
fn peers_build() -> Result<()> {
    if !nix::unistd::geteuid().is_root() {
        println!("skipped: the tests that need them need root");
        return Ok(());
    }
    peers::build_all()
}

#[derive(Default)]
struct Tally {
    passed: u32,
    failed: u32,
}

impl Tally {
    /// A step of ours, counted like a test.
    fn step(&mut self, name: &str, step: impl FnOnce() -> Result<()>) {
        println!("==> {name}");
        match step() {
            Ok(()) => self.passed += 1,
            Err(error) => {
                self.failed += 1;
                println!("FAILED: {name}: {error:#}");
            }
        }
    }

    /// All tests of the workspace, their output passed on and their closing lines added up.
    fn cargo_test(&mut self) -> Result<()> {
        println!("==> cargo test");
        let mut child = cargo()
            .args([
                "test",
                "--workspace",
                "--no-fail-fast",
                "--",
                "--nocapture",
                "--test-threads=3",
            ])
            .stdout(Stdio::piped())
            .spawn()
            .context("cargo could not be started")?;
        let stdout = child
            .stdout
            .take()
            .context("cargo's output was not captured")?;
        for line in BufReader::new(stdout).lines() {
            let line = line.context("cargo's output could not be read")?;
            self.add_result(&line);
            println!("{line}");
        }
        let status = child.wait().context("cargo test did not end")?;
        // A test program that does not compile, or dies, has no closing line to count.
        if !status.success() && self.failed == 0 {
            self.failed += 1;
        }
        Ok(())
    }

    /// Adds what a line like `test result: ok. 3 passed; 0 failed; ...` says.
    fn add_result(&mut self, line: &str) {
        let Some((_, counts)) = line.split_once("test result: ") else {
            return;
        };
        let count = |what: &str| -> u32 {
            let words: Vec<_> = counts.split([' ', ';']).collect();
            let position = words
                .iter()
                .position(|word| *word == what)
                .and_then(|at| at.checked_sub(1));
            position.and_then(|at| words[at].parse().ok()).unwrap_or(0)
        };
        self.passed += count("passed");
        self.failed += count("failed");
    }
}

fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

fn succeed(arguments: &[&str]) -> Result<()> {
    let status = cargo()
        .args(arguments)
        .status()
        .context("cargo could not be started")?;
    if status.success() {
        Ok(())
    } else {
        bail!("cargo {} ended with {status}", arguments.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::Tally;

    #[test]
    fn closing_lines_are_added_up() {
        let mut tally = Tally::default();
        tally.add_result("test result: ok. 12 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.1s");
        tally.add_result(
            "test result: FAILED. 3 passed; 2 failed; 1 ignored; 0 measured; 0 filtered out",
        );
        tally.add_result("test something ... ok");
        assert_eq!((tally.passed, tally.failed), (15, 2));
    }
}
