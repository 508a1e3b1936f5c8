//! ACKNACK: a reliable reader tells its writer what it has and lacks (RTPS 2.5 sections 8.3.8.1 and 9.4.5.2).

use crate::wire::{Cursor, EntityId, SequenceNumberSet, WireError};

/// An ACKNACK submessage.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct AckNack {
    /// The reader that sends it.
    pub reader: EntityId,
    /// The writer that it is for.
    pub writer: EntityId,
    /// All below the base is acknowledged; the members are missing.
    pub state: SequenceNumberSet,
    /// Grows with each ACKNACK, so that the writer recognises duplicates.
    pub count: i32,
    /// The writer need not answer with a HEARTBEAT.
    pub is_final: bool,
}

impl AckNack {
    const FLAG_FINAL: u8 = 0x02;

    pub(super) fn decode(flags: u8, cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        Ok(Self {
            reader: EntityId(cursor.array()?),
            writer: EntityId(cursor.array()?),
            state: SequenceNumberSet::decode(cursor)?,
            count: cursor.i32()?,
            is_final: flags & Self::FLAG_FINAL != 0,
        })
    }

    pub(in crate::wire) fn flags(&self) -> u8 {
        if self.is_final { Self::FLAG_FINAL } else { 0 }
    }

    pub(in crate::wire) fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.state.encode(out);
        out.extend_from_slice(&self.count.to_le_bytes());
    }
}
