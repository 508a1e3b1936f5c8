//! The rings of the apps, and the one for rtpsd.

use core::ffi::c_void;

use aya_ebpf::{
    bindings::{BPF_RB_FORCE_WAKEUP, BPF_RB_NO_WAKEUP},
    btf_maps::{ArrayOfMaps, RingBuf},
    helpers::{bpf_ringbuf_discard, bpf_ringbuf_reserve, bpf_ringbuf_submit},
    macros::btf_map,
};
use rtps_ebpf::abi::{self, RecordHeader};

use crate::sys::{Message, Packet};

/// The sizes of records; the verifier wants each reservation to be a constant.
const S0: usize = abi::RECORD_SIZES[0];
const S1: usize = abi::RECORD_SIZES[1];
const S2: usize = abi::RECORD_SIZES[2];
const S3: usize = abi::RECORD_SIZES[3];
const S4: usize = abi::RECORD_SIZES[4];
const S5: usize = abi::RECORD_SIZES[5];
const S6: usize = abi::RECORD_SIZES[6];

type RingMap = RingBuf<u8, 4096>;

#[btf_map(name = "rings")]
static RINGS: ArrayOfMaps<RingMap, { abi::SLOTS as usize }> = ArrayOfMaps::new();
#[btf_map(name = "news")]
static NEWS: RingBuf<u8, { abi::NEWS_BYTES }> = RingBuf::new();

/// A ring that records go into.
#[derive(Clone, Copy)]
pub(crate) struct Ring {
    map: *mut c_void,
    /// Whether to wake the reader with a new record.
    notification: u32,
}

impl Ring {
    /// An app's, which has a bell of its own.
    #[inline(always)]
    pub(crate) fn of(slot: u32) -> Option<Self> {
        RINGS.get(slot).map(|ring| Self {
            map: (&raw const *ring).cast_mut().cast(),
            notification: BPF_RB_NO_WAKEUP,
        })
    }

    /// rtpsd's, whom the kernel wakes when it has read all that there was.
    #[inline(always)]
    pub(crate) fn news() -> Self {
        Self {
            map: (&raw const NEWS).cast_mut().cast(),
            notification: 0,
        }
    }

    /// Writes a record into the smallest size that holds it; fails when the ring is full.
    #[inline(always)]
    pub(crate) fn write(
        self,
        header: &RecordHeader,
        message: &Message<impl Packet>,
    ) -> Result<(), ()> {
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
        message: &Message<impl Packet>,
    ) -> Result<(), ()> {
        // SAFETY: the helper takes a ring's map, or the inner map that the outer one returned.
        let record = unsafe { bpf_ringbuf_reserve(self.map, SIZE as u64, 0) };
        if record.is_null() {
            return Err(());
        }
        // SAFETY: the record has `SIZE` bytes, aligned to 8, and is submitted or discarded once.
        unsafe {
            record.cast::<RecordHeader>().write(*header);
            let body = record.cast::<u8>().add(size_of::<RecordHeader>());
            let copied = message.copy(body, header.message_len, SIZE - size_of::<RecordHeader>());
            match copied {
                Ok(()) => bpf_ringbuf_submit(record, self.notification.into()),
                Err(()) => bpf_ringbuf_discard(record, self.notification.into()),
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
            let record = bpf_ringbuf_reserve(self.map, EMPTY, 0);
            if !record.is_null() {
                bpf_ringbuf_discard(record, BPF_RB_FORCE_WAKEUP.into());
            }
        }
    }
}
