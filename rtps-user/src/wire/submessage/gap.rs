//! GAP: changes of a writer that are irrelevant to a reader and will not come (RTPS 2.5 sections 8.3.8.4
//! and 9.4.5.5).

use crate::wire::{Cursor, EntityId, SequenceNumber, SequenceNumberSet, WireError};

/// A GAP submessage: the range from `start` to just below the base of `list`, and the members of `list`.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Gap {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer that sends it.
    pub writer: EntityId,
    /// The first of the range.
    pub start: SequenceNumber,
    /// Its base ends the range (exclusive).
    pub list: SequenceNumberSet,
}

impl Gap {
    pub(super) fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let gap = Self {
            reader: EntityId(cursor.array()?),
            writer: EntityId(cursor.array()?),
            start: SequenceNumber::decode(cursor)?,
            list: SequenceNumberSet::decode(cursor)?,
        };
        if gap.start.0 <= 0 || gap.list.base < gap.start {
            return Err(WireError::InvalidRange);
        }
        Ok(gap)
    }

    pub(in crate::wire) fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.start.encode(out);
        self.list.encode(out);
    }
}
