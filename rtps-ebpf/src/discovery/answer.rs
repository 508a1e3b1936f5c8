//! A datagram in the making: what the built-in endpoints say, little-endian (RTPS 2.5, 9.4.4 and 9.4.5).

use core::ops::ControlFlow;

use crate::{
    abi::SUBMESSAGE_BYTES,
    entity::{EntityId, GuidPrefix},
    number_set::{Bits, WORDS},
    submessage::{flag, id},
};

/// Bytes of the buffer: behind the longest datagram there is room for the longest copy.
pub const ANSWER_BYTES: usize = 4_096;
/// The longest datagram: what fits a frame of 1,500 bytes over IPv4.
pub const MAX_DATAGRAM: u32 = 1_472;
/// Header and INFO_DST.
pub(super) const PROLOGUE_LEN: u32 = 36;
/// Bytes of an INFO_TS.
pub(super) const INFO_TS_LEN: u32 = 12;
/// Bytes of a HEARTBEAT.
pub(super) const HEARTBEAT_LEN: u32 = 32;
/// Bytes of an ACKNACK with a full set.
pub(super) const ACKNACK_LEN: u32 = 60;
/// Bytes of a GAP with a full set.
pub(super) const GAP_LEN: u32 = 64;

const MAJOR_VERSION: u8 = 2;
const MINOR_VERSION: u8 = 5;
const VENDOR_UNKNOWN: [u8; 2] = [0, 0];

const _: () = assert!(MAX_DATAGRAM as usize + SUBMESSAGE_BYTES <= ANSWER_BYTES);

/// One datagram.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Answer {
    /// Bytes of it so far.
    pub len: u32,
    /// Bytes that it may have.
    limit: u32,
    /// The datagram, then anything.
    pub bytes: [u8; ANSWER_BYTES],
}

/// The head of a submessage between two built-in endpoints.
#[derive(Clone, Copy)]
pub(super) struct Ends {
    pub(super) reader: EntityId,
    pub(super) writer: EntityId,
}

impl Answer {
    /// Nothing, and no room.
    pub(super) const fn new() -> Self {
        Self {
            len: 0,
            limit: 0,
            bytes: [0; ANSWER_BYTES],
        }
    }

    /// Begins a datagram of at most `limit` bytes from `own` to `destination`: header and INFO_DST.
    #[inline(always)]
    pub(super) fn begin(&mut self, limit: u32, own: &GuidPrefix, destination: &GuidPrefix) {
        self.len = 0;
        self.limit = limit.min(MAX_DATAGRAM);
        self.put(*b"RTPS");
        self.put([MAJOR_VERSION, MINOR_VERSION]);
        self.put(VENDOR_UNKNOWN);
        self.put(*own);
        self.head(id::INFO_DST, 0, 12);
        self.put(*destination);
    }

    /// Whether it says something.
    #[inline(always)]
    pub(super) const fn is_empty(&self) -> bool {
        self.len <= PROLOGUE_LEN
    }

    /// Breaks where so many bytes more, at most 2^31, would not fit.
    #[inline(always)]
    pub(super) const fn room(&self, bytes: u32) -> ControlFlow<()> {
        if self.len + bytes <= self.limit {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }

    /// The bytes behind its end, as many as a copy takes; to be followed by [`advance`](Self::advance).
    #[inline(always)]
    pub(super) fn rest(&mut self) -> Option<&mut [u8; SUBMESSAGE_BYTES]> {
        self.bytes.get_mut(self.len as usize..)?.first_chunk_mut()
    }

    /// Takes in `bytes` that were copied behind its end.
    #[inline(always)]
    pub(super) const fn advance(&mut self, bytes: u32) {
        self.len += bytes;
    }

    /// INFO_TS.
    #[inline(always)]
    pub(super) fn timestamp(&mut self, timestamp: [u8; 8]) {
        self.head(id::INFO_TS, 0, 8);
        self.put(timestamp);
    }

    /// HEARTBEAT.
    #[inline(always)]
    pub(super) fn heartbeat(
        &mut self,
        ends: Ends,
        first: u64,
        last: u64,
        count: u32,
        is_final: bool,
    ) {
        self.head(id::HEARTBEAT, final_flag(is_final), 28);
        self.ends(ends);
        self.number(first);
        self.number(last);
        self.put(count.to_le_bytes());
    }

    /// ACKNACK that asks for the `bits` numbers from `base` on, at most 256.
    #[inline(always)]
    pub(super) fn acknack(&mut self, ends: Ends, base: u64, bits: u32, count: u32, is_final: bool) {
        let words = words(bits);
        self.head(id::ACKNACK, final_flag(is_final), 24 + 4 * words as u8);
        self.ends(ends);
        self.number(base);
        self.put(bits.to_le_bytes());
        for word in 0..WORDS as u32 {
            if word < words {
                self.put(ones(bits - 32 * word).to_le_bytes());
            }
        }
        self.put(count.to_le_bytes());
    }

    /// GAP from `start` to below `base`, and of the first `bits` in `list` that are set.
    #[inline(always)]
    pub(super) fn gap(&mut self, ends: Ends, start: u64, base: u64, bits: u32, list: &Bits) {
        let words = words(bits);
        self.head(id::GAP, 0, 28 + 4 * words as u8);
        self.ends(ends);
        self.number(start);
        self.number(base);
        self.put(bits.to_le_bytes());
        for (word, list) in (0..).zip(list.words()) {
            if word < words {
                self.put(list.to_le_bytes());
            }
        }
    }

    #[inline(always)]
    fn head(&mut self, id: u8, flags: u8, len: u8) {
        self.put([id, flags | flag::LITTLE_ENDIAN, len, 0]);
    }

    #[inline(always)]
    fn ends(&mut self, ends: Ends) {
        self.put(ends.reader);
        self.put(ends.writer);
    }

    /// A SequenceNumber_t: the high word comes first (9.3.2).
    #[inline(always)]
    fn number(&mut self, number: u64) {
        self.put(((number >> 32) as u32).to_le_bytes());
        self.put((number as u32).to_le_bytes());
    }

    /// Appends bytes for which the caller has seen that there is room.
    #[inline(always)]
    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let rest = self.bytes.get_mut(self.len as usize..);
        if let Some(room) = rest.and_then(|rest| rest.first_chunk_mut()) {
            *room = bytes;
            self.len += N as u32;
        }
    }
}

/// Words of a set with so many bits.
#[inline(always)]
const fn words(bits: u32) -> u32 {
    (bits + 31) >> 5
}

/// A word whose first `bits` are set, all from 32 on.
#[inline(always)]
const fn ones(bits: u32) -> u32 {
    if bits >= 32 {
        u32::MAX
    } else {
        !(u32::MAX >> (bits & 31))
    }
}

#[inline(always)]
const fn final_flag(is_final: bool) -> u8 {
    if is_final { flag::FINAL } else { 0 }
}
