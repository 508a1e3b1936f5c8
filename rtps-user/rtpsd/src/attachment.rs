//! The programs on each interface, and who answers discovery messages there.

use std::collections::BTreeMap;

use anyhow::Result;
use rtps_ebpf::abi::{self, INTERFACE_ANSWERS, INTERFACE_DELIVERS};
use rtps_net::Interface;
use tracing::{debug, info, warn};

use crate::cli::Discovery;
use crate::ethernet;
use crate::kernel_maps::KernelMaps;
use crate::loader::{AttachedMode, Loader, WantedMode};

/// What keeps the programs attached to interfaces that go and come back.
pub(crate) struct Attachment {
    loader: Loader,
    mode: WantedMode,
    discovery: Discovery,
    /// Where messages for apps are taken, by the interface's index.
    modes: BTreeMap<u32, AttachedMode>,
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
            modes: BTreeMap::new(),
            refusals: BTreeMap::new(),
            fan_out_refusal: None,
        }
    }

    /// Attaches to one of the interfaces, and detaches from those that are not among them.
    pub(crate) fn attach(&mut self, interface: &Interface, all: &[Interface]) -> Result<()> {
        self.loader.detach_others(all)?;
        let is_there = |index: &u32| all.iter().any(|known| known.index == *index);
        self.refusals.retain(|index, _| is_there(index));
        self.modes.retain(|index, _| is_there(index));
        let mode = self.loader.attach(interface, self.mode)?;
        info!(interface = interface.name, %mode, "attached");
        self.modes.insert(interface.index, mode);
        match self.attach_discovery(interface, mode) {
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

    /// Has the kernel answer discovery, or else says why not.
    fn attach_discovery(
        &mut self,
        interface: &Interface,
        mode: AttachedMode,
    ) -> Result<(), String> {
        match (self.discovery, mode) {
            // The classifier is there.
            (Discovery::Kernel, AttachedMode::Tc) => return Ok(()),
            (Discovery::Kernel, _) => return self.loader.attach_classifier(interface),
            (Discovery::User, AttachedMode::Tc) => {}
            (Discovery::User, _) => {
                let detached = self.loader.detach_classifier(interface);
                detached.map_err(|error| format!("{error:#}"))?;
            }
        }
        Err("`--discovery user`".to_owned())
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

    /// Tells the kernel who the host is on the interfaces, and what to do there.
    pub(crate) fn describe(
        &mut self,
        interfaces: &[Interface],
        kernel: &mut KernelMaps,
    ) -> Result<()> {
        let mut described: BTreeMap<u32, abi::Interface> = BTreeMap::new();
        for interface in interfaces {
            match ethernet::describe(interface, self.tasks(interface.index)) {
                Ok(entry) => drop(described.insert(interface.index, entry)),
                // It is gone, or changes its kind.
                Err(reason) => debug!(interface = interface.name, "{reason}"),
            }
        }
        kernel.discovery.set_interfaces(&described)
    }

    fn tasks(&self, interface_index: u32) -> u16 {
        let mut tasks = 0;
        if !self.refusals.contains_key(&interface_index) {
            tasks |= INTERFACE_ANSWERS;
        }
        if self.modes.get(&interface_index) == Some(&AttachedMode::Tc) {
            tasks |= INTERFACE_DELIVERS;
        }
        tasks
    }

    /// Why rtpsd answers on an interface, where it does.
    pub(crate) fn refusal(&self, interface_index: u32) -> Option<&str> {
        self.refusals.get(&interface_index).map(String::as_str)
    }
}
