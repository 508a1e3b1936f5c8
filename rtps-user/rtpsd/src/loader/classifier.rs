//! The tc programs, attached by tcx links: `rtps_ingress` on each interface decides on discovery messages and answers
//! them, and delivers to apps where XDP does not, `rtps_fan_out` on the loopback interface sends to several destinations what an app sends once.
//!
//! Each comes before other tc programs, which may end the chain.

use anyhow::{Context, Result};
use aya::Ebpf;
use aya::programs::links::{FdLink, LinkOrder, PinnedLink};
use aya::programs::tc::{SchedClassifierLink, TcAttachOptions};
use aya::programs::{SchedClassifier, TcAttachType};
use rtps_ebpf::abi::name;
use rtps_net::{Interface, LOOPBACK_INDEX};
use tracing::{info, warn};

use super::{Loader, innermost, program};
use crate::ethernet;
use crate::pins::Hook;
use crate::run_folder::remove_if_there;

/// The name of the loopback interface.
const LOOPBACK: &str = "lo";

/// Which of the kernel's refusals leave something to others.
pub(super) struct Classifiers {
    /// Whether it is loaded; else why the kernel cannot answer discovery messages anywhere.
    ingress: Result<(), String>,
    /// Whether it is loaded; else why apps send one by one.
    fan_out: Result<(), String>,
}

impl Classifiers {
    /// Loads them, as far as the kernel takes them.
    pub(super) fn load(ebpf: &mut Ebpf) -> Self {
        Self {
            ingress: load(ebpf, name::INGRESS_PROGRAM),
            fan_out: load(ebpf, name::FAN_OUT_PROGRAM),
        }
    }

    /// The names of those that are loaded.
    pub(super) fn loaded(&self) -> impl Iterator<Item = &'static str> {
        let ingress = self.ingress.is_ok().then_some(name::INGRESS_PROGRAM);
        let fan_out = self.fan_out.is_ok().then_some(name::FAN_OUT_PROGRAM);
        ingress.into_iter().chain(fan_out)
    }
}

/// The error is a sentence for the status.
fn load(ebpf: &mut Ebpf, name: &str) -> Result<(), String> {
    let loaded =
        program(ebpf, name).and_then(|classifier: &mut SchedClassifier| Ok(classifier.load()?));
    loaded.map_err(|error| {
        warn!("{error:#}");
        format!("the kernel refuses {name}")
    })
}

/// A program, and where it goes.
struct Place<'a> {
    program: &'static str,
    interface: &'a str,
    interface_index: u32,
    hook: Hook,
    direction: TcAttachType,
}

impl<'a> Place<'a> {
    fn ingress(interface: &'a Interface) -> Self {
        Self {
            program: name::INGRESS_PROGRAM,
            interface: &interface.name,
            interface_index: interface.index,
            hook: Hook::Ingress,
            direction: TcAttachType::Ingress,
        }
    }

    fn fan_out() -> Self {
        Self {
            program: name::FAN_OUT_PROGRAM,
            interface: LOOPBACK,
            interface_index: LOOPBACK_INDEX,
            hook: Hook::FanOut,
            direction: TcAttachType::Egress,
        }
    }
}

impl Loader {
    /// Attaches `rtps_ingress` to an interface, or replaces that of an earlier rtpsd there; the error is why that does
    /// not work.
    pub(crate) fn attach_classifier(&mut self, interface: &Interface) -> Result<(), String> {
        self.classifiers.ingress.clone()?;
        ethernet::describe(interface, 0)?;
        self.attach_at(&Place::ingress(interface))
    }

    /// Detaches it from an interface where it is.
    pub(crate) fn detach_classifier(&self, interface: &Interface) -> Result<()> {
        self.detach_where(|index, hook| index == interface.index && hook == Hook::Ingress)
            .map(drop)
    }

    /// Attaches `rtps_fan_out`, or replaces that of an earlier rtpsd; the error is why that does not work.
    pub(crate) fn attach_fan_out(&mut self) -> Result<(), String> {
        self.classifiers.fan_out.clone()?;
        self.attach_at(&Place::fan_out())
    }

    fn attach_at(&mut self, place: &Place<'_>) -> Result<(), String> {
        if self.take_over_at(place) {
            return Ok(());
        }
        self.attach_new_at(place)
            .map_err(|error| format!("tcx: {}", innermost(error.as_ref())))
    }

    /// False when there is no such link, or its interface is gone.
    fn take_over_at(&mut self, place: &Place<'_>) -> bool {
        let path = self.folder.link(place.interface_index, place.hook);
        let Ok(pinned) = PinnedLink::from_pin(path) else {
            return false;
        };
        let (program, interface) = (place.program, place.interface);
        match self.replace_at(place, pinned) {
            Ok(()) => {
                info!(interface, program, "took over the attached tc program");
                true
            }
            Err(error) => {
                warn!(interface, program, "the pinned tcx link is dead: {error:#}");
                false
            }
        }
    }

    fn replace_at(&mut self, place: &Place<'_>, pinned: PinnedLink) -> Result<()> {
        let link = SchedClassifierLink::try_from(FdLink::from(pinned))?;
        let classifier: &mut SchedClassifier = program(&mut self.ebpf, place.program)?;
        let id = classifier.attach_to_link(link)?;
        // Only the pin holds the link, so that removing the pin detaches.
        drop(FdLink::try_from(classifier.take_link(id)?)?);
        Ok(())
    }

    fn attach_new_at(&mut self, place: &Place<'_>) -> Result<()> {
        let path = self.folder.link(place.interface_index, place.hook);
        remove_if_there(&path)?;
        let classifier: &mut SchedClassifier = program(&mut self.ebpf, place.program)?;
        let first = TcAttachOptions::TcxOrder(LinkOrder::first());
        let id = classifier.attach_with_options(place.interface, place.direction, first)?;
        FdLink::try_from(classifier.take_link(id)?)?
            .pin(path)
            .context("cannot pin the tcx link")?;
        Ok(())
    }
}
