//! ParticipantMessageData: one participant's assertion that its writers are alive (RTPS 2.5 sections 8.4.13 and
//! 9.6.3.4).

use std::time::{Duration, Instant};

use crate::wire::{Cursor, Endianness, GuidPrefix, KeyHash, WireError};

/// An assertion for all writers of one liveliness kind of a participant.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct ParticipantMessageData {
    /// Whose writers.
    pub participant: GuidPrefix,
    /// MANUAL_BY_PARTICIPANT ones; else AUTOMATIC ones.
    pub manual: bool,
}

const KIND_AUTOMATIC: [u8; 4] = [0, 0, 0, 1];
const KIND_MANUAL: [u8; 4] = [0, 0, 0, 2];

impl ParticipantMessageData {
    /// Reads a serialized payload, CDR of either byte order; `None` for other kinds, which vendors may define.
    pub fn decode(payload: &[u8]) -> Result<Option<Self>, WireError> {
        let mut cursor = Cursor::new(payload, Endianness::Big);
        match cursor.array::<4>()? {
            [0, 0 | 1, ..] => {}
            _ => return Err(WireError::InvalidParameterList),
        }
        let participant = GuidPrefix(cursor.array()?);
        let manual = match cursor.array()? {
            KIND_AUTOMATIC => false,
            KIND_MANUAL => true,
            _ => return Ok(None),
        };
        Ok(Some(Self {
            participant,
            manual,
        }))
    }

    /// Appends the serialized payload, CDR_LE, without data of its own.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&[0, 1, 0, 0]);
        out.extend_from_slice(&self.instance().0);
        out.extend_from_slice(&0_u32.to_le_bytes());
    }

    /// The instance of the topic: participant and kind.
    pub fn instance(&self) -> KeyHash {
        let kind = if self.manual {
            KIND_MANUAL
        } else {
            KIND_AUTOMATIC
        };
        let mut key = [0; 16];
        key[..12].copy_from_slice(&self.participant.0);
        key[12..].copy_from_slice(&kind);
        KeyHash(key)
    }
}

/// The instance of a payload of the topic.
pub(super) fn participant_message_instance(payload: &[u8]) -> Option<KeyHash> {
    let key = payload.get(4..)?.first_chunk::<16>()?;
    Some(KeyHash(*key))
}

/// When the layer asserts that AUTOMATIC writers of its apps are alive.
#[derive(Debug, Default)]
pub(super) struct Assertions {
    lease: Option<Duration>,
    next: Option<Instant>,
}

impl Assertions {
    /// Two may be lost or late.
    const PER_LEASE: u32 = 3;
    /// Shorter leases are asserted no more often than is possible.
    const MIN_PERIOD: Duration = Duration::from_millis(10);

    /// The shortest lease of all AUTOMATIC writers; none without such a writer. A shorter one than before is
    /// asserted at once.
    pub(super) fn set_lease(&mut self, now: Instant, lease: Option<Duration>) {
        if lease != self.lease {
            self.next = lease.map(|_| now);
            self.lease = lease;
        }
    }

    /// Whether it is time to assert.
    pub(super) fn expire(&mut self, now: Instant) -> bool {
        let Some(lease) = self.lease else {
            return false;
        };
        let is_due = self.next.is_some_and(|next| next <= now);
        if is_due {
            self.next = Some(now + (lease / Self::PER_LEASE).max(Self::MIN_PERIOD));
        }
        is_due
    }

    /// When it is time to assert.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        for manual in [false, true] {
            let data = ParticipantMessageData {
                participant: GuidPrefix([5; 12]),
                manual,
            };
            let mut bytes = Vec::new();
            data.encode(&mut bytes);
            assert_eq!(ParticipantMessageData::decode(&bytes), Ok(Some(data)));
            assert_eq!(participant_message_instance(&bytes), Some(data.instance()));
            for length in 0..20 {
                assert!(ParticipantMessageData::decode(&bytes[..length]).is_err());
            }
            bytes[16] = 1;
            assert_eq!(ParticipantMessageData::decode(&bytes), Ok(None));
        }
    }
}
