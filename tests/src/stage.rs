//! Two hosts joined by a veth pair, and the programs that run on them.

use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::LazyLock;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use rtpsd::Status;

use crate::binaries::{self, Binaries};
use crate::layer::{KernelLayer, Layer};
use crate::link::{Host, Interface, Veth};
use crate::netns::{Identity, Netns};
use crate::peers::{self, Peer};
use crate::process::Process;

/// Longer than anything takes on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// See the module.
pub struct Stage {
    /// The host that is tested, 10.1.0.1.
    pub ours: Host,
    /// The host that others are on, 10.1.0.2.
    pub theirs: Host,
    cyclone: Peer,
}

impl Stage {
    /// Joins two hosts by a link of the usual MTU, and builds what will run on them.
    ///
    /// # Errors
    /// Without root, or when a program cannot be built.
    pub fn new(label: &str) -> Result<Self> {
        binaries()?;
        let cyclone = peers::cyclone()?;
        let [ours, theirs] = hosts(label)?;
        Ok(Self {
            ours,
            theirs,
            cyclone,
        })
    }

    /// Starts the kernel layer of a host.
    ///
    /// # Errors
    /// As [`KernelLayer::start`].
    pub fn load<'a>(&self, host: &'a Host) -> Result<KernelLayer<'a>> {
        self.load_with(host, "")
    }

    /// As [`Stage::load`], with arguments for rtpsd separated by spaces.
    ///
    /// # Errors
    /// As [`KernelLayer::start`].
    pub fn load_with<'a>(&self, host: &'a Host, arguments: &str) -> Result<KernelLayer<'a>> {
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        let rtpsd = binaries()?.rtpsd();
        KernelLayer::start(&rtpsd, &host.netns, &host.interface.name, &arguments)
    }

    /// Starts the shapes example of ours, unprivileged.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn app(&self, host: &Host, layer: Layer, arguments: &str) -> Result<Process> {
        spawn_app(&host.netns, layer, "shapes", arguments)
    }

    /// Starts Cyclone DDS on the other host.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn cyclone(&self, arguments: &str) -> Result<Process> {
        self.cyclone_on(&self.theirs, arguments)
    }

    /// Starts Cyclone DDS on a host.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn cyclone_on(&self, host: &Host, arguments: &str) -> Result<Process> {
        spawn_peer(&host.netns, &host.interface, &self.cyclone, arguments)
    }
}

/// Two hosts joined by a veth pair of the usual MTU: 10.1.0.1 and 10.1.0.2.
///
/// # Errors
/// Without root.
pub fn hosts(label: &str) -> Result<[Host; 2]> {
    let near = Netns::new(&format!("{label}-1"))?;
    let far = Netns::new(&format!("{label}-2"))?;
    let [from, to] = [1, 2].map(|host| Ipv4Addr::new(10, 1, 0, host));
    let veth = Veth::between(&near, &far, from, to, 1500)?;
    let near = Host {
        netns: near,
        interface: veth.a,
    };
    let far = Host {
        netns: far,
        interface: veth.b,
    };
    Ok([near, far])
}

/// Starts an example of ours as a user without any rights, with arguments separated by spaces.
///
/// # Errors
/// When it cannot be started.
pub fn spawn_app(netns: &Netns, layer: Layer, example: &str, arguments: &str) -> Result<Process> {
    spawn_ours(netns, layer, &binaries()?.example(example), arguments)
}

/// Starts `rtps`, as [`spawn_app`].
///
/// # Errors
/// When it cannot be started.
pub fn spawn_rtps(netns: &Netns, layer: Layer, arguments: &str) -> Result<Process> {
    spawn_ours(netns, layer, &binaries()?.rtps(), arguments)
}

fn spawn_ours(netns: &Netns, layer: Layer, program: &Path, arguments: &str) -> Result<Process> {
    let mut command = netns.command_as(Identity::NOBODY, program)?;
    command
        .args(arguments.split_whitespace())
        .env("RTPS_LAYER", layer.name());
    let name = program.file_name().unwrap_or_default().display();
    let label = format!("{name} on the {} layer: {arguments}", layer.name());
    Process::spawn(&label, &mut command)
}

/// Starts another vendor's program.
///
/// # Errors
/// When it cannot be started.
pub fn spawn_peer(
    netns: &Netns,
    interface: &Interface,
    peer: &Peer,
    arguments: &str,
) -> Result<Process> {
    let label = format!("{}: {arguments}", peer.name());
    Process::spawn(&label, &mut peer.command(netns, interface, arguments))
}

/// Built once for all tests of a program.
///
/// # Errors
/// When the build fails.
pub fn binaries() -> Result<&'static Binaries> {
    static BUILT: LazyLock<Result<Binaries, String>> =
        LazyLock::new(|| binaries::build().map_err(|error| format!("{error:#}")));
    BUILT.as_ref().map_err(|error| anyhow!("{error}"))
}

/// Waits until `look` finds something.
///
/// # Errors
/// Those of `look`, or when nothing was found within [`PATIENCE`].
pub fn eventually<T>(what: &str, mut look: impl FnMut() -> Result<Option<T>>) -> Result<T> {
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
#[must_use]
pub fn counter(status: &Status, name: &str) -> u64 {
    let interfaces = status.counters.values();
    interfaces.filter_map(|counters| counters.get(name)).sum()
}
