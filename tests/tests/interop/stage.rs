//! Where a scenario plays: two hosts joined by a link, each with a layer of ours or with other vendors' programs.

use std::net::Ipv4Addr;
use std::sync::LazyLock;

use anyhow::{Result, anyhow};
use rtps_tests::binaries::{self, Binaries};
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::{Interface, Veth};
use rtps_tests::loss::{Direction, Loss, Lossy};
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::peers::Peer;
use rtps_tests::process::Process;

/// What our apps of a host stand on.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Layer {
    Kernel,
    InProcess,
}

impl Layer {
    /// As RTPS_LAYER takes it.
    fn name(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::InProcess => "in-process",
        }
    }
}

/// Two hosts joined by a veth pair of the usual MTU.
pub(crate) struct Stage {
    near: Netns,
    far: Netns,
    veth: Veth,
}

impl Stage {
    pub(crate) fn new(label: &str) -> Result<Self> {
        // Whoever is started first must not wait for a build.
        binaries()?;
        let near = Netns::new(&format!("{label}-near"))?;
        let far = Netns::new(&format!("{label}-far"))?;
        let [from, to] = [1, 2].map(|host| Ipv4Addr::new(10, 1, 0, host));
        let veth = Veth::between(&near, &far, from, to, 1500)?;
        Ok(Self { near, far, veth })
    }

    /// The host that every scenario puts apps of ours on; their layer is started.
    pub(crate) fn near(&self, layer: Layer) -> Result<Host<'_>> {
        Host::new(&self.near, &self.veth.a, layer, &[])
    }

    /// As [`Stage::near`], with arguments for rtpsd where there is one.
    pub(crate) fn near_with(&self, layer: Layer, arguments: &[&str]) -> Result<Host<'_>> {
        Host::new(&self.near, &self.veth.a, layer, arguments)
    }

    /// The other host, with apps of ours.
    pub(crate) fn far(&self, layer: Layer) -> Result<Host<'_>> {
        Host::new(&self.far, &self.veth.b, layer, &[])
    }

    /// Starts another vendor's program on the other host.
    pub(crate) fn peer(&self, peer: &Peer, arguments: &str) -> Result<Process> {
        spawn_peer(&self.far, &self.veth.b, peer, arguments)
    }

    /// Loses packets in both directions while the value lives: at the sender's end, because XDP would take them off the
    /// link before a program at the receiver's end could lose them.
    pub(crate) fn lose(&self, loss: Loss) -> Result<[Lossy; 2]> {
        Ok([
            Lossy::attach(&self.near, &self.veth.a, Direction::Egress, loss)?,
            Lossy::attach(&self.far, &self.veth.b, Direction::Egress, loss)?,
        ])
    }
}

/// A host of a stage that apps of ours run on.
pub(crate) struct Host<'a> {
    netns: &'a Netns,
    interface: &'a Interface,
    layer: Layer,
    daemon: Option<KernelLayer<'a>>,
}

impl<'a> Host<'a> {
    fn new(
        netns: &'a Netns,
        interface: &'a Interface,
        layer: Layer,
        arguments: &[&str],
    ) -> Result<Self> {
        let daemon = match layer {
            Layer::Kernel => {
                let rtpsd = binaries()?.rtpsd();
                Some(KernelLayer::start(
                    &rtpsd,
                    netns,
                    &interface.name,
                    arguments,
                )?)
            }
            Layer::InProcess => None,
        };
        Ok(Self {
            netns,
            interface,
            layer,
            daemon,
        })
    }

    /// Starts an app of ours, which takes the peers' arguments, as a user without any rights.
    pub(crate) fn app(&self, arguments: &str) -> Result<Process> {
        let program = binaries()?.example("shapes");
        let mut command = self.netns.command_as(Identity::NOBODY, &program)?;
        command
            .args(arguments.split_whitespace())
            .env("RTPS_LAYER", self.layer.name());
        let label = format!("app on the {} layer: {arguments}", self.layer.name());
        Process::spawn(&label, &mut command)
    }

    /// Starts another vendor's program on this same host.
    pub(crate) fn peer(&self, peer: &Peer, arguments: &str) -> Result<Process> {
        spawn_peer(self.netns, self.interface, peer, arguments)
    }

    pub(crate) fn netns(&self) -> &Netns {
        self.netns
    }

    pub(crate) fn interface(&self) -> &Interface {
        self.interface
    }

    /// rtpsd, on the kernel layer.
    pub(crate) fn daemon(&mut self) -> Option<&mut KernelLayer<'a>> {
        self.daemon.as_mut()
    }
}

fn spawn_peer(
    netns: &Netns,
    interface: &Interface,
    peer: &Peer,
    arguments: &str,
) -> Result<Process> {
    let label = format!("{}: {arguments}", peer.name());
    Process::spawn(&label, &mut peer.command(netns, interface, arguments))
}

/// Built once for all scenarios.
fn binaries() -> Result<&'static Binaries> {
    static BUILT: LazyLock<Result<Binaries, String>> =
        LazyLock::new(|| binaries::build().map_err(|error| format!("{error:#}")));
    BUILT.as_ref().map_err(|error| anyhow!("{error}"))
}
