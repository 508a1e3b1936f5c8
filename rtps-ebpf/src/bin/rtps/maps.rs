//! The maps, each behind a function that says what the programs want of it.

mod counters;
mod fan_outs;
mod lookup;
mod participants;
mod rings;
mod scratch;
mod world;

use aya_ebpf::{
    bindings::BPF_F_MMAPABLE,
    btf_maps::{Array, ArrayOfMaps, HashMap},
    macros::btf_map,
};
use rtps_ebpf::{
    ABI_VERSION,
    abi::{self, App, Bell, Config, Domain, PortConfig},
};

pub(crate) use counters::Counters;
pub(crate) use fan_outs::{destination, emission, fan_out, sender};
pub(crate) use lookup::Lookup;
pub(crate) use participants::{Progress, is_peer, known, remember, spend, spend_of_source, update};
pub(crate) use rings::Ring;
pub(crate) use scratch::{Scratch, exchange, reply, scratch};
pub(crate) use world::{DomainWorld, interface};

type BellMap = Array<Bell, 1, { BPF_F_MMAPABLE as usize }>;

#[btf_map(name = "config")]
static CONFIG: Array<Config, 1> = Array::new();
#[btf_map(name = "domains")]
static DOMAINS: Array<Domain, { abi::DOMAINS as usize }> = Array::new();
#[btf_map(name = "ports")]
static PORTS: Array<PortConfig, { abi::PORTS as usize }> = Array::new();
#[btf_map(name = "addresses")]
static ADDRESSES: HashMap<[u8; 16], u32, { abi::ADDRESSES as usize }> = HashMap::new();
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
    PORTS
        .get(port.into())
        .filter(|config| config.kind != abi::PORT_FOREIGN)
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
