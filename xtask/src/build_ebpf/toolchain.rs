//! What it takes to build for BPF: a compiler with the sources of its own `core`, bpf-linker on an
//! LLVM that is not older than the compiler's, and llvm-strip.
//!
//! On Debian all of it comes from packages, so that the same object comes out on every machine.
//! Elsewhere the active tool chain serves, once it has rust-src.

use std::{
    env, fmt, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context as _, bail, ensure};

use super::{execute, say};

const BPF_LINKER_VERSION: &str = "0.13.0";
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_SYSROOT: &str = "/usr";

/// The tools, all present.
pub(super) struct Toolchain {
    pub(super) rustc: PathBuf,
    pub(super) sysroot: PathBuf,
    pub(super) linker: PathBuf,
    pub(super) strip: PathBuf,
    rustc_version: String,
    llvm_major: u32,
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            rustc_version,
            llvm_major,
            ..
        } = self;
        write!(
            f,
            "{rustc_version}, bpf-linker {BPF_LINKER_VERSION} on LLVM {llvm_major}"
        )
    }
}

/// Takes what is there and installs what is missing.
pub(super) fn find_or_install() -> anyhow::Result<Toolchain> {
    let debian = Path::new("/etc/debian_version").exists();
    if debian && (has_core(Path::new(DEBIAN_SYSROOT)) || is_root()) {
        return debian_toolchain();
    }
    active_toolchain()
}

/// The folder that cargo keeps its registry and its installed programs in.
pub(super) fn cargo_home() -> anyhow::Result<PathBuf> {
    let home = || env::var_os("HOME").map(|home| Path::new(&home).join(".cargo"));
    env::var_os("CARGO_HOME")
        .map(PathBuf::from)
        .or_else(home)
        .context("neither CARGO_HOME nor HOME is set")
}

fn debian_toolchain() -> anyhow::Result<Toolchain> {
    if !has_core(Path::new(DEBIAN_SYSROOT)) || !Path::new(DEBIAN_RUSTC).exists() {
        install_packages(&["rustc-web", "rust-web-src"])?;
    }
    let (rustc_version, llvm_major) = version(Path::new(DEBIAN_RUSTC))?;
    let llvm = PathBuf::from(format!("/usr/lib/llvm-{llvm_major}"));
    let linker_root =
        cargo_home()?.join(format!("bpf-linker-{BPF_LINKER_VERSION}-llvm-{llvm_major}"));
    let linker = linker_root.join("bin/bpf-linker");
    let strip = llvm.join("bin/llvm-strip");
    if !strip.exists() || (!linker.exists() && !llvm.join("include/llvm-c").exists()) {
        install_packages(&[&format!("llvm-{llvm_major}-dev")])?;
    }
    if !linker.exists() {
        install_linker(&linker_root, &llvm, llvm_major)?;
    }
    Ok(Toolchain {
        rustc: DEBIAN_RUSTC.into(),
        sysroot: Path::new(DEBIAN_SYSROOT).join("lib/rustlib/src/rust"),
        linker,
        strip,
        rustc_version,
        llvm_major,
    })
}

fn active_toolchain() -> anyhow::Result<Toolchain> {
    let rustc = PathBuf::from(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    let (rustc_version, llvm_major) = version(&rustc)?;
    let sysroot = output(Command::new(&rustc).args(["--print", "sysroot"]))?;
    let sysroot = PathBuf::from(sysroot.trim());
    ensure!(
        has_core(&sysroot),
        "the Rust tool chain has no sources of its standard library: \
         run `rustup component add rust-src`, or this command as root on Debian"
    );
    let found = |name: &str| on_path(name);
    let Some(linker) = found("bpf-linker") else {
        bail!(
            "bpf-linker is missing: run `cargo install bpf-linker --version {BPF_LINKER_VERSION}` \
             with an LLVM that is at least version {llvm_major}"
        );
    };
    let Some(strip) = found("llvm-strip").or_else(|| found(&format!("llvm-strip-{llvm_major}")))
    else {
        bail!("llvm-strip is missing: install the LLVM tools of your distribution");
    };
    Ok(Toolchain {
        rustc,
        sysroot: sysroot.join("lib/rustlib/src/rust"),
        linker,
        strip,
        rustc_version,
        llvm_major,
    })
}

fn install_packages(packages: &[&str]) -> anyhow::Result<()> {
    let list = packages.join(" ");
    ensure!(
        is_root(),
        "missing Debian packages: run `apt-get install {list}` as root, then this command again"
    );
    say(&format!("installing {list} with apt-get"));
    let apt = || {
        let mut command = Command::new("apt-get");
        command
            .env("DEBIAN_FRONTEND", "noninteractive")
            .arg("--quiet");
        command
    };
    execute(apt().arg("update"))?;
    execute(
        apt()
            .args(["install", "--yes", "--no-install-recommends"])
            .args(packages),
    )
    .with_context(|| format!("apt-get cannot install {list}"))
}

fn install_linker(root: &Path, llvm: &Path, llvm_major: u32) -> anyhow::Result<()> {
    say(&format!(
        "building bpf-linker {BPF_LINKER_VERSION} against LLVM {llvm_major}, once, in about a minute"
    ));
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .args(["install", "bpf-linker", "--locked"])
        .args(["--version", BPF_LINKER_VERSION, "--no-default-features"])
        .args(["--features", &format!("llvm-{llvm_major}")])
        .arg("--root")
        .arg(root)
        .env("LLVM_PREFIX", llvm)
        .env_remove("CARGO_TARGET_DIR");
    execute(&mut cargo).context("cannot install bpf-linker")
}

/// Whether the sources of `core` lie where `-Zbuild-std` looks for them.
fn has_core(sysroot: &Path) -> bool {
    sysroot
        .join("lib/rustlib/src/rust/library/core/Cargo.toml")
        .exists()
}

/// The compiler's version, and the major version of its LLVM.
fn version(rustc: &Path) -> anyhow::Result<(String, u32)> {
    let verbose = output(Command::new(rustc).arg("-vV"))?;
    let version = verbose.lines().next().unwrap_or_default().to_owned();
    let llvm = verbose
        .lines()
        .find_map(|line| line.strip_prefix("LLVM version: "))
        .and_then(|llvm| llvm.split('.').next()?.parse().ok())
        .with_context(|| format!("{} does not say which LLVM it uses", rustc.display()))?;
    Ok((version, llvm))
}

fn output(command: &mut Command) -> anyhow::Result<String> {
    let program = command.get_program().to_owned();
    let output = command
        .output()
        .with_context(|| format!("cannot run {}", program.display()))?;
    ensure!(output.status.success(), "{} failed", program.display());
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn on_path(name: &str) -> Option<PathBuf> {
    env::split_paths(&env::var_os("PATH")?)
        .map(|folder| folder.join(name))
        .find(|file| file.is_file())
}

/// Whether packages may be installed: the owner of our own /proc entry is who we are.
fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt as _;
    fs::metadata("/proc/self").is_ok_and(|metadata| metadata.uid() == 0)
}
