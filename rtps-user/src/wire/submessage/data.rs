//! DATA: a change of a writer (RTPS 2.5 sections 8.3.8.2 and 9.4.5.3).

use super::{ContentFilterInfo, InlineQos};
use crate::wire::{Cursor, EntityId, SequenceNumber, WireError};

/// What the serialized payload of a DATA or DATA_FRAG is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum PayloadKind {
    /// There is none.
    None,
    /// A whole sample.
    Data,
    /// Only the key of an instance: the change disposes or unregisters it.
    Key,
}

/// A DATA submessage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Data<'a> {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer that sends it.
    pub writer: EntityId,
    /// The change's number.
    pub sequence: SequenceNumber,
    /// What is said beside the payload.
    pub inline_qos: InlineQos,
    /// What filters have said of it at the writer.
    pub filters: Option<ContentFilterInfo<'a>>,
    /// What the payload is.
    pub kind: PayloadKind,
    /// The serialized payload with its encapsulation header.
    pub payload: &'a [u8],
}

/// Bytes from behind the field octetsToInlineQos to the inline QoS or payload: two entity ids, the number.
const OCTETS_TO_INLINE_QOS: u16 = 16;
/// Bytes before inline QoS and payload.
const PROLOGUE_LEN: usize = 4 + OCTETS_TO_INLINE_QOS as usize;

impl<'a> Data<'a> {
    const FLAG_INLINE_QOS: u8 = 0x02;
    const FLAG_DATA: u8 = 0x04;
    const FLAG_KEY: u8 = 0x08;

    #[inline]
    pub(super) fn decode(flags: u8, cursor: &mut Cursor<'a>) -> Result<Self, WireError> {
        let kind = match (flags & Self::FLAG_DATA != 0, flags & Self::FLAG_KEY != 0) {
            (false, false) => PayloadKind::None,
            (true, false) => PayloadKind::Data,
            (false, true) => PayloadKind::Key,
            (true, true) => return Err(WireError::InvalidData),
        };
        let (reader, writer, sequence) = decode_prologue(cursor, |_| Ok(()))?;
        let mut filters = None;
        let inline_qos = match flags & Self::FLAG_INLINE_QOS {
            0 => InlineQos::default(),
            _ => InlineQos::decode(cursor, &mut filters)?,
        };
        let payload = if kind == PayloadKind::None {
            &[][..]
        } else {
            cursor.rest()
        };
        Ok(Self {
            reader,
            writer,
            sequence,
            inline_qos,
            filters,
            kind,
            payload,
        })
    }

    /// `more` says whether other parameters than [`inline_qos`](Self::inline_qos) stand beside them. Filters are among those.
    pub(in crate::wire) fn flags(&self, more: bool) -> u8 {
        let payload = match self.kind {
            PayloadKind::None => 0,
            PayloadKind::Data => Self::FLAG_DATA,
            PayloadKind::Key => Self::FLAG_KEY,
        };
        payload
            | if self.inline_qos.is_empty() && !more {
                0
            } else {
                Self::FLAG_INLINE_QOS
            }
    }

    pub(in crate::wire) fn encode(&self, more: &[u8], out: &mut Vec<u8>) {
        // At once, as this is done for every sample.
        let mut prologue = [0; PROLOGUE_LEN];
        prologue[2..4].copy_from_slice(&OCTETS_TO_INLINE_QOS.to_le_bytes());
        prologue[4..8].copy_from_slice(&self.reader.0);
        prologue[8..12].copy_from_slice(&self.writer.0);
        prologue[12..].copy_from_slice(&self.sequence.to_bytes());
        out.extend_from_slice(&prologue);
        self.inline_qos.encode(more, out);
        out.extend_from_slice(self.payload);
    }
}

/// Reads what DATA and DATA_FRAG begin with, then `more`, then skips what a later version may have put before
/// the inline QoS.
#[inline]
pub(super) fn decode_prologue<'a>(
    cursor: &mut Cursor<'a>,
    more: impl FnOnce(&mut Cursor<'a>) -> Result<(), WireError>,
) -> Result<(EntityId, EntityId, SequenceNumber), WireError> {
    cursor.take(2)?;
    let octets_to_inline_qos = usize::from(cursor.u16()?);
    let start = cursor.position();
    let reader = EntityId(cursor.array()?);
    let writer = EntityId(cursor.array()?);
    let sequence = SequenceNumber::decode(cursor)?;
    more(cursor)?;
    let read = cursor.position() - start;
    let skip = octets_to_inline_qos
        .checked_sub(read)
        .ok_or(WireError::InvalidData)?;
    cursor.take(skip).map_err(|_| WireError::InvalidData)?;
    if sequence.0 <= 0 {
        return Err(WireError::InvalidRange);
    }
    Ok((reader, writer, sequence))
}
