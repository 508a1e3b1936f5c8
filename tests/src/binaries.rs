//! The binaries that tests, demo and benchmarks start: rtpsd, rtps and the examples of rtps-socket, built in release mode.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

/// Where the built binaries are.
#[derive(Clone, Debug)]
pub struct Binaries {
    folder: PathBuf,
}

impl Binaries {
    /// The control process of the kernel layer.
    #[must_use]
    pub fn rtpsd(&self) -> PathBuf {
        self.folder.join("rtpsd")
    }

    /// The command-line tool.
    #[must_use]
    pub fn rtps(&self) -> PathBuf {
        self.folder.join("rtps")
    }

    /// An example of rtps-socket.
    #[must_use]
    pub fn example(&self, name: &str) -> PathBuf {
        self.folder.join("examples").join(name)
    }
}

/// Builds what is not up to date. Where the target folder belongs to somebody else, what it holds is taken as it is.
///
/// # Errors
/// When cargo cannot be started or the build fails.
pub fn build() -> Result<Binaries> {
    let binaries = Binaries {
        folder: target_folder().join("release"),
    };
    if !writable(&target_folder()) && binaries.rtpsd().exists() {
        return Ok(binaries);
    }
    let status = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args([
            "build",
            "--quiet",
            "--release",
            "--package",
            "rtpsd",
            "--package",
            "rtps-socket",
            "--package",
            "rtps-cli",
            "--bins",
            "--examples",
        ])
        .current_dir(workspace())
        .status()
        .context("cargo could not be started")?;
    if status.success() {
        Ok(binaries)
    } else {
        bail!("cargo build ended with {status}")
    }
}

/// The root of the workspace that this command was built from.
#[must_use]
pub fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests is a folder of the workspace")
}

/// Where cargo puts what it builds.
#[must_use]
pub fn target_folder() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), PathBuf::from)
}

fn writable(folder: &Path) -> bool {
    !folder.exists() || nix::unistd::access(folder, nix::unistd::AccessFlags::W_OK).is_ok()
}
