//! DATA_FRAG: consecutive fragments of a change that does not fit a datagram (RTPS 2.5 sections 8.3.8.3 and
//! 9.4.5.4).

use super::{InlineQos, PayloadKind, data::decode_prologue};
use crate::wire::{Cursor, EntityId, SequenceNumber, WireError};

/// A DATA_FRAG submessage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DataFrag<'a> {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer that sends it.
    pub writer: EntityId,
    /// The change's number.
    pub sequence: SequenceNumber,
    /// The number of the first fragment in here, from 1.
    pub first_fragment: u32,
    /// How many fragments are in here.
    pub fragment_count: u16,
    /// Bytes of each fragment but the last of the sample.
    pub fragment_size: u16,
    /// Bytes of the whole serialized payload.
    pub sample_size: u32,
    /// What is said beside the payload.
    pub inline_qos: InlineQos,
    /// What the payload is.
    pub kind: PayloadKind,
    /// The bytes of the fragments, exactly as many as count, size and sample size promise.
    pub payload: &'a [u8],
}

/// As in DATA, and fragment number, count, size and sample size.
const OCTETS_TO_INLINE_QOS: u16 = 28;

impl<'a> DataFrag<'a> {
    const FLAG_INLINE_QOS: u8 = 0x02;
    const FLAG_KEY: u8 = 0x04;

    #[inline]
    pub(super) fn decode(flags: u8, cursor: &mut Cursor<'a>) -> Result<Self, WireError> {
        let (mut first_fragment, mut fragment_count, mut fragment_size, mut sample_size) =
            (0, 0, 0, 0);
        let (reader, writer, sequence) = decode_prologue(cursor, |cursor| {
            first_fragment = cursor.u32()?;
            fragment_count = cursor.u16()?;
            fragment_size = cursor.u16()?;
            sample_size = cursor.u32()?;
            Ok(())
        })?;
        let inline_qos = match flags & Self::FLAG_INLINE_QOS {
            0 => InlineQos::default(),
            _ => InlineQos::decode(cursor, &mut None)?,
        };
        let kind = if flags & Self::FLAG_KEY == 0 {
            PayloadKind::Data
        } else {
            PayloadKind::Key
        };
        let mut fragment = Self {
            reader,
            writer,
            sequence,
            first_fragment,
            fragment_count,
            fragment_size,
            sample_size,
            inline_qos,
            kind,
            payload: &[],
        };
        let length = fragment.payload_len().ok_or(WireError::InvalidFragment)?;
        fragment.payload = cursor
            .take(length)
            .map_err(|_| WireError::InvalidFragment)?;
        Ok(fragment)
    }

    /// Where the payload starts in the sample, in bytes.
    #[inline]
    pub fn offset(&self) -> usize {
        (self.first_fragment as usize)
            .saturating_sub(1)
            .saturating_mul(usize::from(self.fragment_size))
    }

    /// Bytes that the fragments have; `None` where they cannot lie in the sample.
    #[inline]
    fn payload_len(&self) -> Option<usize> {
        if self.first_fragment == 0 || self.fragment_count == 0 || self.fragment_size == 0 {
            return None;
        }
        let (size, sample) = (u64::from(self.fragment_size), u64::from(self.sample_size));
        let start = u64::from(self.first_fragment - 1) * size;
        let end = start + u64::from(self.fragment_count) * size;
        // Only the last fragment of the sample may be short.
        if start >= sample || end >= sample + size {
            return None;
        }
        usize::try_from(end.min(sample) - start).ok()
    }

    /// `more` says whether other parameters than [`inline_qos`](Self::inline_qos) stand beside them.
    pub(in crate::wire) fn flags(&self, more: bool) -> u8 {
        let key = if self.kind == PayloadKind::Key {
            Self::FLAG_KEY
        } else {
            0
        };
        key | if self.inline_qos.is_empty() && !more {
            0
        } else {
            Self::FLAG_INLINE_QOS
        }
    }

    pub(in crate::wire) fn encode(&self, more: &[u8], out: &mut Vec<u8>) {
        out.extend_from_slice(&[0, 0]);
        out.extend_from_slice(&OCTETS_TO_INLINE_QOS.to_le_bytes());
        out.extend_from_slice(&self.reader.0);
        out.extend_from_slice(&self.writer.0);
        self.sequence.encode(out);
        out.extend_from_slice(&self.first_fragment.to_le_bytes());
        out.extend_from_slice(&self.fragment_count.to_le_bytes());
        out.extend_from_slice(&self.fragment_size.to_le_bytes());
        out.extend_from_slice(&self.sample_size.to_le_bytes());
        self.inline_qos.encode(more, out);
        out.extend_from_slice(self.payload);
    }
}
