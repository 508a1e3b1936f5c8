//! What a writer's filtering says of a sample (ContentFilterInfo_t, RTPS 2.5 sections 8.7.2 and 9.6.4.1).

use std::collections::BTreeSet;

use crate::wire::{Cursor, Endianness, ParameterId, ParameterWriter};

/// FilterSignature_t: the MD5 of a reader's filter, name and parameters included.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub struct FilterSignature(pub [u8; 16]);

/// The filters that a sample was put to, and the result of each, as a list that is read when it is looked into. One that is
/// malformed names none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContentFilterInfo<'a> {
    value: &'a [u8],
    endianness: Endianness,
}

impl<'a> ContentFilterInfo<'a> {
    /// From the value of PID_CONTENT_FILTER_INFO.
    pub(super) fn new(value: Cursor<'a>) -> Self {
        Self {
            value: value.rest(),
            endianness: value.endianness(),
        }
    }

    /// Whether the sample has passed a filter; `None` where nothing is said of that one.
    pub fn result_of(&self, signature: FilterSignature) -> Option<bool> {
        let mut value = Cursor::new(self.value, self.endianness);
        let words = usize::try_from(value.u32().ok()?).ok()?;
        let results = value.take(words.checked_mul(4)?).ok()?;
        let count = usize::try_from(value.u32().ok()?).ok()?;
        let signatures = value.take(count.checked_mul(16)?).ok()?;
        if words != count.div_ceil(32) {
            return None;
        }
        let (signatures, _) = signatures.as_chunks();
        let place = signatures.iter().position(|known| *known == signature.0)?;
        let mut word = Cursor::new(results.get(place / 32 * 4..)?, value.endianness());
        Some(word.u32().ok()? & Self::bit(place) != 0)
    }

    /// Appends that a sample has passed all these filters.
    pub fn write_passed(signatures: &BTreeSet<FilterSignature>, list: &mut ParameterWriter<'_>) {
        let words = signatures.len().div_ceil(32);
        list.parameter(ParameterId::CONTENT_FILTER_INFO, |value| {
            value.extend_from_slice(&(words as u32).to_le_bytes());
            for word in 0..words {
                let places = word * 32..signatures.len().min(word * 32 + 32);
                let bits = places.fold(0, |bits, place| bits | Self::bit(place));
                value.extend_from_slice(&bits.to_le_bytes());
            }
            value.extend_from_slice(&(signatures.len() as u32).to_le_bytes());
            for FilterSignature(signature) in signatures {
                value.extend_from_slice(signature);
            }
        });
    }

    /// The bit of a result in its word: the first filter has the highest.
    fn bit(place: usize) -> u32 {
        1 << (31 - place % 32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signature(number: u8) -> FilterSignature {
        FilterSignature([number; 16])
    }

    /// The results of the filters 0 to 39.
    fn results(bytes: &[u8], endianness: Endianness) -> Vec<Option<bool>> {
        let info = ContentFilterInfo::new(Cursor::new(bytes, endianness));
        (0..40)
            .map(|number| info.result_of(signature(number)))
            .collect()
    }

    /// A list of the filters from 0 on, in big endian.
    fn list(words: &[u32], count: u8) -> Vec<u8> {
        let mut bytes = (words.len() as u32).to_be_bytes().to_vec();
        bytes.extend(words.iter().flat_map(|word| word.to_be_bytes()));
        bytes.extend(u32::from(count).to_be_bytes());
        bytes.extend((0..count).flat_map(|number| signature(number).0));
        bytes
    }

    #[test]
    fn what_is_written_is_read() {
        for count in [1, 31, 32, 33, 40] {
            let mut bytes = Vec::new();
            let signatures = (0..count).map(signature).collect();
            ContentFilterInfo::write_passed(&signatures, &mut ParameterWriter::new(&mut bytes));
            assert_eq!(bytes[..2], [0x55, 0]);
            let results = results(&bytes[4..], Endianness::Little);
            for (number, result) in results.into_iter().enumerate() {
                assert_eq!(result, (number < usize::from(count)).then_some(true));
            }
        }
    }

    #[test]
    fn the_first_filter_has_the_highest_bit() {
        let results = results(&list(&[0x8000_0001, 0x4000_0000], 34), Endianness::Big);
        let passed = results.iter().enumerate();
        let passed = passed.filter(|(_, result)| **result == Some(true));
        let passed: Vec<_> = passed.map(|(number, _)| number).collect();
        assert_eq!(passed, [0, 31, 33]);
        assert_eq!(results[1], Some(false));
        assert_eq!(results[34], None);
    }

    #[test]
    fn what_is_malformed_says_nothing() {
        let whole = list(&[u32::MAX], 3);
        for len in 0..whole.len() {
            assert_eq!(results(&whole[..len], Endianness::Big), [None; 40], "{len}");
        }
        for (words, count) in [(&[][..], 1), (&[1, 1], 3), (&[1], 33)] {
            assert_eq!(results(&list(words, count), Endianness::Big), [None; 40]);
        }
        assert_eq!(results(&[0xff; 64], Endianness::Big), [None; 40]);
    }
}
