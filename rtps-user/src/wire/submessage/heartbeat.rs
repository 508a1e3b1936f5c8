//! HEARTBEAT: a reliable writer tells its readers which changes it has (RTPS 2.5 sections 8.3.8.6 and 9.4.5.7).

use super::GroupDigest;
use crate::wire::{Cursor, EntityId, SequenceNumber, WireError};

/// A HEARTBEAT submessage.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Heartbeat {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer that sends it.
    pub writer: EntityId,
    /// The oldest change that the writer has.
    pub first: SequenceNumber,
    /// The newest change that the writer has; `first - 1` when it has none.
    pub last: SequenceNumber,
    /// Grows with each HEARTBEAT, so that readers recognise duplicates.
    pub count: i32,
    /// The reader need not answer when it lacks nothing.
    pub is_final: bool,
    /// The writer asserts its liveliness with it.
    pub liveliness: bool,
    /// What the writer says of its publisher, where that has GROUP scope.
    pub group: Option<HeartbeatGroup>,
}

/// The group fields of a HEARTBEAT (RTPS 2.5 section 8.3.8.6).
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct HeartbeatGroup {
    /// currentGSN: the newest group sequence number that the writer knows of its publisher.
    pub current: SequenceNumber,
    /// firstGSN: that of the oldest change that the writer has.
    pub first: SequenceNumber,
    /// lastGSN: that of the newest change that the writer has.
    pub last: SequenceNumber,
    /// writerSet.
    pub writers: GroupDigest,
    /// secureWriterSet.
    pub secure_writers: GroupDigest,
}

impl HeartbeatGroup {
    fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        Ok(Self {
            current: SequenceNumber::decode(cursor)?,
            first: SequenceNumber::decode(cursor)?,
            last: SequenceNumber::decode(cursor)?,
            writers: GroupDigest(cursor.array()?),
            secure_writers: GroupDigest(cursor.array()?),
        })
    }

    fn encode(&self, out: &mut Vec<u8>) {
        for number in [self.current, self.first, self.last] {
            number.encode(out);
        }
        out.extend_from_slice(&self.writers.0);
        out.extend_from_slice(&self.secure_writers.0);
    }
}

impl Heartbeat {
    const FLAG_FINAL: u8 = 0x02;
    const FLAG_LIVELINESS: u8 = 0x04;
    const FLAG_GROUP_INFO: u8 = 0x08;

    pub(super) fn decode(flags: u8, cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        let heartbeat = Self {
            reader: EntityId(cursor.array()?),
            writer: EntityId(cursor.array()?),
            first: SequenceNumber::decode(cursor)?,
            last: SequenceNumber::decode(cursor)?,
            count: cursor.i32()?,
            is_final: flags & Self::FLAG_FINAL != 0,
            liveliness: flags & Self::FLAG_LIVELINESS != 0,
            group: match flags & Self::FLAG_GROUP_INFO {
                0 => None,
                _ => Some(HeartbeatGroup::decode(cursor)?),
            },
        };
        // RTPS 8.3.8.6.3: first positive, last not negative and at least first - 1. Some vendors say first = 0
        // for an empty writer, which older versions of the standard allowed.
        let valid = heartbeat.first.0 >= 0
            && heartbeat.last.0 >= 0
            && heartbeat.last >= heartbeat.first.previous();
        if valid {
            Ok(heartbeat)
        } else {
            Err(WireError::InvalidRange)
        }
    }

    pub(in crate::wire) fn flags(&self) -> u8 {
        [
            (self.is_final, Self::FLAG_FINAL),
            (self.liveliness, Self::FLAG_LIVELINESS),
            (self.group.is_some(), Self::FLAG_GROUP_INFO),
        ]
        .into_iter()
        .filter(|(is_set, _)| *is_set)
        .fold(0, |flags, (_, flag)| flags | flag)
    }

    pub(in crate::wire) fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.first.encode(out);
        self.last.encode(out);
        out.extend_from_slice(&self.count.to_le_bytes());
        if let Some(group) = &self.group {
            group.encode(out);
        }
    }
}
