//! The programs that the benchmark runs, all of them built with optimization.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use rtps_tests::binaries::{self, Binaries};
use rtps_tests::peers::{self, Peer};

/// See the module.
pub(super) struct Programs {
    binaries: Binaries,
    /// This program, which is also the apps, the crowd and the stranger.
    pub(super) this: PathBuf,
    /// A Cyclone DDS participant with many endpoints.
    pub(super) cyclone: Peer,
}

impl Programs {
    /// Builds what is not up to date.
    pub(super) fn build() -> Result<Self> {
        Ok(Self {
            binaries: binaries::build()?,
            this: std::env::current_exe()?,
            cyclone: peers::cyclone_discovery()?,
        })
    }

    /// The control process of the kernel layer.
    pub(super) fn rtpsd(&self) -> PathBuf {
        self.binaries.rtpsd()
    }

    /// Whether rtpsd can be told where discovery is done.
    pub(super) fn has_user_discovery(&self) -> Result<bool> {
        let help = Command::new(self.rtpsd()).arg("--help").output()?;
        Ok(String::from_utf8_lossy(&help.stdout).contains("--discovery"))
    }
}

/// Goes on as the release build of this program, because its other roles are a part of what is measured.
pub(in crate::bench) fn as_release_build() -> Result<()> {
    if !cfg!(debug_assertions) {
        return Ok(());
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo)
        .args(["build", "--quiet", "--release", "--package", "xtask"])
        .current_dir(binaries::workspace())
        .status()
        .context("cargo could not be started")?;
    ensure!(status.success(), "cargo build ended with {status}");
    let debug_build = std::env::current_exe()?;
    let target = debug_build.parent().and_then(|folder| folder.parent());
    let release_build = target
        .context("this program is in no target folder")?
        .join("release")
        .join("xtask");
    let error = Command::new(&release_build)
        .args(std::env::args_os().skip(1))
        .exec();
    Err(error).with_context(|| format!("{} cannot be run", release_build.display()))
}
