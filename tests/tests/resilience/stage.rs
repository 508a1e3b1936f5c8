//! Two hosts joined by a veth pair, and the programs that run on them.

use std::net::Ipv4Addr;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use rtps_tests::binaries::{self, Binaries};
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::{Host, Veth};
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtpsd::Status;

/// Longer than anything takes on a busy machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// Which layer an app is told to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layer {
    Kernel,
    InProcess,
}

impl Layer {
    fn name(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::InProcess => "in-process",
        }
    }
}

/// See the module.
pub(crate) struct Stage {
    pub(crate) ours: Host,
    pub(crate) theirs: Host,
    binaries: Binaries,
    cyclone: Peer,
}

impl Stage {
    pub(crate) fn new(label: &str) -> Result<Self> {
        let (binaries, cyclone) = (binaries::build()?, peers::cyclone()?);
        let ours = Netns::new(&format!("{label}-ours"))?;
        let theirs = Netns::new(&format!("{label}-theirs"))?;
        let [a, b] = [1, 2].map(|host| Ipv4Addr::new(10, 1, 0, host));
        let veth = Veth::between(&ours, &theirs, a, b, 1500)?;
        Ok(Self {
            ours: Host {
                netns: ours,
                interface: veth.a,
            },
            theirs: Host {
                netns: theirs,
                interface: veth.b,
            },
            binaries,
            cyclone,
        })
    }

    /// Starts the kernel layer of a host.
    pub(crate) fn load<'a>(&self, host: &'a Host) -> Result<KernelLayer<'a>> {
        KernelLayer::start(
            &self.binaries.rtpsd(),
            &host.netns,
            &host.interface.name,
            &[],
        )
    }

    /// Starts the shapes example of ours, unprivileged.
    pub(crate) fn app(&self, host: &Host, layer: Layer, arguments: &str) -> Result<Process> {
        self.example(host, layer, "shapes", arguments)
    }

    /// Starts an example of ours, unprivileged.
    pub(crate) fn example(
        &self,
        host: &Host,
        layer: Layer,
        name: &str,
        arguments: &str,
    ) -> Result<Process> {
        let program: &Path = &self.binaries.example(name);
        let mut command = host.netns.command_as(Identity::NOBODY, program)?;
        command
            .args(arguments.split_whitespace())
            .env("RTPS_LAYER", layer.name());
        Process::spawn(&format!("{name} {arguments}"), &mut command)
    }

    /// Starts Cyclone DDS on the other host.
    pub(crate) fn cyclone(&self, arguments: &str) -> Result<Process> {
        let Host { netns, interface } = &self.theirs;
        Process::spawn(
            &format!("cyclone {arguments}"),
            &mut self.cyclone.command(netns, interface, arguments),
        )
    }
}

/// Waits until `look` finds something.
pub(crate) fn eventually<T>(what: &str, mut look: impl FnMut() -> Result<Option<T>>) -> Result<T> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look()? {
            return Ok(found);
        }
        if Instant::now() >= deadline {
            bail!("not within {PATIENCE:?}: {what}");
        }
        thread::sleep(Duration::from_millis(20));
    }
}

/// A counter's value, all interfaces added up.
pub(crate) fn counter(status: &Status, name: &str) -> u64 {
    let interfaces = status.counters.values();
    interfaces.filter_map(|counters| counters.get(name)).sum()
}
