//! What the host says of itself, and from where.

use aya_ebpf::{
    bindings::BPF_F_NO_PREALLOC,
    btf_maps::{Array, HashMap},
    macros::btf_map,
};
use rtps_ebpf::{
    abi::{
        self, Announcement, AnnouncementKey, BUILTIN_WRITERS, BuiltinWriter, Interface,
        RecordHeader, SUBMESSAGE_BYTES, Sample, SampleKey,
    },
    discovery::World,
};

use crate::sys;

#[btf_map(name = "interfaces")]
static INTERFACES: HashMap<u32, Interface, { abi::INTERFACES as usize }> = HashMap::new();
#[btf_map(name = "announcements")]
static ANNOUNCEMENTS: HashMap<
    AnnouncementKey,
    Announcement,
    { abi::ANNOUNCEMENTS as usize },
    { BPF_F_NO_PREALLOC as usize },
> = HashMap::new();
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

/// What the host says in one domain on one interface.
#[derive(Clone, Copy)]
pub(crate) struct DomainWorld {
    domain_index: u32,
    ifindex: u32,
}

impl DomainWorld {
    /// Where the message of this record came in.
    #[inline(always)]
    pub(crate) fn of(header: &RecordHeader) -> Self {
        Self {
            domain_index: header.domain_index.into(),
            ifindex: header.ifindex,
        }
    }
}

impl World for DomainWorld {
    #[inline(always)]
    fn writer(&self, writer: u32) -> Option<&BuiltinWriter> {
        WRITERS.get(self.domain_index * BUILTIN_WRITERS + writer)
    }

    #[inline(always)]
    fn sample(&self, writer: u32, sequence: u64) -> Option<&Sample> {
        let key = SampleKey {
            domain_index: self.domain_index,
            writer,
            sequence,
        };
        // SAFETY: rtpsd never changes a sample, and removes it only when nobody may ask for it any
        // more; what is read of a reused one is still a sample of ours.
        unsafe { SAMPLES.get(key) }
    }

    #[inline(always)]
    fn announcement(&self) -> Option<&Announcement> {
        let key = AnnouncementKey {
            domain_index: self.domain_index,
            ifindex: self.ifindex,
        };
        // SAFETY: rtpsd replaces an announcement as a whole, and the kernel frees the old one only when no
        // program runs any more that may have found it.
        unsafe { ANNOUNCEMENTS.get(key) }
    }

    #[inline(always)]
    fn copy(&self, from: &[u8; SUBMESSAGE_BYTES], to: &mut [u8; SUBMESSAGE_BYTES]) {
        sys::copy(from, to);
    }
}
