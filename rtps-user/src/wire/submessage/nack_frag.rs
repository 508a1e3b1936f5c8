//! NACK_FRAG: the fragments of a change that a reliable reader lacks (RTPS 2.5 sections 8.3.8.11 and 9.4.5.14).

use crate::wire::{Cursor, EntityId, FragmentNumberSet, SequenceNumber, WireError};

/// A NACK_FRAG submessage.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct NackFrag {
    /// The reader that sends it.
    pub reader: EntityId,
    /// The writer that it is for.
    pub writer: EntityId,
    /// The fragmented change.
    pub sequence: SequenceNumber,
    /// What is missing of it.
    pub missing: FragmentNumberSet,
    /// Grows with each NACK_FRAG.
    pub count: i32,
}

impl NackFrag {
    pub(super) fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let nack = Self {
            reader: EntityId(cursor.array()?),
            writer: EntityId(cursor.array()?),
            sequence: SequenceNumber::decode(cursor)?,
            missing: FragmentNumberSet::decode(cursor)?,
            count: cursor.i32()?,
        };
        if nack.sequence.0 <= 0 {
            Err(WireError::InvalidRange)
        } else {
            Ok(nack)
        }
    }

    pub(in crate::wire) fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.sequence.encode(out);
        self.missing.encode(out);
        out.extend_from_slice(&self.count.to_le_bytes());
    }
}
