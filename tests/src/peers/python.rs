//! The peer in Python, on the binding of Cyclone DDS that PyPI has, in a virtual environment of its own.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};

use super::source;
use crate::debian::{self, Package};

pub(super) const SOURCES: &[&str] = &["cyclone11.py"];

const BINDING: &str = "cyclonedds==11.0.1";
/// Debian's Python comes without what makes environments.
const VENV: [Package; 1] = [Package::new(
    "python3-venv",
    "/usr/share/doc/python3-venv/copyright",
)];
/// What the kernel reads of a script's first line.
const LONGEST_INTERPRETER: usize = 255;

/// The script, with the interpreter of its environment, to be executed.
pub(super) fn cyclone11(directory: &Path) -> Result<PathBuf> {
    let environment = directory.join("cyclone11.venv");
    let python = environment.join("bin/python");
    if !python.exists() {
        make_environment(&environment)?;
    }
    super::run(
        Command::new(&python)
            .args(["-m", "pip", "install", "--quiet"])
            .arg("--disable-pip-version-check")
            .arg(BINDING),
    )?;
    let script = fs::read_to_string(source("cyclone11.py"))?;
    let program = directory.join("cyclone11.new");
    let first_line = format!("#!{}", python.display());
    ensure!(
        first_line.len() < LONGEST_INTERPRETER,
        "the target directory's path is too long: {first_line}"
    );
    fs::write(&program, format!("{first_line}\n{script}"))?;
    fs::set_permissions(&program, Permissions::from_mode(0o755))?;
    Ok(program)
}

fn make_environment(environment: &Path) -> Result<()> {
    let can = |python: &str| {
        let mut command = Command::new(python);
        super::run(command.args(["-c", "import ensurepip, venv"])).is_ok()
    };
    let make = |python: &str| {
        let mut command = Command::new(python);
        super::run(command.args(["-m", "venv"]).arg(environment))
    };
    if can("python3") {
        return make("python3");
    }
    debian::ensure_installed(&VENV)?;
    make("/usr/bin/python3")
}
