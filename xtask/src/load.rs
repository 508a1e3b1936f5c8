//! `cargo xtask load`: starts rtpsd in the background and returns when apps can connect.
//!
//! An rtpsd that was killed is replaced: the new one takes over what is in the kernel.

use std::fs::File;
use std::io::Read;
use std::os::fd::AsFd;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::unistd::{geteuid, pipe};
use rtpsd::{Options, RunFolder};

use rtps_tests::binaries;

use crate::status;

/// How long rtpsd may take to get ready.
const READY: Duration = Duration::from_secs(30);

/// Starts rtpsd with the options that this command was given.
pub(crate) fn run(_options: &Options) -> Result<()> {
    if !geteuid().is_root() {
        bail!(
            "loading the kernel layer needs root; without it apps use the in-process layer by themselves"
        );
    }
    let binaries = binaries::build()?;
    let run_folder = RunFolder::of_namespace(rtpsd::network_namespace()?);
    if let Some(pid) = run_folder.daemon()? {
        bail!(
            "rtpsd (pid {pid}) serves this network namespace already; `cargo xtask unload` ends it"
        );
    }
    let log_path = std::env::temp_dir().join(format!("rtpsd-{}.log", rtpsd::network_namespace()?));
    let log = File::create(&log_path)
        .with_context(|| format!("{} cannot be written", log_path.display()))?;
    let (ready, started) = pipe().context("no pipe could be made")?;
    // The options have been parsed to refuse wrong ones early; rtpsd gets them as they were typed.
    let typed = std::env::args_os()
        .skip_while(|argument| argument != "load")
        .skip(1);
    let mut command = Command::new("setsid");
    command
        .arg(binaries.rtpsd())
        .args(typed)
        .arg("--ready-fd")
        .arg("1");
    command
        .stdin(Stdio::null())
        .stdout(started)
        .stderr(log)
        .current_dir("/");
    command
        .spawn()
        .context("setsid (Debian: util-linux) could not be started")?;
    drop(command);
    wait_until_ready(File::from(ready))
        .with_context(|| format!("rtpsd did not start; its log is {}", log_path.display()))?;
    status::run(false)
}

/// rtpsd writes a line when it is ready; when it ends, the pipe does.
fn wait_until_ready(mut ready: File) -> Result<()> {
    let mut fds = [PollFd::new(ready.as_fd(), PollFlags::POLLIN)];
    let timeout = PollTimeout::try_from(READY).context("the time to get ready is too long")?;
    if poll(&mut fds, timeout)? == 0 {
        bail!("not ready after {READY:?}");
    }
    let mut line = [0; 64];
    match ready.read(&mut line)? {
        0 => bail!("it ended"),
        _ => Ok(()),
    }
}
