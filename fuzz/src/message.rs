//! Messages whose fields are whatever the fuzzer wants.

use arbitrary::Arbitrary;
use rtps_user::wire::{EntityId, GuidPrefix, Header, SequenceNumber, SubmessageKind};

const FLAG_LITTLE_ENDIAN: u8 = 1;

/// A sequence or count number: mostly one that makes sense.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Number {
    /// So far from where the endpoint is.
    Near(i8),
    /// Any.
    Any(i64),
}

impl Number {
    /// The number that it stands for where the endpoint is at `base`.
    pub fn from(self, base: i64) -> SequenceNumber {
        match self {
            Self::Near(distance) => SequenceNumber(base.saturating_add(distance.into())),
            Self::Any(number) => SequenceNumber(number),
        }
    }
}

/// A message in the making.
pub struct Message(Vec<u8>);

impl Message {
    /// With nothing but a header.
    pub fn new(source: GuidPrefix) -> Self {
        let mut bytes = Vec::new();
        Header::encode(source, &mut bytes);
        Self(bytes)
    }

    /// Adds a submessage.
    pub fn submessage(mut self, kind: SubmessageKind, flags: u8, fields: &[&[u8]]) -> Self {
        let len = fields.iter().map(|field| field.len()).sum::<usize>();
        let len = u16::try_from(len.next_multiple_of(4)).unwrap_or(0);
        self.0.extend([kind.0, flags | FLAG_LITTLE_ENDIAN]);
        self.0.extend(len.to_le_bytes());
        let start = self.0.len();
        fields.iter().for_each(|field| self.0.extend(*field));
        let padded = (self.0.len() - start).next_multiple_of(4);
        self.0.resize(start + padded, 0);
        self
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// A sequence number as it is on the wire.
pub fn sequence(number: SequenceNumber) -> [u8; 8] {
    let mut bytes = Vec::new();
    number.encode(&mut bytes);
    bytes.try_into().expect("eight bytes")
}

/// A sequence number set of up to 64 members as it is on the wire.
pub fn sequence_set(base: SequenceNumber, count: u8, members: u64) -> Vec<u8> {
    let count = u32::from(count) % 65;
    let mut bytes = sequence(base).to_vec();
    bytes.extend(count.to_le_bytes());
    let words = [(members >> 32) as u32, members as u32];
    for word in words.iter().take(count.div_ceil(32) as usize) {
        bytes.extend(word.to_le_bytes());
    }
    bytes
}

/// Reader and writer, with which most submessages begin.
pub fn entities(reader: EntityId, writer: EntityId) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&reader.0);
    bytes[4..].copy_from_slice(&writer.0);
    bytes
}
