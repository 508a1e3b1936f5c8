//! Ends the layer of this network namespace, whatever state it is in.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, geteuid};

use crate::netns;
use crate::pins::PinFolder;
use crate::run_folder::RunFolder;

/// How long rtpsd may take to leave its domains.
const PATIENCE: Duration = Duration::from_secs(3);

/// What there was to end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Unloaded {
    /// The rtpsd that ran.
    pub rtpsd: Option<i32>,
    /// Whether it had to be killed.
    pub killed: bool,
    /// Whether it, or one that was killed before, had left anything behind.
    pub leftovers: bool,
}

/// Ends rtpsd with SIGTERM, or SIGKILL when it does not go within 3 s, and removes whatever is left: pins, and with
/// them attached programs, sockets and folders. The calling thread may end up in the mount namespace of process 1.
pub fn unload() -> Result<Unloaded> {
    if !geteuid().is_root() {
        bail!("unloading the kernel layer needs root");
    }
    netns::join_shared_mounts()?;
    let inode = netns::inode()?;
    let run_folder = RunFolder::of_namespace(inode);
    let mut unloaded = Unloaded::default();
    if let Some(pid) = run_folder.daemon()? {
        unloaded.rtpsd = Some(pid.as_raw());
        unloaded.killed = end(pid, &run_folder)?;
    }
    let pins = PinFolder::of_namespace(inode).remove()?;
    let files = run_folder.remove()?;
    unloaded.leftovers = pins || files;
    Ok(unloaded)
}

/// Says whether it took SIGKILL.
fn end(pid: Pid, run_folder: &RunFolder) -> Result<bool> {
    for signal in [Signal::SIGTERM, Signal::SIGKILL] {
        if run_folder.daemon()? != Some(pid) {
            return Ok(false);
        }
        kill(pid, signal).with_context(|| format!("cannot end rtpsd (pid {pid})"))?;
        if is_gone_within(pid, run_folder, PATIENCE)? {
            return Ok(signal == Signal::SIGKILL);
        }
    }
    bail!("rtpsd (pid {pid}) cannot be killed")
}

/// Its lock on the pid file tells.
fn is_gone_within(pid: Pid, run_folder: &RunFolder, patience: Duration) -> Result<bool> {
    let deadline = Instant::now() + patience;
    while run_folder.daemon()? == Some(pid) {
        if Instant::now() >= deadline {
            return Ok(false);
        }
        thread::sleep(Duration::from_millis(10));
    }
    Ok(true)
}
