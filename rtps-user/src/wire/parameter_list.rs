//! Parameter lists: discovery data and inline QoS as (id, length, value) triples with a sentinel
//! (RTPS 2.5 sections 9.4.2.11 and 9.6.3).

use super::{Cursor, Endianness, WireError};

/// ParameterId_t.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct ParameterId(pub u16);

impl ParameterId {
    /// Skipped.
    pub const PAD: Self = Self(0x0000);
    /// Ends a list.
    pub const SENTINEL: Self = Self(0x0001);
    /// PID_TOPIC_NAME.
    pub const TOPIC_NAME: Self = Self(0x0005);
    /// PID_LIFESPAN.
    pub const LIFESPAN: Self = Self(0x002b);
    /// PID_CONTENT_FILTER_INFO.
    pub const CONTENT_FILTER_INFO: Self = Self(0x0055);
    /// PID_COHERENT_SET.
    pub const COHERENT_SET: Self = Self(0x0056);
    /// PID_GROUP_COHERENT_SET.
    pub const GROUP_COHERENT_SET: Self = Self(0x0063);
    /// PID_GROUP_SEQ_NUM.
    pub const GROUP_SEQ_NUM: Self = Self(0x0064);
    /// PID_WRITER_GROUP_INFO.
    pub const WRITER_GROUP_INFO: Self = Self(0x0065);
    /// PID_KEY_HASH.
    pub const KEY_HASH: Self = Self(0x0070);
    /// PID_STATUS_INFO.
    pub const STATUS_INFO: Self = Self(0x0071);

    const FLAG_VENDOR: u16 = 0x8000;
    const FLAG_MUST_UNDERSTAND: u16 = 0x4000;

    /// Whether the sender wants a list with this parameter refused by who does not know it.
    pub fn must_understand(self) -> bool {
        self.0 & (Self::FLAG_MUST_UNDERSTAND | Self::FLAG_VENDOR) == Self::FLAG_MUST_UNDERSTAND
    }
}

/// One parameter.
#[derive(Clone, Debug)]
pub struct Parameter<'a> {
    /// What it is.
    pub id: ParameterId,
    /// Its value, aligned from its own start, in the byte order of the list.
    pub value: Cursor<'a>,
}

impl<'a> Parameter<'a> {
    /// The next one of a list; `None` at the sentinel.
    #[inline]
    pub(super) fn next(cursor: &mut Cursor<'a>) -> Result<Option<Self>, WireError> {
        let parameter = Self::decode(cursor);
        parameter.map_err(|_| WireError::InvalidParameterList)
    }

    #[inline]
    fn decode(cursor: &mut Cursor<'a>) -> Result<Option<Self>, WireError> {
        let id = ParameterId(cursor.u16()?);
        let length = cursor.u16()?;
        if id == ParameterId::SENTINEL {
            return Ok(None);
        }
        if length % 4 != 0 {
            return Err(WireError::InvalidParameterList);
        }
        let value = Cursor::new(cursor.take(usize::from(length))?, cursor.endianness());
        Ok(Some(Self { id, value }))
    }
}

/// A list whose structure has been checked up to its sentinel.
#[derive(Clone, Copy, Debug)]
pub struct ParameterList<'a> {
    bytes: &'a [u8],
    endianness: Endianness,
}

impl<'a> ParameterList<'a> {
    /// Checks the list that `bytes` begin with; gives it and its length with the sentinel.
    pub fn parse(bytes: &'a [u8], endianness: Endianness) -> Result<(Self, usize), WireError> {
        let mut cursor = Cursor::new(bytes, endianness);
        loop {
            let start = cursor.position();
            if Parameter::next(&mut cursor)?.is_none() {
                let bytes = bytes.get(..start).unwrap_or_default();
                return Ok((Self { bytes, endianness }, cursor.position()));
            }
        }
    }

    /// Checks a serialized payload: an encapsulation header (PL_CDR_BE 0x0002, PL_CDR_LE 0x0003) and a list.
    pub fn from_payload(payload: &'a [u8]) -> Result<Self, WireError> {
        let (header, list) = payload
            .split_first_chunk::<4>()
            .ok_or(WireError::UnexpectedEnd)?;
        let endianness = match header {
            [0, 2, ..] => Endianness::Big,
            [0, 3, ..] => Endianness::Little,
            _ => return Err(WireError::InvalidParameterList),
        };
        Self::parse(list, endianness).map(|(list, _)| list)
    }

    /// The parameters in order, padding left out.
    pub fn iter(&self) -> impl Iterator<Item = Parameter<'a>> + use<'a> {
        let mut cursor = Cursor::new(self.bytes, self.endianness);
        std::iter::from_fn(move || Parameter::next(&mut cursor).ok().flatten())
            .filter(|parameter| parameter.id != ParameterId::PAD)
    }
}

/// Writes a list, little endian, each value padded to a multiple of 4.
#[derive(Debug)]
pub struct ParameterWriter<'a> {
    out: &'a mut Vec<u8>,
}

impl<'a> ParameterWriter<'a> {
    /// Appends to `out`.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        Self { out }
    }

    /// Begins a serialized payload: the encapsulation header PL_CDR_LE.
    pub fn payload(out: &'a mut Vec<u8>) -> Self {
        out.extend_from_slice(&[0, 3, 0, 0]);
        Self { out }
    }

    /// Appends the parameter whose value `write` appends. A value of more than 65,532 bytes is left out, since
    /// the format has no way to write it.
    pub fn parameter(&mut self, id: ParameterId, write: impl FnOnce(&mut Vec<u8>)) {
        self.out.extend_from_slice(&id.0.to_le_bytes());
        let length_at = self.out.len();
        self.out.extend_from_slice(&[0, 0]);
        let start = self.out.len();
        write(self.out);
        let padded = (self.out.len() - start).next_multiple_of(4);
        match u16::try_from(padded) {
            Ok(length) => {
                self.out.resize(start + padded, 0);
                self.out[length_at..start].copy_from_slice(&length.to_le_bytes());
            }
            Err(_) => self.out.truncate(length_at - 2),
        }
    }

    /// Appends a parameter whose value is a number of words.
    pub(super) fn words<const N: usize>(&mut self, id: ParameterId, value: &[u8; N]) {
        const { assert!(N.is_multiple_of(4) && N <= u16::MAX as usize) };
        let [id, length] = [id.0, N as u16].map(u16::to_le_bytes);
        self.out
            .extend_from_slice(&[id[0], id[1], length[0], length[1]]);
        self.out.extend_from_slice(value);
    }

    /// Appends the sentinel.
    pub fn finish(self) {
        self.out
            .extend_from_slice(&ParameterId::SENTINEL.0.to_le_bytes());
        self.out.extend_from_slice(&[0, 0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: ParameterId = ParameterId(0x1234);

    fn list() -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = ParameterWriter::new(&mut bytes);
        writer.parameter(KNOWN, |value| value.extend_from_slice(&[1, 2, 3]));
        writer.parameter(ParameterId::PAD, |_| {});
        writer.finish();
        bytes
    }

    #[test]
    fn values_are_padded_and_found_again() {
        let bytes = list();
        assert_eq!(
            bytes,
            [0x34, 0x12, 4, 0, 1, 2, 3, 0, 0, 0, 0, 0, 1, 0, 0, 0]
        );
        let (list, length) = ParameterList::parse(&bytes, Endianness::Little).unwrap();
        assert_eq!(length, bytes.len());
        let values: Vec<_> = list
            .iter()
            .map(|parameter| (parameter.id, parameter.value.rest()))
            .collect();
        assert_eq!(values, [(KNOWN, &[1, 2, 3, 0][..])]);
    }

    #[test]
    fn truncated_lists_are_refused() {
        let bytes = list();
        for length in 0..bytes.len() {
            assert!(
                ParameterList::parse(&bytes[..length], Endianness::Little).is_err(),
                "{length}"
            );
        }
    }

    #[test]
    fn lengths_that_are_no_multiple_of_four_are_refused() {
        let mut bytes = list();
        bytes[2] = 3;
        assert!(ParameterList::parse(&bytes, Endianness::Little).is_err());
    }

    #[test]
    fn values_that_no_length_can_say_are_left_out() {
        let mut bytes = Vec::new();
        let mut writer = ParameterWriter::new(&mut bytes);
        writer.parameter(KNOWN, |value| value.extend_from_slice(&[7; 65_533]));
        writer.finish();
        assert_eq!(bytes, [1, 0, 0, 0]);
    }
}
