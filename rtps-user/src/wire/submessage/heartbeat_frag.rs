//! HEARTBEAT_FRAG: which fragments of a change its writer has so far (RTPS 2.5 sections 8.3.8.7 and 9.4.5.8).

use crate::wire::{Cursor, EntityId, SequenceNumber, WireError};

/// A HEARTBEAT_FRAG submessage.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct HeartbeatFrag {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer that sends it.
    pub writer: EntityId,
    /// The fragmented change.
    pub sequence: SequenceNumber,
    /// All fragments up to this one are there.
    pub last_fragment: u32,
    /// Grows with each HEARTBEAT_FRAG.
    pub count: i32,
}

impl HeartbeatFrag {
    pub(super) fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let heartbeat = Self {
            reader: EntityId(cursor.array()?),
            writer: EntityId(cursor.array()?),
            sequence: SequenceNumber::decode(cursor)?,
            last_fragment: cursor.u32()?,
            count: cursor.i32()?,
        };
        if heartbeat.sequence.0 <= 0 || heartbeat.last_fragment == 0 {
            return Err(WireError::InvalidRange);
        }
        Ok(heartbeat)
    }

    pub(in crate::wire) fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.sequence.encode(out);
        out.extend_from_slice(&self.last_fragment.to_le_bytes());
        out.extend_from_slice(&self.count.to_le_bytes());
    }
}
