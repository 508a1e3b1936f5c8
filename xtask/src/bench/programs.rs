//! The programs of all stacks, and how each is told what to do.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use clap::ValueEnum;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::Pid;
use rtps_tests::binaries::{self, Binaries};
use rtps_tests::debian::{self, Package};
use rtps_tests::link::Host;
use rtps_tests::netns::Identity;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;

use super::program::{Dialect, Program, Role, WARM_UP};
use super::row::{Case, Stack};

/// Longer than samples ever keep apart: whoever spins never sleeps.
const SPIN_US: &str = "1000000";
/// So that the sockets of both ends of an exchange on one host differ.
const UDP_PORT: u16 = 9000;
/// Data to many readers goes to each of them, as ours does.
const CYCLONE_UNICAST: &str = "<General><AllowMulticast>spdp</AllowMulticast></General>";

/// See the module.
pub(super) struct Programs {
    binaries: Binaries,
    /// This program, which is also the raw UDP ends.
    this: PathBuf,
    fast_dds: Option<Peer>,
    rust_dds: Option<Peer>,
}

/// What one program has to do.
pub(super) struct Part<'a> {
    pub(super) case: &'a Case,
    pub(super) role: Role,
    /// Samples a second that are written; `None`: as many as can be.
    pub(super) rate: Option<u32>,
    pub(super) host: &'a Host,
    /// Where the programs of the other side are.
    pub(super) others: &'a [Host],
}

impl Programs {
    /// Builds what is not up to date, and leaves out the cases of stacks that cannot be had here, saying so on standard
    /// error.
    pub(super) fn for_cases(cases: &mut Vec<Case>) -> Result<Self> {
        let mut programs = Self {
            binaries: binaries::build()?,
            this: std::env::current_exe()?,
            fast_dds: None,
            rust_dds: None,
        };
        for stack in Stack::value_variants() {
            let is_wanted = cases.iter().any(|case| case.stack == *stack);
            if let Some(Err(error)) = is_wanted.then(|| programs.require(*stack)) {
                eprintln!("{} is left out: {error:#}", stack.name());
                cases.retain(|case| case.stack != *stack);
            }
        }
        Ok(programs)
    }

    /// This program.
    pub(super) fn this(&self) -> &Path {
        &self.this
    }

    /// The control process of the kernel layer.
    pub(super) fn rtpsd(&self) -> PathBuf {
        self.binaries.rtpsd()
    }

    fn require(&mut self, stack: Stack) -> Result<()> {
        const DDSPERF: Package = Package::new("cyclonedds-tools", "/usr/bin/ddsperf");
        match stack {
            Stack::Kernel | Stack::KernelSpin | Stack::InProcess | Stack::Udp | Stack::UdpSpin => {
                Ok(())
            }
            Stack::Cyclone => debian::ensure_installed(&[DDSPERF]),
            Stack::Fastdds => {
                self.fast_dds = Some(peers::fast_dds_perf()?);
                Ok(())
            }
            Stack::Rustdds => {
                self.rust_dds = Some(peers::rust_dds_perf()?);
                Ok(())
            }
        }
    }

    /// Starts a program on the CPUs that its case allows.
    pub(super) fn start(&self, part: &Part<'_>) -> Result<Program> {
        let (mut command, dialect) = match part.case.stack {
            Stack::Kernel | Stack::KernelSpin | Stack::InProcess => {
                (self.ours(part)?, Dialect::Json)
            }
            Stack::Udp | Stack::UdpSpin => (self.udp(part), Dialect::Json),
            Stack::Cyclone => (cyclone(part), Dialect::Ddsperf),
            Stack::Fastdds => (self.fast_dds(part)?, Dialect::Json),
            Stack::Rustdds => (self.rust_dds(part)?, Dialect::Json),
        };
        let label = format!("{} {}", part.case.stack.name(), part.role.name());
        let process = pinned(part.cpu(), || Process::spawn(&label, &mut command))??;
        Ok(Program::new(process, part.role, dialect))
    }

    /// As a user without any rights.
    fn ours(&self, part: &Part<'_>) -> Result<Command> {
        let stack = part.case.stack;
        let netns = &part.host.netns;
        let mut command = netns.command_as(Identity::NOBODY, &self.binaries.rtps())?;
        command
            .args(["perf", part.role.name(), "--json", "--layer", stack.layer()])
            .args(part.common_arguments());
        if stack == Stack::KernelSpin {
            command.env("RTPS_BUSY_POLL_US", SPIN_US);
        }
        command.args(part.peers());
        Ok(command)
    }

    fn fast_dds(&self, part: &Part<'_>) -> Result<Command> {
        let peer = self.fast_dds.as_ref().context("Fast DDS is missing")?;
        let Host { netns, interface } = part.host;
        let mut command = peer.command(netns, interface, part.role.name());
        command.args(part.common_arguments()).args(part.peers());
        if !part.is_active() {
            command.args(part.size());
        }
        Ok(command)
    }

    fn rust_dds(&self, part: &Part<'_>) -> Result<Command> {
        let peer = self.rust_dds.as_ref().context("RustDDS is missing")?;
        let Host { netns, interface } = part.host;
        let mut command = peer.command(netns, interface, part.role.name());
        command.args(part.common_arguments()).args(part.peers());
        Ok(command)
    }

    fn udp(&self, part: &Part<'_>) -> Command {
        let [own, other] = match part.is_active() {
            true => [UDP_PORT, UDP_PORT + 1],
            false => [UDP_PORT + 1, UDP_PORT],
        };
        let mut command = part.host.netns.command(&self.this);
        command
            .args(["bench", "udp-end", part.role.name()])
            .args(["--port", &own.to_string()])
            .args(part.common_arguments());
        for host in part.others {
            // What stays on a host goes through `lo` by its address.
            let address = match host.interface == part.host.interface {
                true => Ipv4Addr::LOCALHOST,
                false => host.interface.v4,
            };
            let other = SocketAddr::from((address, other));
            command.args(["--other", &other.to_string()]);
        }
        if part.case.stack == Stack::UdpSpin {
            command.arg("--spin");
        }
        command
    }
}

impl Part<'_> {
    fn is_active(&self) -> bool {
        matches!(self.role, Role::Ping | Role::Publish)
    }

    fn cpu(&self) -> Option<usize> {
        match self.is_active() {
            true => self.case.pinning.of_active(),
            false => self.case.pinning.of_passive(),
        }
    }

    /// Those of all programs that answer in JSON.
    fn common_arguments(&self) -> Vec<String> {
        let mut arguments = Vec::new();
        if self.is_active() {
            arguments.extend(self.size());
        }
        if let Some(rate) = self.rate.filter(|_| self.role == Role::Publish) {
            // As ddsperf does it: each millisecond what is due.
            let burst = rate.div_ceil(1000).max(1);
            arguments.extend(["--burst".to_owned(), burst.to_string()]);
            let bursts = f64::from(rate) / f64::from(burst);
            arguments.extend(["--rate".to_owned(), bursts.to_string()]);
        }
        if matches!(self.role, Role::Ping | Role::Subscribe) {
            arguments.extend(["--warm-up".to_owned(), WARM_UP.as_secs_f64().to_string()]);
        }
        arguments
    }

    fn size(&self) -> [String; 2] {
        ["--size".to_owned(), self.case.size.to_string()]
    }

    /// How many readers a writer waits for.
    fn peers(&self) -> Vec<String> {
        match self.role {
            Role::Publish => vec!["--peers".to_owned(), self.others.len().to_string()],
            Role::Ping | Role::Pong | Role::Subscribe => Vec::new(),
        }
    }
}

fn cyclone(part: &Part<'_>) -> Command {
    let mut command = part.host.netns.command("ddsperf");
    command.arg(part.role.name());
    if let Some(rate) = part.rate.filter(|_| part.role == Role::Publish) {
        command.arg(format!("{rate}Hz"));
    }
    if part.is_active() {
        command.args(["size", &part.case.size.to_string()]);
    }
    if part.case.readers > 1 {
        command.env("CYCLONEDDS_URI", CYCLONE_UNICAST);
    }
    command
}

/// Lets `spawn` start a child that stays on a CPU: children and new threads inherit it.
fn pinned<T>(cpu: Option<usize>, spawn: impl FnOnce() -> T) -> Result<T> {
    let this_thread = Pid::from_raw(0);
    let usual = sched_getaffinity(this_thread)?;
    if let Some(cpu) = cpu {
        let mut one = CpuSet::new();
        one.set(cpu)?;
        sched_setaffinity(this_thread, &one).with_context(|| format!("there is no CPU {cpu}"))?;
    }
    let spawned = spawn();
    sched_setaffinity(this_thread, &usual)?;
    Ok(spawned)
}
