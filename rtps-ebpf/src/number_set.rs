//! SequenceNumberSet and FragmentNumberSet (RTPS 2.5, 9.4.2.6 and 9.4.2.8).

use crate::counter::Reason;

/// Bits that a number set may have.
pub(crate) const MAX_BITS: u32 = 256;

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

/// The bits of a number set; bit 0, which stands for the base, is the most significant of the first
/// word (RTPS 2.5, 9.4.2.6).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bits([u32; WORDS]);

/// Words of a full set.
pub(crate) const WORDS: usize = 8;

impl Bits {
    /// None set.
    pub(crate) const EMPTY: Self = Self([0; WORDS]);

    /// Whether a bit below 256 is set.
    #[inline(always)]
    pub(crate) const fn contains(&self, bit: u32) -> bool {
        self.0[Self::word_of(bit)] & Self::mask_of(bit) != 0
    }

    /// Sets a bit below 256.
    #[inline(always)]
    pub(crate) const fn insert(&mut self, bit: u32) {
        self.0[Self::word_of(bit)] |= Self::mask_of(bit);
    }

    /// Clears a bit below 256.
    #[inline(always)]
    pub(crate) const fn remove(&mut self, bit: u32) {
        self.0[Self::word_of(bit)] &= !Self::mask_of(bit);
    }

    /// Clears all bits.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        for word in &mut self.0 {
            *word = 0;
        }
    }

    /// The words, as they stand on the wire.
    #[inline(always)]
    pub(crate) const fn words(&self) -> &[u32; WORDS] {
        &self.0
    }

    /// The same, to be filled from the wire.
    #[inline(always)]
    pub(crate) const fn words_mut(&mut self) -> &mut [u32; WORDS] {
        &mut self.0
    }

    /// Masked rather than checked: so the compiler needs no panic, and the verifier sees the bound.
    #[inline(always)]
    const fn word_of(bit: u32) -> usize {
        (bit >> 5 & 7) as usize
    }

    #[inline(always)]
    const fn mask_of(bit: u32) -> u32 {
        1 << (31 - (bit & 31))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_stand_where_the_wire_has_them() {
        let mut bits = Bits::EMPTY;
        for bit in [0, 31, 32, 255] {
            assert!(!bits.contains(bit));
            bits.insert(bit);
            assert!(bits.contains(bit));
        }
        assert_eq!(*bits.words(), [0x8000_0001, 1 << 31, 0, 0, 0, 0, 0, 1]);
        bits.remove(31);
        assert_eq!(bits.words()[0], 1 << 31);
        bits.clear();
        assert_eq!(bits, Bits::EMPTY);
    }
}
