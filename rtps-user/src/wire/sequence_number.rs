//! Sequence numbers and the bounded sets of them that ACKNACK, GAP and NACK_FRAG carry
//! (RTPS 2.5 sections 9.4.2.3, 9.4.2.6 and 9.4.2.8).

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Cursor, WireError};

/// The number of a change of a writer: 1, 2, 3, ... On the wire a signed high and an unsigned low word.
#[derive(
    Clone, Copy, Debug, Default, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize,
)]
pub struct SequenceNumber(pub i64);

impl SequenceNumber {
    /// SEQUENCENUMBER_UNKNOWN, -2^32.
    pub const UNKNOWN: Self = Self(-(1 << 32));
    /// Before the first change.
    pub const ZERO: Self = Self(0);

    /// The number after this one.
    #[must_use]
    pub fn next(self) -> Self {
        self.plus(1)
    }

    /// The number before this one.
    #[must_use]
    pub fn previous(self) -> Self {
        self.plus(-1)
    }

    /// Saturating addition: numbers from the wire may be anything.
    #[must_use]
    pub fn plus(self, distance: i64) -> Self {
        Self(self.0.saturating_add(distance))
    }

    /// Reads high and low word.
    #[inline]
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let high = cursor.i32()?;
        let low = cursor.u32()?;
        Ok(Self((i64::from(high) << 32) | i64::from(low)))
    }

    /// Writes high and low word, little endian.
    pub fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_bytes());
    }

    /// High and low word, little endian.
    pub(super) fn to_bytes(self) -> [u8; 8] {
        self.0.rotate_left(32).to_le_bytes()
    }
}

impl fmt::Display for SequenceNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Bits 0..`len` of a window of at most 256; bit 0 is the most significant of the first word.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
struct Bitmap {
    len: u32,
    words: [u32; 8],
}

impl Bitmap {
    const MAX_BITS: u32 = 256;

    fn insert(&mut self, bit: u32) {
        if let Some(word) = self.words.get_mut((bit / 32) as usize) {
            *word |= 1 << (31 - bit % 32);
            self.len = self.len.max(bit + 1);
        }
    }

    fn contains(&self, bit: u32) -> bool {
        bit < self.len
            && self
                .words
                .get((bit / 32) as usize)
                .is_some_and(|word| word & (1 << (31 - bit % 32)) != 0)
    }

    fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.len).filter(|bit| self.contains(*bit))
    }

    fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let len = cursor.u32()?;
        if len > Self::MAX_BITS {
            return Err(WireError::InvalidSet);
        }
        let mut words = [0; 8];
        for word in words.iter_mut().take(len.div_ceil(32) as usize) {
            *word = cursor.u32().map_err(|_| WireError::InvalidSet)?;
        }
        Ok(Self { len, words })
    }

    fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.len.to_le_bytes());
        for word in self.words.iter().take(self.len.div_ceil(32) as usize) {
            out.extend_from_slice(&word.to_le_bytes());
        }
    }
}

/// Up to 256 sequence numbers from `base` on.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct SequenceNumberSet {
    /// The number of bit 0. In an ACKNACK everything below it is acknowledged.
    pub base: SequenceNumber,
    bitmap: Bitmap,
}

impl SequenceNumberSet {
    /// How many numbers a set spans at the most.
    pub const MAX_SPAN: i64 = 256;

    /// The empty set at `base`.
    pub fn empty(base: SequenceNumber) -> Self {
        Self {
            base,
            bitmap: Bitmap::default(),
        }
    }

    /// The numbers of `members` that lie in the 256 from `base` on.
    pub fn from_members(
        base: SequenceNumber,
        members: impl IntoIterator<Item = SequenceNumber>,
    ) -> Self {
        let mut set = Self::empty(base);
        for member in members {
            set.insert(member);
        }
        set
    }

    /// Adds `member`; false, and nothing done, where it lies outside of the 256 from the base on.
    pub fn insert(&mut self, member: SequenceNumber) -> bool {
        let distance = member.0.saturating_sub(self.base.0);
        if !(0..Self::MAX_SPAN).contains(&distance) {
            return false;
        }
        self.bitmap.insert(distance as u32);
        true
    }

    /// Whether `number` is in the set.
    pub fn contains(&self, number: SequenceNumber) -> bool {
        let distance = number.0.saturating_sub(self.base.0);
        (0..Self::MAX_SPAN).contains(&distance) && self.bitmap.contains(distance as u32)
    }

    /// The members in order.
    pub fn iter(&self) -> impl Iterator<Item = SequenceNumber> + '_ {
        self.bitmap.iter().map(|bit| self.base.plus(i64::from(bit)))
    }

    /// Whether it has no member.
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// Reads base, number of bits and bitmap; the base must be positive (RTPS 9.4.2.6).
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let base = SequenceNumber::decode(cursor)?;
        let bitmap = Bitmap::decode(cursor)?;
        if base.0 < 0 || base.0.checked_add(Self::MAX_SPAN).is_none() {
            return Err(WireError::InvalidSet);
        }
        Ok(Self { base, bitmap })
    }

    /// Writes base, number of bits and bitmap, little endian.
    pub fn encode(&self, out: &mut Vec<u8>) {
        self.base.encode(out);
        self.bitmap.encode(out);
    }
}

/// Up to 256 fragment numbers from `base` on; fragments are counted from 1.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct FragmentNumberSet {
    /// The number of bit 0.
    pub base: u32,
    bitmap: Bitmap,
}

impl FragmentNumberSet {
    /// How many numbers a set spans at the most.
    pub const MAX_SPAN: u32 = 256;

    /// The numbers of `members` that lie in the 256 from `base` on.
    pub fn from_members(base: u32, members: impl IntoIterator<Item = u32>) -> Self {
        let mut bitmap = Bitmap::default();
        for distance in members
            .into_iter()
            .filter_map(|member| member.checked_sub(base))
        {
            bitmap.insert(distance);
        }
        Self { base, bitmap }
    }

    /// The set without members that says of `base` alone that it is not among them: on the wire a set has at least one
    /// number that it says something of.
    pub fn nothing(base: u32) -> Self {
        let bitmap = Bitmap {
            len: 1,
            ..Bitmap::default()
        };
        Self { base, bitmap }
    }

    /// The numbers that it says something of: its members, and those between them.
    pub fn span(&self) -> Range<u32> {
        self.base..self.base.saturating_add(self.bitmap.len)
    }

    /// The members in order.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.bitmap.iter().map(|bit| self.base.saturating_add(bit))
    }

    /// Reads base, number of bits and bitmap; the base must be positive.
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let base = cursor.u32()?;
        let bitmap = Bitmap::decode(cursor)?;
        if base == 0 || base.checked_add(Self::MAX_SPAN).is_none() {
            return Err(WireError::InvalidSet);
        }
        Ok(Self { base, bitmap })
    }

    /// Writes base, number of bits and bitmap, little endian.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.base.to_le_bytes());
        self.bitmap.encode(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Endianness;

    fn set(base: i64, members: &[i64]) -> SequenceNumberSet {
        SequenceNumberSet::from_members(
            SequenceNumber(base),
            members.iter().copied().map(SequenceNumber),
        )
    }

    #[test]
    fn the_example_of_the_standard() {
        // RTPS 9.4.2.6: 1234:/12:00110 is base 1234, 12 bits, members 1236 and 1237.
        let mut bytes = Vec::new();
        let mut example = set(1234, &[1236, 1237]);
        example.bitmap.len = 12;
        example.encode(&mut bytes);
        assert_eq!(
            bytes,
            [0, 0, 0, 0, 0xd2, 4, 0, 0, 12, 0, 0, 0, 0, 0, 0, 0x30]
        );
        let decoded =
            SequenceNumberSet::decode(&mut Cursor::new(&bytes, Endianness::Little)).unwrap();
        assert_eq!(decoded, example);
        assert_eq!(
            decoded.iter().map(|n| n.0).collect::<Vec<_>>(),
            [1236, 1237]
        );
    }

    #[test]
    fn members_outside_the_window_are_left_out() {
        let set = set(10, &[9, 10, 265, 266]);
        assert_eq!(set.iter().map(|n| n.0).collect::<Vec<_>>(), [10, 265]);
        assert!(set.contains(SequenceNumber(265)));
        assert!(!set.contains(SequenceNumber(i64::MIN)));
    }

    #[test]
    fn too_many_bits_or_a_negative_base_are_refused() {
        let mut bytes = vec![0, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0];
        bytes.resize(64, 0xff);
        assert_eq!(
            SequenceNumberSet::decode(&mut Cursor::new(&bytes, Endianness::Little)),
            Err(WireError::InvalidSet)
        );
        let negative = [0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!(
            SequenceNumberSet::decode(&mut Cursor::new(&negative, Endianness::Little)),
            Err(WireError::InvalidSet)
        );
    }
}
