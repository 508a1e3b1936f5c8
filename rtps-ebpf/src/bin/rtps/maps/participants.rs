//! Remote participants: those that rtpsd has accepted, those that only the kernel knows, and what
//! answering them may cost.

use core::ptr::NonNull;

use aya_ebpf::{
    bindings::{BPF_ANY, BPF_F_NO_PREALLOC},
    btf_maps::{Array, HashMap, LruHashMap},
    macros::btf_map,
};
use rtps_ebpf::{
    abi::{self, BUILTIN_WRITERS, PEER_ANY_ADDRESS, PEER_PROVEN, Peer},
    discovery::budget::{self, Budget},
    entity::GuidPrefix,
};

use crate::sys;

#[btf_map(name = "peers")]
static PEERS: HashMap<GuidPrefix, Peer, { abi::PEERS as usize }, { BPF_F_NO_PREALLOC as usize }> =
    HashMap::new();
#[btf_map(name = "strangers")]
static STRANGERS: LruHashMap<GuidPrefix, Peer, { abi::STRANGERS as usize }> = LruHashMap::new();
#[btf_map(name = "sources")]
static SOURCES: LruHashMap<[u8; 16], u64, { abi::SOURCES as usize }> = LruHashMap::new();
#[btf_map(name = "budgets")]
static BUDGETS: Array<u64, { abi::BUDGETS as usize }> = Array::new();

/// What is expected next of each built-in writer of a participant.
#[repr(C)]
pub(crate) struct Progress([u64; BUILTIN_WRITERS as usize]);

impl Progress {
    #[inline(always)]
    pub(crate) fn of(peer: &Peer) -> Self {
        let [a, b, c] = &peer.writers;
        Self([a.next, b.next, c.next])
    }
}

/// A participant's entry among peers, or else among strangers.
#[inline(always)]
fn entry(prefix: &GuidPrefix) -> Option<NonNull<Peer>> {
    PEERS
        .get_ptr_mut(prefix)
        .or_else(|| STRANGERS.get_ptr_mut(prefix))
        .and_then(NonNull::new)
}

/// What is known of a participant now; others change it at any time, which tears it at worst.
#[inline(always)]
pub(crate) fn known(prefix: &GuidPrefix) -> Option<&'static Peer> {
    // SAFETY: the map keeps the value alive for as long as the program runs.
    entry(prefix).map(|entry| unsafe { entry.as_ref() })
}

/// Whether rtpsd has accepted the participant.
#[inline(always)]
pub(crate) fn is_peer(prefix: &GuidPrefix) -> bool {
    PEERS.get_ptr(prefix).is_some()
}

/// Puts a participant among the strangers. A full table forgets the one that was silent for longest.
#[inline(always)]
pub(crate) fn remember(prefix: &GuidPrefix, peer: &Peer) {
    // Fails only where another CPU takes the last free entry; then it comes anew with what it says next.
    let _ = STRANGERS.insert(prefix, peer, BPF_ANY.into());
}

/// Notes what has become of a participant, where `before` was expected next. What rtpsd owns stays as it
/// is, and so does what it has changed meanwhile.
#[inline(always)]
pub(crate) fn update(prefix: &GuidPrefix, peer: &Peer, before: &Progress) {
    let Some(entry) = entry(prefix) else { return };
    // SAFETY: the map keeps the value alive; whoever reads it meanwhile gets a torn one at worst.
    let entry = unsafe { &mut *entry.as_ptr() };
    entry.last_seen_ns = peer.last_seen_ns;
    entry.announcement_hash = peer.announcement_hash;
    entry.spent_until_ns = peer.spent_until_ns;
    entry.reply_port = peer.reply_port;
    entry.flags = entry.flags & !PEER_PROVEN | peer.flags & PEER_PROVEN;
    entry.readers = peer.readers;
    for ((entry, writer), before) in entry.writers.iter_mut().zip(&peer.writers).zip(before.0) {
        entry.acknack_count = writer.acknack_count;
        if entry.next == before {
            entry.next = writer.next;
            entry.flags = writer.flags;
        }
    }
}

/// Whether a datagram from `source` may come from the participant: one that is known sends from its
/// own addresses only.
#[inline(always)]
pub(super) fn may_send(prefix: &GuidPrefix, source: &[u8; 16]) -> bool {
    known(prefix).is_none_or(|peer| {
        peer.flags & PEER_ANY_ADDRESS != 0
            || peer
                .addresses
                .iter()
                .any(|address| u128::from_ne_bytes(*address) == u128::from_ne_bytes(*source))
    })
}

/// Renews the participant's time stamp, when it is known; whether it is.
#[inline(always)]
pub(super) fn renew(prefix: &GuidPrefix, now_ns: u64) -> bool {
    let entry = entry(prefix);
    if let Some(entry) = entry {
        // SAFETY: the map keeps the value alive; an aligned store of 8 bytes is not torn.
        unsafe { (&raw mut (*entry.as_ptr()).last_seen_ns).write_volatile(now_ns) };
    }
    entry.is_some()
}

/// Spends `units` of a common budget; whether there was as much.
#[inline(always)]
pub(crate) fn spend(index: u32, budget: Budget, now_ns: u64, units: u64) -> bool {
    BUDGETS
        .get_ptr_mut(index)
        .and_then(NonNull::new)
        .is_some_and(|spent| spend_at(spent, budget, now_ns, units))
}

/// Spends one stranger of those that may come from an address.
#[inline(always)]
pub(crate) fn spend_of_source(source: &[u8; 16], now_ns: u64) -> bool {
    let budget = budget::SOURCE;
    if let Some(spent) = SOURCES.get_ptr_mut(source).and_then(NonNull::new) {
        return spend_at(spent, budget, now_ns, 1);
    }
    budget.spend(0, now_ns, 1).is_some_and(|spent| {
        let _ = SOURCES.insert(source, spent, BPF_ANY.into());
        true
    })
}

/// Tries again where another CPU spends at the same time.
#[inline(always)]
fn spend_at(spent: NonNull<u64>, budget: Budget, now_ns: u64, units: u64) -> bool {
    const ATTEMPTS: u32 = 4;
    (0..ATTEMPTS).any(|_| {
        // SAFETY: the map keeps the value alive; an aligned load of 8 bytes is not torn.
        let before = unsafe { spent.as_ptr().read_volatile() };
        budget
            .spend(before, now_ns, units)
            .is_some_and(|after| sys::compare_exchange(spent, before, after))
    })
}
