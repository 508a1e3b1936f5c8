//! The layer under the apps of a host; the kernel layer is rtpsd, started in a namespace and gone with the value.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use nix::sys::signal::Signal;
use rtpsd::Status;

use crate::netns::Netns;
use crate::process::Process;

/// Loading, self-tests and the first announcements take less.
const START: Duration = Duration::from_secs(60);
/// Disposing, detaching and unpinning take less.
const STOP: Duration = Duration::from_secs(30);

/// What the apps of a host stand on.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Layer {
    /// The kernel layer as it is by default: the kernel answers discovery.
    Kernel,
    /// The kernel layer with discovery left to rtpsd, and with XDP where it would not be chosen.
    UserDiscovery,
    /// The in-process layer.
    InProcess,
}

impl Layer {
    /// As RTPS_LAYER takes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Kernel | Self::UserDiscovery => "kernel",
            Self::InProcess => "in-process",
        }
    }

    /// The arguments that rtpsd needs for it; none where there is no rtpsd.
    #[must_use]
    pub fn daemon_arguments(self) -> Option<&'static [&'static str]> {
        match self {
            Self::Kernel => Some(&[]),
            Self::UserDiscovery => Some(&["--discovery", "user", "--mode", "native"]),
            Self::InProcess => None,
        }
    }
}

/// A running rtpsd. Dropping it stops it cleanly, so that nothing stays attached or pinned.
pub struct KernelLayer<'a> {
    netns: &'a Netns,
    process: Process,
}

impl<'a> KernelLayer<'a> {
    /// Starts rtpsd for one interface and waits until apps can connect.
    ///
    /// # Errors
    /// When it does not get ready, with what it printed.
    pub fn start(
        rtpsd: &Path,
        netns: &'a Netns,
        interface: &str,
        arguments: &[&str],
    ) -> Result<Self> {
        let mut command = netns.command(rtpsd);
        command
            .args(["--iface", interface, "--ready-fd", "1"])
            .args(arguments);
        let mut process = Process::spawn_to_end_by(
            Signal::SIGTERM,
            &format!("rtpsd of {}", netns.label()),
            &mut command,
        )?;
        process.wait_line("ready", START)?;
        Ok(Self { netns, process })
    }

    /// The running process.
    pub fn process(&mut self) -> &mut Process {
        &mut self.process
    }

    /// What `cargo xtask status --json` prints.
    ///
    /// # Errors
    /// When rtpsd does not answer.
    pub fn status(&self) -> Result<Status> {
        self.netns
            .enter(rtpsd::status)
            .context("asking rtpsd for its status")
    }

    /// SIGKILL: what is pinned stays.
    ///
    /// # Errors
    /// When the process is gone already or does not end.
    pub fn kill(mut self) -> Result<()> {
        self.process.signal(Signal::SIGKILL)?;
        self.process.wait_exit(STOP)?;
        std::mem::forget(self);
        Ok(())
    }
}

impl Drop for KernelLayer<'_> {
    fn drop(&mut self) {
        // A test may have stopped it.
        let stopped = self
            .process
            .signal(Signal::SIGTERM)
            .and_then(|()| self.process.signal(Signal::SIGCONT))
            .and_then(|()| self.process.wait_exit(STOP).map(drop));
        let removed = self.netns.enter(rtpsd::unload).map(drop);
        if let Err(error) = stopped.and(removed) {
            eprintln!(
                "{}: the kernel layer was not removed: {error:#}",
                self.netns.label()
            );
        }
    }
}
