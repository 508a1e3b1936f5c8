//! What the layer wants kept for its next incarnation, so that a restart goes unnoticed by remote participants.
//!
//! To who keeps them, records are opaque bytes under a short key, small enough for a BPF map.

use std::net::IpAddr;

use serde::{Deserialize, Serialize};

use super::protocol::Endpoint;
use crate::discovery::{EndpointData, ParticipantData};
use crate::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};

/// The longest value, in bytes.
pub const MAX_STORE_VALUE: usize = 3 * 1024;

/// Names a record: its kind and what identifies it within the kind, zero-padded. Records are restored in the order
/// of their keys.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct StoreKey(pub [u8; 32]);

/// A wanted change of the store.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum StoreChange {
    /// Insert or replace.
    Store {
        /// The record's name.
        key: StoreKey,
        /// At most [`MAX_STORE_VALUE`] bytes.
        value: Vec<u8>,
    },
    /// Remove, if there.
    Forget(StoreKey),
}

/// What is kept.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub(super) enum Record {
    /// The sample that announces the host's participant.
    Announcement {
        sequence: SequenceNumber,
        payload: Vec<u8>,
    },
    /// An app.
    App {
        slot: u8,
        token: [u8; 16],
        name: String,
    },
    /// A sample that announces an endpoint of an app.
    Declared {
        sequence: SequenceNumber,
        endpoint: Box<Endpoint>,
    },
    /// A sample that withdraws an endpoint of an app.
    Withdrawn {
        sequence: SequenceNumber,
        entity: EntityId,
    },
    /// The number of the next sample of a built-in writer.
    NextSequence {
        writer: EntityId,
        next: SequenceNumber,
    },
    /// A remote participant, and where its announcements come from.
    Participant {
        source: IpAddr,
        proven: bool,
        data: Box<ParticipantData>,
    },
    /// A remote endpoint.
    Endpoint(Box<EndpointData>),
    /// Everything below this number has been received of a remote built-in writer.
    Progress { writer: Guid, next: SequenceNumber },
}

impl StoreKey {
    pub(super) fn announcement() -> Self {
        Self::new(1, &[])
    }

    pub(super) fn app(slot: u8) -> Self {
        Self::new(2, &[slot])
    }

    /// A sample about an endpoint of ours: sorted by number.
    pub(super) fn sample(entity_is_writer: bool, sequence: SequenceNumber) -> Self {
        let [a, b, c, d, e, f, g, h] = sequence.0.to_be_bytes();
        Self::new(3, &[u8::from(entity_is_writer), a, b, c, d, e, f, g, h])
    }

    /// After the samples, whose numbers it exceeds.
    pub(super) fn next_sequence(writer: EntityId) -> Self {
        Self::new(4, &writer.0)
    }

    /// After our own samples, which must be there when a participant is matched.
    pub(super) fn participant(prefix: GuidPrefix) -> Self {
        Self::new(5, &prefix.0)
    }

    pub(super) fn endpoint(guid: Guid) -> Self {
        Self::new(6, &guid.to_bytes())
    }

    pub(super) fn progress(writer: Guid) -> Self {
        Self::new(7, &writer.to_bytes())
    }

    fn new(kind: u8, name: &[u8]) -> Self {
        let mut key = [0; 32];
        key[0] = kind;
        key[1..=name.len()].copy_from_slice(name);
        Self(key)
    }
}

impl Record {
    /// The record's name.
    pub(super) fn key(&self) -> StoreKey {
        match self {
            Self::Announcement { .. } => StoreKey::announcement(),
            Self::App { slot, .. } => StoreKey::app(*slot),
            Self::Declared { sequence, endpoint } => {
                StoreKey::sample(endpoint.entity.is_writer(), *sequence)
            }
            Self::Withdrawn { sequence, entity } => StoreKey::sample(entity.is_writer(), *sequence),
            Self::NextSequence { writer, .. } => StoreKey::next_sequence(*writer),
            Self::Participant { data, .. } => StoreKey::participant(data.prefix),
            Self::Endpoint(data) => StoreKey::endpoint(data.guid),
            Self::Progress { writer, .. } => StoreKey::progress(*writer),
        }
    }

    /// The record as it is kept; `None` where it is too large even without what matching does not need.
    pub(super) fn encode(mut self) -> Option<Vec<u8>> {
        let encode = |record: &Self| {
            let bytes = postcard::to_stdvec(record).ok()?;
            (bytes.len() <= MAX_STORE_VALUE).then_some(bytes)
        };
        if let Some(bytes) = encode(&self) {
            return Some(bytes);
        }
        match &mut self {
            Self::Participant { data, .. } => data.user_data = Vec::new(),
            Self::Endpoint(data) => {
                data.qos.user_data = Vec::new();
                data.qos.topic_data = Vec::new();
                data.qos.group_data = Vec::new();
            }
            _ => {}
        }
        encode(&self)
    }

    /// Reads what was kept; `None` where an incompatible version kept it.
    pub(super) fn decode(value: &[u8]) -> Option<Self> {
        postcard::from_bytes(value).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_records_lose_what_is_not_needed() {
        let record = |user_data: usize, name: usize| Record::Participant {
            source: [10, 0, 0, 1].into(),
            proven: true,
            data: Box::new(ParticipantData {
                user_data: vec![1; user_data],
                name: "n".repeat(name),
                ..ParticipantData::new(GuidPrefix([1; 12]))
            }),
        };
        let kept = record(10, 10).encode().unwrap();
        assert_eq!(Record::decode(&kept), Some(record(10, 10)));
        let kept = record(MAX_STORE_VALUE, 10).encode().unwrap();
        assert_eq!(Record::decode(&kept), Some(record(0, 10)));
        assert_eq!(record(0, MAX_STORE_VALUE).encode(), None);
    }

    #[test]
    fn samples_are_restored_in_order_and_before_what_depends_on_them() {
        let keys = [
            StoreKey::sample(true, SequenceNumber(2)),
            StoreKey::sample(true, SequenceNumber(256)),
            StoreKey::next_sequence(EntityId([0xff; 4])),
            StoreKey::participant(GuidPrefix([0; 12])),
            StoreKey::endpoint(Guid::UNKNOWN),
        ];
        assert!(keys.is_sorted());
    }
}
