//! The hosts of a benchmark: some with a kernel layer, and as many without, so that the layer's programs on the interfaces
//! cost nobody else anything.

use anyhow::{Context, Result};
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::{Bridge, Host};
use rtps_tests::netns::Netns;
use rtps_tests::stage;

use super::programs::Programs;
use super::row::{Case, Stack};

/// The usual one.
const MTU: u16 = 1500;

/// See the module.
pub(super) struct Hosts {
    layered: Vec<Host>,
    bare: Vec<Host>,
    _hubs: Vec<Netns>,
}

/// Where the programs of an exchange are.
#[derive(Clone, Copy)]
pub(super) struct Sides<'a> {
    /// The host of the program that starts it.
    pub(super) active: &'a Host,
    /// The hosts of the others, one of them on each.
    pub(super) passive: &'a [Host],
}

impl Sides<'_> {
    /// The same with one other program, on the host of the first.
    pub(super) fn on_one_host(self) -> Self {
        Self {
            passive: std::slice::from_ref(self.active),
            ..self
        }
    }
}

impl Hosts {
    /// Two hosts joined by a veth pair, twice.
    pub(super) fn pair() -> Result<Self> {
        Ok(Self {
            layered: stage::hosts("layered")?.into(),
            bare: stage::hosts("bare")?.into(),
            _hubs: Vec::new(),
        })
    }

    /// So many hosts joined by a bridge, twice.
    pub(super) fn bridged(count: u8) -> Result<Self> {
        let layered = Bridge::new("layered", count, MTU)?;
        let bare = Bridge::new("bare", count, MTU)?;
        Ok(Self {
            layered: layered.hosts,
            bare: bare.hosts,
            _hubs: vec![layered.hub, bare.hub],
        })
    }

    /// The kernel layers if any of the cases needs them; they go when the value does.
    pub(super) fn load(&self, programs: &Programs, cases: &[Case]) -> Result<Vec<KernelLayer<'_>>> {
        if !cases.iter().any(|case| case.stack.is_on_kernel_layer()) {
            return Ok(Vec::new());
        }
        let (rtpsd, hosts) = (programs.rtpsd(), self.layered.iter());
        hosts
            .map(|host| KernelLayer::start(&rtpsd, &host.netns, &host.interface.name, &[]))
            .collect()
    }

    /// Where a stack is measured.
    pub(super) fn of(&self, stack: Stack) -> Result<Sides<'_>> {
        let hosts = match stack.is_on_kernel_layer() {
            true => &self.layered,
            false => &self.bare,
        };
        let (active, passive) = hosts.split_first().context("there are no hosts")?;
        Ok(Sides { active, passive })
    }
}
