//! The maps, each behind a function that says what the programs want of it.

mod counters;
mod fan_outs;
mod participants;
mod rings;
mod scratch;
mod world;

use aya_ebpf::{
    bindings::{BPF_F_MMAPABLE, BPF_F_NO_PREALLOC},
    btf_maps::{Array, ArrayOfMaps, HashMap},
    macros::btf_map,
};
use rtps_ebpf::{
    ABI_VERSION, Routes, SlotSet,
    abi::{self, App, Bell, Config, Domain, PortConfig},
    entity::{Guid, GuidPrefix},
};

pub(crate) use counters::Counters;
pub(crate) use fan_outs::{destination, emission, fan_out, sender};
use participants::may_send;
pub(crate) use participants::{
    Progress, is_peer, known, remember, renew, spend, spend_of_source, update,
};
pub(crate) use rings::Ring;
pub(crate) use scratch::{Scratch, exchange, reply, scratch};
pub(crate) use world::{DomainWorld, interface};

type BellMap = Array<Bell, 1, { BPF_F_MMAPABLE as usize }>;

#[btf_map(name = "config")]
static CONFIG: Array<Config, 1> = Array::new();
#[btf_map(name = "domains")]
static DOMAINS: Array<Domain, { abi::DOMAINS as usize }> = Array::new();
#[btf_map(name = "ports")]
static PORTS: HashMap<u16, PortConfig, { abi::PORTS as usize }> = HashMap::new();
#[btf_map(name = "addresses")]
static ADDRESSES: HashMap<[u8; 16], u32, { abi::ADDRESSES as usize }> = HashMap::new();
#[btf_map(name = "routes")]
static ROUTES: HashMap<Guid, SlotSet, { abi::ROUTES as usize }, { BPF_F_NO_PREALLOC as usize }> =
    HashMap::new();
#[btf_map(name = "apps")]
static APPS: Array<App, { abi::SLOTS as usize }> = Array::new();
#[btf_map(name = "bells")]
static BELLS: ArrayOfMaps<BellMap, { abi::SLOTS as usize }> = ArrayOfMaps::new();

/// The configuration, once rtpsd of the same version has written it.
#[inline(always)]
pub(crate) fn config() -> Option<&'static Config> {
    CONFIG
        .get(0)
        .filter(|config| config.abi_version == ABI_VERSION)
}

/// The port's entry, when the layer owns the port.
#[inline(always)]
pub(crate) fn port(port: u16) -> Option<&'static PortConfig> {
    // SAFETY: the value is read at once; a stale one sends the datagram where it went before.
    unsafe { PORTS.get(port) }
}

/// Whether the address is this host's.
#[inline(always)]
pub(crate) fn is_own_address(address: &[u8; 16]) -> bool {
    ADDRESSES.get_ptr(address).is_some()
}

/// A domain that the layer serves.
#[inline(always)]
pub(crate) fn domain(index: u32) -> Option<&'static Domain> {
    DOMAINS.get(index)
}

/// The app in a slot, when one of this domain is attached.
#[inline(always)]
pub(crate) fn app(slot: u32, domain_index: u32) -> Option<&'static App> {
    APPS.get(slot)
        .filter(|app| app.state == abi::APP_ATTACHED && app.domain_index == domain_index)
}

/// Whether the app sleeps, or is about to. To be asked after a record was submitted.
#[inline(always)]
pub(crate) fn needs_wakeup(slot: u32) -> bool {
    // On the stack: a constant's address would bring along a read-only section, and its map.
    let mut index = 0;
    let Some(bell) = BELLS.get_value_ptr_mut(slot, &mut index) else {
        return false;
    };
    // SAFETY: the map keeps the bell alive; the app changes it at any time, hence volatile.
    unsafe { (&raw const (*bell).need_wakeup).read_volatile() != 0 }
}

/// What the walk over a datagram from `source` looks up.
#[repr(C)]
pub(crate) struct Lookup {
    source: [u8; 16],
    /// Whether known participants may send from anywhere.
    any_source: bool,
}

impl Lookup {
    #[inline(always)]
    pub(crate) fn new(source: [u8; 16], config: &Config) -> Self {
        Self {
            source,
            any_source: config.any_source != 0,
        }
    }
}

impl Routes for Lookup {
    #[inline(always)]
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        // SAFETY: the value is read at once; a torn one is repaired by rtpsd's next update.
        if let Some(readers) = unsafe { ROUTES.get(writer) } {
            slots.union(readers);
        }
    }

    #[inline(always)]
    fn may_send(&self, participant: &GuidPrefix) -> bool {
        self.any_source || may_send(participant, &self.source)
    }
}
