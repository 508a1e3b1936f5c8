//! Installing what a test needs and a fresh machine lacks.

use std::fs::File;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};
use nix::fcntl::{Flock, FlockArg};
use nix::unistd::Uid;

/// A Debian package and a file that shows that it (or its equivalent elsewhere) is there.
#[derive(Clone, Copy, Debug)]
pub struct Package {
    /// The package's name.
    pub name: &'static str,
    /// A file of it, absolute.
    pub probe: &'static str,
}

impl Package {
    /// A package that has the file `probe`.
    #[must_use]
    pub const fn new(name: &'static str, probe: &'static str) -> Self {
        Self { name, probe }
    }

    fn is_missing(&self) -> bool {
        !Path::new(self.probe).exists()
    }
}

/// Installs those packages whose file is missing, and says so on standard error.
///
/// # Errors
/// When something is missing and this process is not root or apt-get fails; the message holds the
/// command that a person can type.
pub fn ensure_installed(packages: &[Package]) -> Result<()> {
    let names = missing(packages);
    if names.is_empty() {
        return Ok(());
    }
    let by_hand = format!(
        "apt-get install -y --no-install-recommends {}",
        names.join(" ")
    );
    if !Uid::effective().is_root() {
        bail!("missing Debian packages; as root: {by_hand}");
    }
    if !Path::new("/usr/bin/apt-get").exists() {
        bail!("missing packages, and this is no Debian; find the equivalent of: {by_hand}");
    }
    let lock = File::create(std::env::temp_dir().join("rtps-tests-apt.lock"))
        .context("creating the lock of the package installation")?;
    let _lock = Flock::lock(lock, FlockArg::LockExclusive).map_err(|(_file, error)| error)?;
    // Another process may have installed some meanwhile.
    let names = missing(packages);
    if !names.is_empty() {
        eprintln!("installing Debian packages: {}", names.join(" "));
        install(&names).with_context(|| format!("try by hand: {by_hand}"))?;
    }
    match missing(packages).as_slice() {
        [] => Ok(()),
        rest => bail!("installed, but their files are not where expected: {rest:?}"),
    }
}

fn missing(packages: &[Package]) -> Vec<&'static str> {
    packages
        .iter()
        .filter(|package| package.is_missing())
        .map(|package| package.name)
        .collect()
}

fn install(names: &[&str]) -> Result<()> {
    let mut arguments = vec!["install", "-y", "--no-install-recommends"];
    arguments.extend(names);
    // On a fresh machine the package lists are missing or old.
    apt_get(&arguments).or_else(|_| {
        apt_get(&["update"])?;
        apt_get(&arguments)
    })
}

fn apt_get(arguments: &[&str]) -> Result<()> {
    let output = Command::new("apt-get")
        .args(["-q", "-o", "DPkg::Lock::Timeout=300"])
        .args(arguments)
        .env("DEBIAN_FRONTEND", "noninteractive")
        .output()
        .context("running apt-get")?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        bail!("apt-get {} failed: {}", arguments.join(" "), words.trim());
    }
    Ok(())
}
