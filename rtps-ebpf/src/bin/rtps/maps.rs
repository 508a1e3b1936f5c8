//! The maps, each behind a function that says what the programs want of it.

use core::ptr::NonNull;

use aya_ebpf::{
    bindings::{BPF_F_MMAPABLE, BPF_F_NO_PREALLOC, BPF_RB_FORCE_WAKEUP, BPF_RB_NO_WAKEUP},
    btf_maps::{Array, ArrayOfMaps, HashMap, PerCpuArray, PerCpuHashMap, RingBuf},
    check_bounds_signed,
    helpers::{bpf_ringbuf_discard, bpf_ringbuf_reserve, bpf_ringbuf_submit},
    macros::btf_map,
};
use rtps_ebpf::{
    ABI_VERSION, Counter, Reason, Routes, SlotSet, Walk,
    abi::{self, App, Bell, Config, Domain, Peer, PortConfig, RecordHeader},
    entity::{Guid, GuidPrefix},
};

use crate::sys::Packet;

/// The sizes of records; the verifier wants each reservation to be a constant.
const S0: usize = abi::RECORD_SIZES[0];
const S1: usize = abi::RECORD_SIZES[1];
const S2: usize = abi::RECORD_SIZES[2];
const S3: usize = abi::RECORD_SIZES[3];
const S4: usize = abi::RECORD_SIZES[4];
const S5: usize = abi::RECORD_SIZES[5];
const S6: usize = abi::RECORD_SIZES[6];

type RingMap = RingBuf<u8, 4096>;
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
#[btf_map(name = "rings")]
static RINGS: ArrayOfMaps<RingMap, { abi::SLOTS as usize }> = ArrayOfMaps::new();
#[btf_map(name = "peers")]
static PEERS: HashMap<GuidPrefix, Peer, { abi::PEERS as usize }, { BPF_F_NO_PREALLOC as usize }> =
    HashMap::new();
#[btf_map(name = "counters")]
static COUNTERS: PerCpuHashMap<u32, [u64; Counter::COUNT], { abi::INTERFACES as usize }> =
    PerCpuHashMap::new();

#[btf_map(name = "scratch")]
static SCRATCH: PerCpuArray<Scratch, 1> = PerCpuArray::new();

/// The state of the message in hand.
///
/// In a map and not on the stack, which has 512 bytes, and because the verifier forgets what it
/// knows of a map's contents: it would follow each possible content of the stack on its own. Both
/// hooks run in softirq context, so that a CPU handles one message at a time.
#[repr(C)]
pub(crate) struct Scratch {
    pub(crate) walk: Walk,
    pub(crate) header: RecordHeader,
    /// The apps that the message has still to be delivered to.
    pub(crate) targets: SlotSet,
    /// Of the first sleeping app that the datagram itself can wake, or 0.
    pub(crate) doorbell_port: u32,
    /// Not 0: at least one app has it.
    pub(crate) delivered: u32,
    pub(crate) malformed: Option<Reason>,
}

/// This CPU's scratch space.
#[inline(always)]
pub(crate) fn scratch() -> Option<&'static mut Scratch> {
    // SAFETY: the programs take it once for each message, and do not interrupt each other.
    SCRATCH
        .get_ptr_mut(0)
        .map(|scratch| unsafe { &mut *scratch })
}

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

/// Renews the participant's time stamp, when rtpsd knows it.
#[inline(always)]
pub(crate) fn renew_peer(prefix: &GuidPrefix, now_ns: u64) {
    if let Some(peer) = PEERS.get_ptr_mut(prefix) {
        // SAFETY: the map keeps the value alive; an aligned store of 8 bytes is not torn.
        unsafe { (&raw mut (*peer).last_seen_ns).write_volatile(now_ns) };
    }
}

/// The `routes` map.
pub(crate) struct RouteMap;

impl Routes for RouteMap {
    #[inline(always)]
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        // SAFETY: the value is read at once; a torn one is repaired by rtpsd's next update.
        if let Some(readers) = unsafe { ROUTES.get(writer) } {
            slots.union(readers);
        }
    }
}

/// The counters of one interface on this CPU.
#[derive(Clone, Copy)]
pub(crate) struct Counters(Option<NonNull<[u64; Counter::COUNT]>>);

impl Counters {
    /// Falls back to the common entry for an interface without its own.
    #[inline(always)]
    pub(crate) fn of(ifindex: u32) -> Self {
        let own = COUNTERS.get_ptr_mut(ifindex);
        Self(
            own.or_else(|| COUNTERS.get_ptr_mut(0))
                .and_then(NonNull::new),
        )
    }

    #[inline(always)]
    pub(crate) fn count(self, counter: Counter) {
        self.add(counter, 1);
    }

    #[inline(always)]
    pub(crate) fn count_malformed(self, reason: Option<Reason>) {
        if let Some(reason) = reason {
            self.add_at(reason as u8, 1);
        }
    }

    #[inline(always)]
    pub(crate) fn add(self, counter: Counter, amount: u64) {
        self.add_at(counter as u8, amount);
    }

    #[inline(always)]
    fn add_at(self, index: u8, amount: u64) {
        let Some(counters) = self.0 else { return };
        // The compiler knows the range of the enums' discriminants, the verifier does not.
        if check_bounds_signed(i64::from(index), 0, Counter::COUNT as i64 - 1) {
            // SAFETY: within the array; only this CPU writes it, in one context at a time.
            unsafe { *counters.cast::<u64>().add(index.into()).as_mut() += amount };
        }
    }
}

/// An app's ring.
#[derive(Clone, Copy)]
pub(crate) struct Ring(&'static RingMap);

impl Ring {
    #[inline(always)]
    pub(crate) fn of(slot: u32) -> Option<Self> {
        RINGS.get(slot).map(Self)
    }

    /// Writes a record into the smallest size that holds it, without waking anybody; fails when
    /// the ring is full.
    #[inline(always)]
    pub(crate) fn write(self, header: &RecordHeader, message: &impl Packet) -> Result<(), ()> {
        let len = header.message_len as usize + size_of::<RecordHeader>();
        match len {
            0..=S0 => self.write_sized::<S0>(header, message),
            ..=S1 => self.write_sized::<S1>(header, message),
            ..=S2 => self.write_sized::<S2>(header, message),
            ..=S3 => self.write_sized::<S3>(header, message),
            ..=S4 => self.write_sized::<S4>(header, message),
            ..=S5 => self.write_sized::<S5>(header, message),
            _ => self.write_sized::<S6>(header, message),
        }
    }

    #[inline(always)]
    fn write_sized<const SIZE: usize>(
        self,
        header: &RecordHeader,
        message: &impl Packet,
    ) -> Result<(), ()> {
        // SAFETY: the helper takes the inner map that the outer one returned.
        let record = unsafe { bpf_ringbuf_reserve(self.as_ptr(), SIZE as u64, 0) };
        if record.is_null() {
            return Err(());
        }
        // SAFETY: the record has `SIZE` bytes, aligned to 8, and is submitted or discarded once.
        unsafe {
            record.cast::<RecordHeader>().write(*header);
            let body = record.cast::<u8>().add(size_of::<RecordHeader>());
            let copied = message.copy(body, header.message_len, SIZE - size_of::<RecordHeader>());
            match copied {
                Ok(()) => bpf_ringbuf_submit(record, BPF_RB_NO_WAKEUP.into()),
                Err(()) => bpf_ringbuf_discard(record, BPF_RB_NO_WAKEUP.into()),
            }
            copied
        }
    }

    /// Wakes whoever waits for the ring: an empty record, discarded, carries the notification.
    /// When there is no room for it the ring is full, and its first record woke the app.
    #[inline(always)]
    pub(crate) fn wake(self) {
        const EMPTY: u64 = 8;
        // SAFETY: as in `write_sized`.
        unsafe {
            let record = bpf_ringbuf_reserve(self.as_ptr(), EMPTY, 0);
            if !record.is_null() {
                bpf_ringbuf_discard(record, BPF_RB_FORCE_WAKEUP.into());
            }
        }
    }

    #[inline(always)]
    fn as_ptr(self) -> *mut core::ffi::c_void {
        (&raw const *self.0).cast_mut().cast()
    }
}
