//! The tc program on ingress, attached by a tcx link: it decides on discovery messages and answers them.
//!
//! It comes before other tc programs, which may end the chain.

use anyhow::{Context, Result};
use aya::Ebpf;
use aya::programs::links::{FdLink, LinkOrder, PinnedLink};
use aya::programs::tc::{SchedClassifierLink, TcAttachOptions};
use aya::programs::{SchedClassifier, TcAttachType};
use rtps_ebpf::abi::name;
use rtps_net::Interface;
use tracing::{info, warn};

use super::{Loader, innermost, program};
use crate::pins::Hook;
use crate::run_folder::remove_if_there;

/// Loads it; the error is why the kernel cannot answer discovery messages anywhere.
pub(super) fn load(ebpf: &mut Ebpf) -> Result<(), String> {
    let loaded = classifier_program(ebpf).and_then(|classifier| Ok(classifier.load()?));
    loaded.map_err(|error| {
        warn!("{error:#}");
        format!("the kernel refuses {}", name::INGRESS_PROGRAM)
    })
}

impl Loader {
    /// Attaches it to an interface, or replaces that of an earlier rtpsd there; the error is why that does not work.
    pub(crate) fn attach_classifier(&mut self, interface: &Interface) -> Result<(), String> {
        self.classifier.clone()?;
        if self.take_over_classifier(interface) {
            return Ok(());
        }
        self.attach_new_classifier(interface)
            .map_err(|error| format!("tcx: {}", innermost(error.as_ref())))
    }

    /// Detaches it from an interface where it is.
    pub(crate) fn detach_classifier(&self, interface: &Interface) -> Result<()> {
        self.detach_where(|index, hook| index == interface.index && hook == Hook::Ingress)
    }

    /// False when there is no such link, or its interface is gone.
    fn take_over_classifier(&mut self, interface: &Interface) -> bool {
        let path = self.folder.link(interface.index, Hook::Ingress);
        let Ok(pinned) = PinnedLink::from_pin(path) else {
            return false;
        };
        let interface = &interface.name;
        match self.replace_classifier(pinned) {
            Ok(()) => {
                info!(interface, "took over the attached tc program");
                true
            }
            Err(error) => {
                warn!(interface, "the pinned tcx link is dead: {error:#}");
                false
            }
        }
    }

    fn replace_classifier(&mut self, pinned: PinnedLink) -> Result<()> {
        let link = SchedClassifierLink::try_from(FdLink::from(pinned))?;
        let classifier = classifier_program(&mut self.ebpf)?;
        let id = classifier.attach_to_link(link)?;
        // Only the pin holds the link, so that removing the pin detaches.
        drop(FdLink::try_from(classifier.take_link(id)?)?);
        Ok(())
    }

    fn attach_new_classifier(&mut self, interface: &Interface) -> Result<()> {
        let path = self.folder.link(interface.index, Hook::Ingress);
        remove_if_there(&path)?;
        let classifier = classifier_program(&mut self.ebpf)?;
        let first = TcAttachOptions::TcxOrder(LinkOrder::first());
        let id = classifier.attach_with_options(&interface.name, TcAttachType::Ingress, first)?;
        FdLink::try_from(classifier.take_link(id)?)?
            .pin(path)
            .context("cannot pin the tcx link")?;
        Ok(())
    }
}

fn classifier_program(ebpf: &mut Ebpf) -> Result<&mut SchedClassifier> {
    program(ebpf, name::INGRESS_PROGRAM)
}
