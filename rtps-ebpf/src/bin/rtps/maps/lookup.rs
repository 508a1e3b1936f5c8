//! What the walk over a datagram looks up: who sent it, and who reads from the writers in it.

use aya_ebpf::{bindings::BPF_F_NO_PREALLOC, btf_maps::HashMap, macros::btf_map};
use rtps_ebpf::{
    Routes, SlotSet,
    abi::{self, Config},
    entity::{Guid, GuidPrefix},
};

use super::participants::{may_send, renew};

#[btf_map(name = "routes")]
static ROUTES: HashMap<Guid, SlotSet, { abi::ROUTES as usize }, { BPF_F_NO_PREALLOC as usize }> =
    HashMap::new();

/// For so long a CPU remembers whom it has last heard, and from where: most datagrams come from where the one before did.
const MEMORY_NS: u64 = 10_000_000;

/// See the module.
#[repr(C)]
pub(crate) struct Lookup {
    /// Where the datagram in hand comes from.
    source: [u8; 16],
    now_ns: u64,
    /// A known participant that may send from there, and was renewed lately.
    familiar: GuidPrefix,
    /// Whether known participants may send from anywhere.
    any_source: bool,
    familiar_source: [u8; 16],
    familiar_until_ns: u64,
}

impl Lookup {
    /// Turns to the next datagram.
    #[inline(always)]
    pub(crate) fn turn_to(&mut self, source: [u8; 16], config: &Config, now_ns: u64) {
        self.source = source;
        self.now_ns = now_ns;
        self.any_source = config.any_source != 0;
    }

    /// The datagram, which is valid, comes from that participant: that is a sign of its life.
    #[inline(always)]
    pub(crate) fn heard(&mut self, participant: &GuidPrefix) {
        if self.is_familiar(participant) {
            return;
        }
        if renew(participant, self.now_ns) {
            self.familiar = *participant;
            self.familiar_source = self.source;
            self.familiar_until_ns = self.now_ns + MEMORY_NS;
        }
    }

    #[inline(always)]
    fn is_familiar(&self, participant: &GuidPrefix) -> bool {
        self.now_ns < self.familiar_until_ns
            && *participant == self.familiar
            && self.source == self.familiar_source
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
        self.any_source || self.is_familiar(participant) || may_send(participant, &self.source)
    }
}
