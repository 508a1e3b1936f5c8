//! Where a scenario plays: two hosts joined by a link, each with a layer of ours or with other vendors' programs.

use anyhow::Result;
use rtps_tests::ddsperf;
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::{self, Interface};
use rtps_tests::loss::{Direction, Loss, Lossy};
use rtps_tests::netns::Netns;
use rtps_tests::peers::Peer;
use rtps_tests::process::Process;
use rtps_tests::stage::{self, binaries};

/// Two hosts joined by a veth pair of the usual MTU.
pub(crate) struct Stage {
    near: link::Host,
    far: link::Host,
}

impl Stage {
    pub(crate) fn new(label: &str) -> Result<Self> {
        // Whoever is started first must not wait for a build.
        binaries()?;
        let [near, far] = stage::hosts(label)?;
        Ok(Self { near, far })
    }

    /// Both hosts, to prepare them before anything runs there.
    pub(crate) fn hosts(&self) -> [&link::Host; 2] {
        [&self.near, &self.far]
    }

    /// The host that every scenario puts apps of ours on; their layer is started.
    pub(crate) fn near(&self, layer: Layer) -> Result<Host<'_>> {
        Host::new(&self.near, layer, &[])
    }

    /// As [`Stage::near`], with arguments for rtpsd where there is one.
    pub(crate) fn near_with(&self, layer: Layer, arguments: &[&str]) -> Result<Host<'_>> {
        Host::new(&self.near, layer, arguments)
    }

    /// The other host, with apps of ours.
    pub(crate) fn far(&self, layer: Layer) -> Result<Host<'_>> {
        Host::new(&self.far, layer, &[])
    }

    /// Starts another vendor's program on the other host.
    pub(crate) fn peer(&self, peer: &Peer, arguments: &str) -> Result<Process> {
        stage::spawn_peer(&self.far.netns, &self.far.interface, peer, arguments)
    }

    /// Starts ddsperf on the other host.
    pub(crate) fn ddsperf(&self, arguments: &str) -> Result<Process> {
        ddsperf::spawn(&self.far.netns, arguments)
    }

    /// Loses packets in both directions while the value lives: at the sender's end, because XDP would take them off the
    /// link before a program at the receiver's end could lose them.
    pub(crate) fn lose(&self, loss: Loss) -> Result<[Lossy; 2]> {
        Ok([
            Lossy::attach(
                &self.near.netns,
                &self.near.interface,
                Direction::Egress,
                loss,
            )?,
            Lossy::attach(
                &self.far.netns,
                &self.far.interface,
                Direction::Egress,
                loss,
            )?,
        ])
    }
}

/// A host of a stage that apps of ours run on.
pub(crate) struct Host<'a> {
    host: &'a link::Host,
    layer: Layer,
    daemon: Option<KernelLayer<'a>>,
}

impl<'a> Host<'a> {
    pub(crate) fn new(host: &'a link::Host, layer: Layer, arguments: &[&str]) -> Result<Self> {
        let start = |of_layer: &[&str]| {
            let rtpsd = binaries()?.rtpsd();
            let arguments = [of_layer, arguments].concat();
            KernelLayer::start(&rtpsd, &host.netns, &host.interface.name, &arguments)
        };
        Ok(Self {
            host,
            layer,
            daemon: layer.daemon_arguments().map(start).transpose()?,
        })
    }

    /// Starts an app of ours, which takes the peers' arguments, as a user without any rights.
    pub(crate) fn app(&self, arguments: &str) -> Result<Process> {
        stage::spawn_app(&self.host.netns, self.layer, "shapes", arguments)
    }

    /// Starts the example of a publisher, whose type is described, as [`Host::app`].
    pub(crate) fn greeter(&self) -> Result<Process> {
        stage::spawn_app(&self.host.netns, self.layer, "hello_publisher", "")
    }

    /// Starts `rtps perf`, which prints JSON, as [`Host::app`].
    pub(crate) fn perf(&self, arguments: &str) -> Result<Process> {
        let arguments = format!("perf {arguments} --json");
        stage::spawn_rtps(&self.host.netns, self.layer, &arguments)
    }

    /// Starts another vendor's program on this same host.
    pub(crate) fn peer(&self, peer: &Peer, arguments: &str) -> Result<Process> {
        stage::spawn_peer(&self.host.netns, &self.host.interface, peer, arguments)
    }

    pub(crate) fn netns(&self) -> &Netns {
        &self.host.netns
    }

    pub(crate) fn interface(&self) -> &Interface {
        &self.host.interface
    }

    /// rtpsd, on the kernel layer.
    pub(crate) fn daemon(&mut self) -> Option<&mut KernelLayer<'a>> {
        self.daemon.as_mut()
    }
}
