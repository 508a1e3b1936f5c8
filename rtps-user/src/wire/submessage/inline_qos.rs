//! What a DATA says of its change beside the payload: the inline QoS (RTPS 2.5 sections 8.7.9 and 9.6.4).

use std::hash::{Hash, Hasher};

use serde::{Deserialize, Serialize};

use super::ContentFilterInfo;
use crate::wire::{
    Cursor, Duration, Parameter, ParameterId, ParameterWriter, SequenceNumber, WireError,
};

/// The 16 bytes that name an instance (RTPS 9.6.4.8): its big-endian key, zero-padded, or the MD5 of it.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub struct KeyHash(pub [u8; 16]);

/// All of it at once.
impl Hash for KeyHash {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u128(u128::from_ne_bytes(self.0));
    }
}

/// StatusInfo_t (RTPS 9.6.4.9): what happened to the instance.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct StatusInfo {
    /// The writer disposed the instance.
    pub disposed: bool,
    /// The writer unregistered the instance.
    pub unregistered: bool,
    /// The writer says so only for the reader's content filter: the change is not for it.
    pub filtered: bool,
}

impl StatusInfo {
    fn from_octet(octet: u8) -> Self {
        Self {
            disposed: octet & 1 != 0,
            unregistered: octet & 2 != 0,
            filtered: octet & 4 != 0,
        }
    }

    fn octet(self) -> u8 {
        u8::from(self.disposed) | u8::from(self.unregistered) << 1 | u8::from(self.filtered) << 2
    }

    /// Whether the change is an ordinary sample.
    pub fn is_alive(self) -> bool {
        !self.disposed && !self.unregistered
    }
}

/// GroupDigest_t (RTPS 9.3.2): a digest of the entity ids of a publisher's writers. Who reads it compares it with
/// others, nothing else.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct GroupDigest(pub [u8; 4]);

/// The parameters of a change that we use; unknown ones are skipped.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct InlineQos {
    /// PID_KEY_HASH.
    pub key_hash: Option<KeyHash>,
    /// PID_STATUS_INFO; absent means an ordinary sample.
    pub status: StatusInfo,
    /// PID_COHERENT_SET: the first change of the set that this change belongs to; SEQUENCENUMBER_UNKNOWN says that the
    /// set before has ended (RTPS 8.7.6).
    pub coherent_set: Option<SequenceNumber>,
    /// PID_GROUP_SEQ_NUM: the change's number among all changes of its publisher (RTPS 8.7.5).
    pub group_sequence: Option<SequenceNumber>,
    /// PID_GROUP_COHERENT_SET: the group sequence number that the publisher's set begins with (RTPS 8.7.6).
    pub group_coherent_set: Option<SequenceNumber>,
    /// PID_WRITER_GROUP_INFO: the writers of the publisher, at the end of a set of GROUP scope.
    pub writer_group: Option<GroupDigest>,
    /// PID_LIFESPAN: that of this change alone.
    pub lifespan: Option<Duration>,
}

impl InlineQos {
    /// Whether there is nothing to write.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Bytes of the list with its sentinel and `more` bytes of other parameters; 0 where there is nothing to write.
    pub fn encoded_len(&self, more: usize) -> usize {
        const HEADER: usize = 4;
        if self.is_empty() && more == 0 {
            return 0;
        }
        let numbers = [
            self.coherent_set,
            self.group_sequence,
            self.group_coherent_set,
        ];
        let numbers = numbers.iter().flatten().count();
        HEADER
            + more
            + usize::from(self.key_hash.is_some()) * (HEADER + 16)
            + usize::from(self.status != StatusInfo::default()) * (HEADER + 4)
            + numbers * (HEADER + 8)
            + usize::from(self.writer_group.is_some()) * (HEADER + 4)
            + usize::from(self.lifespan.is_some()) * (HEADER + 8)
    }

    /// Reads a whole list up to its sentinel and moves the cursor behind it; what it says of filters goes into `filters`.
    pub(super) fn decode<'a>(
        cursor: &mut Cursor<'a>,
        filters: &mut Option<ContentFilterInfo<'a>>,
    ) -> Result<Self, WireError> {
        let mut qos = Self::default();
        while let Some(Parameter { id, mut value }) = Parameter::next(cursor)? {
            match id {
                ParameterId::KEY_HASH => qos.key_hash = Some(KeyHash(value.array()?)),
                // Four octets, of which the last has the flags, whatever the byte order.
                ParameterId::STATUS_INFO => {
                    qos.status = StatusInfo::from_octet(value.array::<4>()?[3])
                }
                _ => qos.decode_rare(id, &mut value, filters)?,
            }
        }
        Ok(qos)
    }

    fn decode_rare<'a>(
        &mut self,
        id: ParameterId,
        value: &mut Cursor<'a>,
        filters: &mut Option<ContentFilterInfo<'a>>,
    ) -> Result<(), WireError> {
        match id {
            ParameterId::CONTENT_FILTER_INFO => *filters = Some(ContentFilterInfo::new(*value)),
            ParameterId::COHERENT_SET => self.coherent_set = Some(SequenceNumber::decode(value)?),
            ParameterId::GROUP_SEQ_NUM => {
                self.group_sequence = Some(SequenceNumber::decode(value)?)
            }
            ParameterId::GROUP_COHERENT_SET => {
                self.group_coherent_set = Some(SequenceNumber::decode(value)?)
            }
            ParameterId::WRITER_GROUP_INFO => self.writer_group = Some(GroupDigest(value.array()?)),
            ParameterId::LIFESPAN => self.lifespan = Some(Duration::decode(value)?),
            _ => {}
        }
        Ok(())
    }

    /// Writes the list with its sentinel, and with it parameters that have been written already; nothing where there are
    /// none.
    pub(in crate::wire) fn encode(&self, more: &[u8], out: &mut Vec<u8>) {
        if self.is_empty() && more.is_empty() {
            return;
        }
        out.extend_from_slice(more);
        let mut list = ParameterWriter::new(out);
        if let Some(KeyHash(hash)) = self.key_hash {
            list.words(ParameterId::KEY_HASH, &hash);
        }
        if self.status != StatusInfo::default() {
            list.words(ParameterId::STATUS_INFO, &[0, 0, 0, self.status.octet()]);
        }
        for (id, number) in [
            (ParameterId::COHERENT_SET, self.coherent_set),
            (ParameterId::GROUP_SEQ_NUM, self.group_sequence),
            (ParameterId::GROUP_COHERENT_SET, self.group_coherent_set),
        ] {
            if let Some(number) = number {
                list.words(id, &number.to_bytes());
            }
        }
        if let Some(GroupDigest(digest)) = self.writer_group {
            list.words(ParameterId::WRITER_GROUP_INFO, &digest);
        }
        if let Some(lifespan) = self.lifespan {
            list.parameter(ParameterId::LIFESPAN, |value| lifespan.encode(value));
        }
        list.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_length_is_known_before() {
        let number = Some(SequenceNumber(7));
        let status = StatusInfo {
            unregistered: true,
            ..StatusInfo::default()
        };
        let all = InlineQos {
            key_hash: Some(KeyHash([1; 16])),
            status,
            coherent_set: number,
            group_sequence: number,
            group_coherent_set: number,
            writer_group: Some(GroupDigest([1; 4])),
            lifespan: Some(Duration::ZERO),
        };
        let some = InlineQos {
            status,
            group_sequence: number,
            ..InlineQos::default()
        };
        for qos in [all, some] {
            let mut out = Vec::new();
            qos.encode(&[], &mut out);
            assert_eq!(qos.encoded_len(0), out.len());
        }
        assert_eq!(InlineQos::default().encoded_len(0), 0);
    }
}
