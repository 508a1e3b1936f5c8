//! `rtps_xdp`, attached by XDP links.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};
use aya::Ebpf;
use aya::programs::links::{FdLink, PinnedLink};
use aya::programs::xdp::XdpLink;
use aya::programs::{Xdp, XdpMode};
use rtps_ebpf::abi::name;
use rtps_net::Interface;
use tracing::{info, warn};

use super::{Loader, innermost, program};
use crate::pins::Hook;

/// Who runs XDP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum XdpHook {
    /// The driver.
    Native,
    /// The network stack.
    Generic,
}

impl XdpHook {
    /// Its name in pins.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Generic => "generic",
        }
    }

    fn flags(self) -> XdpMode {
        match self {
            Self::Native => XdpMode::Driver,
            Self::Generic => XdpMode::Skb,
        }
    }
}

pub(super) fn load(ebpf: &mut Ebpf) -> Result<()> {
    xdp(ebpf)?
        .load()
        .context("the kernel's verifier refuses the XDP program")
}

fn xdp(ebpf: &mut Ebpf) -> Result<&mut Xdp> {
    program(ebpf, name::XDP_PROGRAM)
}

impl Loader {
    /// Detaches it from an interface; says whether it was there.
    pub(super) fn detach_xdp(&self, interface: &Interface) -> Result<bool> {
        self.detach_where(|index, hook| index == interface.index && matches!(hook, Hook::Xdp(_)))
    }

    /// Replaces the program on a pinned link; false when there is no such link, or its interface is gone.
    pub(super) fn take_over_xdp(&mut self, interface: &Interface, hook: XdpHook) -> bool {
        let Ok(pinned) = PinnedLink::from_pin(self.folder.link(interface.index, Hook::Xdp(hook)))
        else {
            return false;
        };
        match self.replace_xdp(pinned) {
            Ok(()) => {
                info!(
                    interface = interface.name,
                    mode = hook.name(),
                    "took over the attached XDP program"
                );
                true
            }
            Err(error) => {
                warn!(
                    interface = interface.name,
                    "the pinned XDP link is dead: {error:#}"
                );
                false
            }
        }
    }

    fn replace_xdp(&mut self, pinned: PinnedLink) -> Result<()> {
        let link = XdpLink::try_from(FdLink::from(pinned))?;
        let xdp = xdp(&mut self.ebpf)?;
        let id = xdp.attach_to_link(link)?;
        // Only the pin holds the link, so that removing the pin detaches.
        drop(FdLink::try_from(xdp.take_link(id)?)?);
        Ok(())
    }

    /// Attaches it to an interface, which may be occupied until `end` by what was just detached.
    pub(super) fn attach_xdp_until(
        &mut self,
        interface: &Interface,
        hook: XdpHook,
        end: Instant,
    ) -> Result<()> {
        loop {
            match self.attach_xdp(interface, hook) {
                Err(_) if Instant::now() < end => thread::sleep(Duration::from_millis(10)),
                result => return result,
            }
        }
    }

    fn attach_xdp(&mut self, interface: &Interface, hook: XdpHook) -> Result<()> {
        let path = self.folder.link(interface.index, Hook::Xdp(hook));
        let xdp = xdp(&mut self.ebpf)?;
        let id = xdp
            .attach_to_if_index(interface.index, hook.flags())
            .map_err(|error| anyhow!(innermost(&error)))?;
        let link = xdp.take_link(id)?;
        FdLink::try_from(link)
            .context("the kernel has no XDP links; Linux 5.19 or newer is needed")?
            .pin(path)
            .context("cannot pin the XDP link")?;
        Ok(())
    }
}
