//! `cargo xtask build-ebpf`: the kernel programs, from `rtps-ebpf/src/bin/rtps` to the committed
//! `rtps-ebpf/rtps-ebpf.o`.
//!
//! Only this command needs a BPF tool chain, which it installs where it can; everything else
//! embeds the committed object. With `--check` it builds the object anew and compares.

mod provenance;
mod toolchain;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context as _, bail, ensure};
use clap::Args;
use rtps_tests::binaries;

use provenance::Provenance;
use toolchain::Toolchain;

const TARGET: &str = "bpfel-unknown-none";

/// Arguments of `build-ebpf`.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Do not touch the committed object; fail when it is not what the sources make.
    #[arg(long)]
    pub(crate) check: bool,
}

/// Builds the object, and commits it to the source tree or compares it.
pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let workspace = binaries::workspace();
    let toolchain = toolchain::find_or_install()?;
    say(&format!("building with {toolchain}"));
    let built = build(workspace, &toolchain)?;
    let committed = workspace.join("rtps-ebpf/rtps-ebpf.o");
    let provenance = Provenance::now(workspace, &toolchain)?;
    if arguments.check {
        return check(
            (&built, &provenance),
            (&committed, &Provenance::committed(workspace)?),
        );
    }
    provenance.write(workspace)?;
    if same(&built, &committed) {
        say("rtps-ebpf/rtps-ebpf.o is what it was");
        return Ok(());
    }
    fs::copy(&built, &committed).context("cannot write rtps-ebpf/rtps-ebpf.o")?;
    say("wrote rtps-ebpf/rtps-ebpf.o");
    Ok(())
}

/// Compiles, links and strips; returns where the object is.
fn build(workspace: &Path, toolchain: &Toolchain) -> anyhow::Result<PathBuf> {
    // A target folder of its own: the outer one may be locked by whoever runs this command.
    let folder = binaries::target_folder().join("ebpf");
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .current_dir(workspace)
        .args(["build", "--package", "rtps-ebpf", "--bin", "rtps"])
        .args(["--features", "programs", "--profile", "release"])
        .args(["--target", TARGET, "-Zbuild-std=core"])
        .arg("--target-dir")
        .arg(&folder)
        .args(profile())
        .env("RUSTC", &toolchain.rustc)
        // The flag that makes a stable compiler accept -Zbuild-std.
        .env("RUSTC_BOOTSTRAP", "1")
        .env("CARGO_ENCODED_RUSTFLAGS", rustflags(workspace, toolchain)?)
        .env_remove("RUSTC_WRAPPER")
        .env_remove("RUSTC_WORKSPACE_WRAPPER")
        .env_remove("RUSTFLAGS");
    execute(&mut cargo).context("the kernel programs do not build")?;

    let linked = folder.join(TARGET).join("release/rtps");
    let stripped = folder.join("rtps-ebpf.o");
    // DWARF is ten times the rest, and no loader reads it. BTF stays.
    let mut strip = Command::new(&toolchain.strip);
    strip
        .arg("--strip-debug")
        .arg("-o")
        .args([&stripped, &linked]);
    execute(&mut strip).context("cannot strip the object")?;
    Ok(stripped)
}

/// The release profile of the kernel programs, whatever the workspace's own says.
fn profile() -> impl Iterator<Item = String> {
    [
        // With more units functions are not inlined, and the stack limit of 512 bytes breaks.
        "codegen-units=1",
        "lto=true",
        "opt-level=3",
        // BTF is made from it.
        "debug=2",
        "panic=\"abort\"",
        "overflow-checks=false",
        "debug-assertions=false",
    ]
    .into_iter()
    .map(|setting| format!("--config=profile.release.{setting}"))
}

/// The flags, separated by 0x1f as cargo wants them. No path of this machine gets into the object.
fn rustflags(workspace: &Path, toolchain: &Toolchain) -> anyhow::Result<String> {
    let remap = |from: &Path, to: &str| format!("--remap-path-prefix={}={to}", from.display());
    let cargo_home = toolchain::cargo_home()?;
    Ok([
        format!("-Clinker={}", toolchain.linker.display()),
        "-Clink-arg=--btf".to_owned(),
        "-Cdebuginfo=2".to_owned(),
        // Returned values of atomic operations, and 32-bit jumps: kernels since 5.12.
        "-Ctarget-cpu=v3".to_owned(),
        // aya-ebpf asks for it, for the sake of tracing programs; ours do not depend on it.
        "--cfg=bpf_target_arch=\"x86_64\"".to_owned(),
        remap(&toolchain.sysroot, "/rust"),
        remap(&cargo_home, "/cargo"),
        remap(workspace, "/rtps"),
    ]
    .join("\x1f"))
}

/// Compares bytes where both objects come from one tool chain, else what they were made of.
fn check(built: (&Path, &Provenance), committed: (&Path, &Provenance)) -> anyhow::Result<()> {
    let same_toolchain = built.1.toolchain == committed.1.toolchain;
    if !same_toolchain {
        say(&format!(
            "the committed object was made with {}: comparing sources, not bytes",
            committed.1.toolchain
        ));
    }
    ensure!(
        built.1.same_sources(committed.1) && (!same_toolchain || same(built.0, committed.0)),
        "rtps-ebpf/rtps-ebpf.o is not what its sources make; run `cargo xtask build-ebpf` and commit what it writes"
    );
    say("rtps-ebpf/rtps-ebpf.o is what its sources make");
    Ok(())
}

fn same(a: &Path, b: &Path) -> bool {
    matches!((fs::read(a), fs::read(b)), (Ok(a), Ok(b)) if a == b)
}

/// Runs a command in sight of the user, and fails when it does.
fn execute(command: &mut Command) -> anyhow::Result<()> {
    let program = command.get_program().to_owned();
    let status = command
        .status()
        .with_context(|| format!("cannot run {}", program.display()))?;
    if !status.success() {
        bail!("{} failed ({status})", program.display());
    }
    Ok(())
}

/// Progress, on stderr: stdout belongs to results.
fn say(what: &str) {
    eprintln!("build-ebpf: {what}");
}
