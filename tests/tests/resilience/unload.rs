//! Loading and unloading by `cargo xtask`, and what is left afterwards: nothing.

use std::process::Command;

use anyhow::{Context, Result, ensure};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rtps_tests::layer::Layer;
use rtps_tests::netns::Netns;
use rtps_tests::stage::{Stage, eventually};
use rtps_tests::stream::{End, Stream};
use rtps_tests::{binaries, require, skip_unless};
use rtpsd::{PinFolder, RunFolder, Status};

/// Has the layer removed even when a test fails.
struct Guard<'a>(&'a Netns);

impl Drop for Guard<'_> {
    fn drop(&mut self) {
        if let Err(error) = self.0.enter(rtpsd::unload) {
            eprintln!("{}: {error:#}", self.0.label());
        }
    }
}

/// What `cargo xtask` printed, and whether it succeeded.
fn xtask(netns: &Netns, arguments: &str) -> Result<(bool, String)> {
    let mut command: Command =
        netns.command(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    let output = command
        .arg("xtask")
        .args(arguments.split_whitespace())
        .current_dir(binaries::workspace())
        .output()
        .context("cargo could not be started")?;
    let text = [output.stdout, output.stderr].concat();
    Ok((
        output.status.success(),
        String::from_utf8_lossy(&text).into_owned(),
    ))
}

fn succeed(netns: &Netns, arguments: &str) -> Result<String> {
    let (is_success, text) = xtask(netns, arguments)?;
    ensure!(is_success, "cargo xtask {arguments}:\n{text}");
    Ok(text)
}

fn status(netns: &Netns) -> Result<Status> {
    let text = succeed(netns, "status --json")?;
    serde_json::from_str(&text).with_context(|| text)
}

fn kill_rtpsd(netns: &Netns) -> Result<()> {
    let pid = status(netns)?.rtpsd.context("rtpsd does not run")?;
    kill(Pid::from_raw(pid), Signal::SIGKILL)?;
    eventually("rtpsd is gone", || {
        Ok(status(netns)?.rtpsd.is_none().then_some(()))
    })
}

/// Neither attached, nor pinned, nor running.
fn is_clean(netns: &Netns) -> Result<()> {
    let inode = netns.inode()?;
    let links = netns
        .command("ip")
        .args(["-details", "link", "show"])
        .output()?;
    let links = String::from_utf8(links.stdout)?;
    ensure!(!links.contains("xdp"), "{links}");
    let pins = PinFolder::of_namespace(inode);
    ensure!(!pins.path().exists(), "{} is left", pins.path().display());
    let run = RunFolder::of_namespace(inode);
    ensure!(!run.layer_socket().exists() && run.daemon()?.is_none());
    let status = status(netns)?;
    ensure!(!status.loaded && status.rtpsd.is_none(), "{status:?}");
    Ok(())
}

#[test]
fn nothing_is_left_after_a_clean_stop_or_a_kill() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("unload")?;
    let netns = &stage.ours.netns;
    let _guard = Guard(netns);
    let load = format!("load --iface {}", stage.ours.interface.name);
    is_clean(netns)?;
    succeed(netns, &load)?;
    succeed(netns, "unload")?;
    is_clean(netns)?;
    succeed(netns, &load)?;
    kill_rtpsd(netns)?;
    ensure!(status(netns)?.loaded, "the pins went with rtpsd");
    succeed(netns, "unload")?;
    is_clean(netns)?;
    // There is nothing to do, and that is no error.
    succeed(netns, "unload").map(drop)
}

#[test]
fn a_second_load_is_refused_and_one_after_a_kill_takes_over() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("load")?;
    let netns = &stage.ours.netns;
    let _guard = Guard(netns);
    let load = format!("load --iface {}", stage.ours.interface.name);
    succeed(netns, &load)?;
    let first = status(netns)?;
    let (is_success, text) = xtask(netns, &load)?;
    let pid = first.rtpsd.context("rtpsd does not run")?.to_string();
    ensure!(
        !is_success && text.contains(&pid) && text.contains("unload"),
        "{text}"
    );
    let ends = (End::Cyclone, End::Ours(Layer::Kernel));
    Stream::start(&stage, "Square", ends, 100)?.finish()?;
    kill_rtpsd(netns)?;
    succeed(netns, &load)?;
    let second = status(netns)?;
    let [before, after] = [&first, &second].map(|status| &status.domains[0]);
    ensure!(before.prefix == after.prefix && before.participant_id == after.participant_id);
    ensure!(after.incarnation == before.incarnation + 1);
    Stream::start(&stage, "Circle", ends, 100)?.finish()?;
    succeed(netns, "unload")?;
    is_clean(netns)
}
