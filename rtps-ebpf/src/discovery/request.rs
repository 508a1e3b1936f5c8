//! What an ACKNACK asks for: which numbers there are samples for, and which not (RTPS 2.5, 8.4.7.2.7).

use core::ops::ControlFlow;

use super::{
    answer::{INFO_TS_LEN, PROLOGUE_LEN},
    exchange::Exchange,
    world::World,
};
use crate::{
    abi::{BUILTIN_WRITERS, RemoteReader, WRITER_INCOMPLETE},
    bytes::Bytes,
    number_set::{Bits, MAX_BITS},
    submessage::Submessage,
};

/// What was sent is not sent again within this time: it is on its way.
const SUPPRESSION_NS: u64 = 10_000_000;
/// Who answers each HEARTBEAT with a question is not answered more often than this.
const HEARTBEAT_PAUSE_NS: u64 = 2_000_000;
/// So many numbers from the base on are looked at to find out how far a GAP reaches.
const MAX_LOOKAHEAD: u32 = 2 * MAX_BITS;
/// Bytes that a datagram with a sample has beside it.
const OVERHEAD: u32 = PROLOGUE_LEN + INFO_TS_LEN;
/// Bytes of a SequenceNumberSet's base and number of bits, behind the two entity ids.
const BITMAP: u32 = 8 + 12;

/// The last ACKNACK to one of our writers, and what there is to say to it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Request {
    /// The number of the first bit; all below is acknowledged.
    pub(super) base: u64,
    /// The numbers asked for; once looked through, those to be sent.
    pub(super) bits: Bits,
    /// How many numbers the set spans.
    pub(super) count: u32,
    /// There is an ACKNACK.
    is_there: bool,
    is_final: bool,
    /// Numbers that were announced are asked for.
    is_asking: bool,
    /// A HEARTBEAT is due.
    pub(super) heartbeat: bool,
    /// The first number to be sent or to be declared gone; 0 for none.
    pub(super) first: u64,
    /// The first number that is gone; 0 for none.
    pub(super) gap_start: u64,
    /// The first one after that which is there; 0 until it is found.
    pub(super) gap_base: u64,
    /// Numbers from `gap_base` on that are gone.
    pub(super) gap_list: Bits,
    /// How many bits of it count.
    pub(super) gap_bits: u32,
}

/// The number to look at next.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Scan {
    writer: u32,
    /// Its offset from the base of the request.
    bit: u32,
}

impl Scan {
    pub(super) const START: Self = Self { writer: 0, bit: 0 };
}

impl Request {
    pub(super) const NONE: Self = Self {
        base: 0,
        bits: Bits::EMPTY,
        count: 0,
        is_there: false,
        is_final: true,
        is_asking: false,
        heartbeat: false,
        first: 0,
        gap_start: 0,
        gap_base: 0,
        gap_list: Bits::EMPTY,
        gap_bits: 0,
    };

    /// Forgets it. Field by field here and below, because a whole one would be copied from a constant, for which
    /// the loader would need another map.
    #[inline(always)]
    pub(super) const fn clear(&mut self) {
        self.is_there = false;
        self.first = 0;
        self.heartbeat = false;
    }

    /// Takes in an ACKNACK that was found valid, in place of an earlier one.
    #[inline(always)]
    pub(super) fn read(
        &mut self,
        message: &(impl Bytes + ?Sized),
        submessage: &Submessage,
        base: u64,
        count: u32,
    ) {
        let bitmap = submessage.start + BITMAP;
        for (index, word) in (0..).zip(self.bits.words_mut()) {
            *word = if 32 * index < count {
                let bytes = message.load::<4>(bitmap + 4 * index);
                bytes.map_or(0, |bytes| submessage.u32(bytes))
            } else {
                0
            };
        }
        self.base = base;
        self.count = count.min(MAX_BITS);
        self.is_there = true;
        self.is_final = submessage.is_final();
        self.is_asking = false;
        self.heartbeat = false;
        self.first = 0;
        self.gap_start = 0;
        self.gap_base = 0;
        self.gap_bits = 0;
        self.gap_list.clear();
    }

    /// Whether there is something to say.
    #[inline(always)]
    pub(super) const fn is_due(&self) -> bool {
        self.first != 0 || self.heartbeat
    }

    /// The GAP has a beginning and no end yet.
    #[inline(always)]
    const fn is_open(&self) -> bool {
        self.gap_start != 0 && self.gap_base == 0
    }

    /// All numbers below `end` have been looked at.
    #[inline(always)]
    const fn finish(&mut self, end: u64, reader: &RemoteReader, now_ns: u64) {
        if self.is_open() {
            self.gap_base = end;
        }
        let has_paused =
            reader.sent_ns == 0 || now_ns.saturating_sub(reader.sent_ns) >= HEARTBEAT_PAUSE_NS;
        self.heartbeat = self.first != 0 || !self.is_final && !self.is_asking && has_paused;
    }

    /// A number that is asked for is not there.
    #[inline(always)]
    const fn miss(&mut self, sequence: u64) {
        if self.gap_start == 0 {
            self.gap_start = sequence;
        } else if self.gap_base != 0 && sequence - self.gap_base < MAX_BITS as u64 {
            let bit = (sequence - self.gap_base) as u32;
            self.gap_list.insert(bit);
            self.gap_bits = bit + 1;
        }
    }
}

impl Exchange {
    /// Looks at one number of one request; breaks when there is no more.
    #[inline(always)]
    pub(super) fn scan_requests(&mut self, world: &impl World) -> ControlFlow<()> {
        let Scan { writer, bit } = self.scan;
        if writer >= BUILTIN_WRITERS {
            return ControlFlow::Break(());
        }
        if self.scan_number(world, writer, bit).is_continue() {
            self.scan.bit = bit + 1;
        } else {
            self.scan = Scan {
                writer: writer + 1,
                bit: 0,
            };
        }
        ControlFlow::Continue(())
    }

    /// Looks at a number; breaks behind the last one of its request.
    #[inline(always)]
    fn scan_number(&mut self, world: &impl World, number: u32, bit: u32) -> ControlFlow<()> {
        let (Some(request), Some(reader), Some(writer)) = (
            self.requests.get_mut(number as usize),
            self.peer.readers.get(number as usize),
            world.writer(number),
        ) else {
            return ControlFlow::Break(());
        };
        if !request.is_there {
            return ControlFlow::Break(());
        }
        let now_ns = self.setting.now_ns;
        let sequence = request.base + u64::from(bit);
        let is_last = bit >= request.count && !request.is_open();
        if is_last || sequence > writer.last || bit >= MAX_LOOKAHEAD {
            request.finish(sequence, reader, now_ns);
            return ControlFlow::Break(());
        }
        let is_asked = bit < request.count && request.bits.contains(bit) && sequence != 0;
        if !is_asked && !request.is_open() {
            return ControlFlow::Continue(());
        }
        let sample = world.sample(number, sequence);
        if sample.is_some() && request.is_open() {
            request.gap_base = sequence;
        }
        if !is_asked {
            return ControlFlow::Continue(());
        }
        request.is_asking = true;
        if was_sent(reader, sequence, now_ns) {
            request.bits.remove(bit);
            return ControlFlow::Continue(());
        }
        request.first = if request.first == 0 {
            sequence
        } else {
            request.first
        };
        let room = self.setting.datagram_size;
        if let Some(sample) = sample {
            let is_sendable = sample.len != 0 && sample.len <= room.saturating_sub(OVERHEAD);
            self.is_passed_on |= !is_sendable;
        } else {
            request.bits.remove(bit);
            request.miss(sequence);
            self.is_passed_on |= writer.flags & WRITER_INCOMPLETE != 0;
        }
        ControlFlow::Continue(())
    }
}

/// Whether the number is on its way to the reader.
#[inline(always)]
const fn was_sent(reader: &RemoteReader, sequence: u64, now_ns: u64) -> bool {
    now_ns.saturating_sub(reader.sent_ns) < SUPPRESSION_NS
        && reader.sent_from <= sequence
        && sequence < reader.sent_to
}
