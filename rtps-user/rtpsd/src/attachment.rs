//! The programs on each interface, and who answers discovery messages there.

use std::collections::BTreeMap;

use anyhow::Result;
use rtps_ebpf::abi;
use rtps_net::Interface;
use tracing::{debug, info, warn};

use crate::cli::Discovery;
use crate::ethernet;
use crate::kernel_maps::KernelMaps;
use crate::loader::{Loader, WantedMode};

/// What keeps the programs attached to interfaces that go and come back.
pub(crate) struct Attachment {
    loader: Loader,
    mode: WantedMode,
    discovery: Discovery,
    /// Why the kernel does not answer on these interfaces, by index.
    refusals: BTreeMap<u32, String>,
    /// Why apps have to send to each destination by themselves.
    fan_out_refusal: Option<String>,
}

impl Attachment {
    /// Nothing is attached yet.
    pub(crate) fn new(loader: Loader, mode: WantedMode, discovery: Discovery) -> Self {
        Self {
            loader,
            mode,
            discovery,
            refusals: BTreeMap::new(),
            fan_out_refusal: None,
        }
    }

    /// Attaches to one of the interfaces, and detaches from those that are not among them.
    pub(crate) fn attach(&mut self, interface: &Interface, all: &[Interface]) -> Result<()> {
        self.loader.detach_others(all)?;
        self.refusals
            .retain(|index, _| all.iter().any(|known| known.index == *index));
        let mode = self.loader.attach(interface, self.mode)?;
        info!(interface = interface.name, %mode, "XDP attached");
        match self.attach_classifier(interface) {
            Ok(()) => {
                self.refusals.remove(&interface.index);
                info!(interface = interface.name, "the kernel answers discovery");
            }
            Err(reason) => self.refuse(interface, reason),
        }
        Ok(())
    }

    /// Has the kernel send to several destinations what apps send once, where it can.
    pub(crate) fn attach_fan_out(&mut self, kernel: &mut KernelMaps) {
        match self.loader.attach_fan_out() {
            Ok(()) => kernel.fan_outs.attached(),
            Err(reason) => {
                warn!("apps send to each destination by themselves: {reason}");
                self.fan_out_refusal = Some(reason);
            }
        }
    }

    /// Why they have to do that by themselves, where they have.
    pub(crate) fn fan_out_refusal(&self) -> Option<&str> {
        self.fan_out_refusal.as_deref()
    }

    fn attach_classifier(&mut self, interface: &Interface) -> Result<(), String> {
        if self.discovery == Discovery::User {
            self.loader
                .detach_classifier(interface)
                .map_err(|error| format!("{error:#}"))?;
            return Err("`--discovery user`".to_owned());
        }
        ethernet::describe(interface)?;
        self.loader.attach_classifier(interface)
    }

    fn refuse(&mut self, interface: &Interface, reason: String) {
        if self.discovery == Discovery::Kernel {
            warn!(
                interface = interface.name,
                "rtpsd answers discovery: {reason}"
            );
        }
        self.refusals.insert(interface.index, reason);
    }

    /// Tells the kernel who the host is on the interfaces where it answers.
    pub(crate) fn describe(
        &mut self,
        interfaces: &[Interface],
        kernel: &mut KernelMaps,
    ) -> Result<()> {
        let mut described: BTreeMap<u32, abi::Interface> = BTreeMap::new();
        for interface in interfaces {
            if self.refusals.contains_key(&interface.index) {
                continue;
            }
            match ethernet::describe(interface) {
                Ok(entry) => drop(described.insert(interface.index, entry)),
                // It is gone, or changes its kind.
                Err(reason) => debug!(interface = interface.name, "{reason}"),
            }
        }
        kernel.discovery.set_interfaces(&described)
    }

    /// Why rtpsd answers on an interface, where it does.
    pub(crate) fn refusal(&self, interface_index: u32) -> Option<&str> {
        self.refusals.get(&interface_index).map(String::as_str)
    }
}
