//! SequenceNumberSet and FragmentNumberSet (RTPS 2.5, 9.4.2.6 and 9.4.2.8).

use crate::counter::Reason;

/// Bits that a number set may have.
const MAX_BITS: u32 = 256;

/// The bytes of a set's bitmap, which must lie within the `room` bytes that follow its head.
#[inline(always)]
pub(crate) fn bitmap_len(bits: u32, room: u32) -> Result<u32, Reason> {
    if bits > MAX_BITS {
        return Err(Reason::NumberSetBits);
    }
    let len = bits.div_ceil(32) * 4;
    if len > room {
        return Err(Reason::NumberSetBitmap);
    }
    Ok(len)
}

/// Whether a set may begin at sequence number `base`: not below `first`, and no bit of it may
/// stand for a number that does not exist.
#[inline(always)]
pub(crate) fn check_sequence_base(base: i64, first: i64) -> Result<(), Reason> {
    if base < first || base > i64::MAX - MAX_BITS as i64 {
        return Err(Reason::NumberSetBase);
    }
    Ok(())
}

/// The same for fragment numbers, which begin at 1.
#[inline(always)]
pub(crate) fn check_fragment_base(base: u32) -> Result<(), Reason> {
    if base == 0 || base > u32::MAX - MAX_BITS {
        return Err(Reason::NumberSetBase);
    }
    Ok(())
}
