//! What the host says of itself, and from where.

use aya_ebpf::{
    bindings::BPF_F_NO_PREALLOC,
    btf_maps::{Array, HashMap},
    macros::btf_map,
};
use rtps_ebpf::{
    abi::{
        self, Announcement, BUILTIN_WRITERS, BuiltinWriter, Interface, SUBMESSAGE_BYTES, Sample,
        SampleKey,
    },
    discovery::World,
};

use crate::sys;

#[btf_map(name = "interfaces")]
static INTERFACES: HashMap<u32, Interface, { abi::INTERFACES as usize }> = HashMap::new();
#[btf_map(name = "announcements")]
static ANNOUNCEMENTS: Array<Announcement, { abi::DOMAINS as usize }> = Array::new();
#[btf_map(name = "writers")]
static WRITERS: Array<BuiltinWriter, { (abi::DOMAINS * BUILTIN_WRITERS) as usize }> = Array::new();
#[btf_map(name = "samples")]
static SAMPLES: HashMap<
    SampleKey,
    Sample,
    { abi::SAMPLES as usize },
    { BPF_F_NO_PREALLOC as usize },
> = HashMap::new();

/// Who the host is on an interface where the kernel may answer.
#[inline(always)]
pub(crate) fn interface(ifindex: u32) -> Option<&'static Interface> {
    // SAFETY: the value is read at once; rtpsd replaces it when an address changes.
    unsafe { INTERFACES.get(ifindex) }
}

/// One domain's built-in writers, by its index.
#[derive(Clone, Copy)]
pub(crate) struct DomainWorld(pub(crate) u32);

impl World for DomainWorld {
    #[inline(always)]
    fn writer(&self, writer: u32) -> Option<&BuiltinWriter> {
        WRITERS.get(self.0 * BUILTIN_WRITERS + writer)
    }

    #[inline(always)]
    fn sample(&self, writer: u32, sequence: u64) -> Option<&Sample> {
        let key = SampleKey {
            domain_index: self.0,
            writer,
            sequence,
        };
        // SAFETY: rtpsd never changes a sample, and removes it only when nobody may ask for it any
        // more; what is read of a reused one is still a sample of ours.
        unsafe { SAMPLES.get(key) }
    }

    #[inline(always)]
    fn announcement(&self) -> Option<&Announcement> {
        ANNOUNCEMENTS.get(self.0)
    }

    #[inline(always)]
    fn copy(&self, from: &[u8; SUBMESSAGE_BYTES], to: &mut [u8; SUBMESSAGE_BYTES]) {
        sys::copy(from, to);
    }
}
