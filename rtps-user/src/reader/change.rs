//! A change as it comes from a writer, and what it means to a reader (RTPS 2.5 sections 8.2.1.3 and 9.6.4).

use std::time::{Duration, Instant};

use bytes::Bytes;

use super::ReaderConfig;
use crate::wire::{
    GroupDigest, Guid, InlineQos, KeyHash, PayloadKind, SequenceNumber, StatusInfo, Timestamp,
};

/// A change that is worth keeping.
#[derive(Debug)]
pub(super) struct Change {
    pub(super) writer: Guid,
    pub(super) sequence: SequenceNumber,
    pub(super) timestamp: Option<Timestamp>,
    pub(super) reception: Instant,
    /// When it is worth nothing any more, if ever.
    pub(super) expiry: Option<Instant>,
    pub(super) instance: KeyHash,
    pub(super) status: StatusInfo,
    pub(super) valid_data: bool,
    pub(super) payload: Bytes,
    /// What it belongs to, where the reader cares.
    pub(super) membership: Option<Box<Membership>>,
}

/// The coherent set and the group that a change belongs to (RTPS 2.5 sections 8.7.5 and 8.7.6).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Membership {
    coherent_set: Option<SequenceNumber>,
    /// Its number among the changes of its publisher.
    pub(super) sequence: Option<SequenceNumber>,
    /// The group sequence number that the publisher's set begins with.
    pub(super) group_set: Option<SequenceNumber>,
    /// The writers of the publisher.
    pub(super) writers: Option<GroupDigest>,
}

impl Membership {
    /// The first change of its set; `None` where it only says that there is none, or none any more.
    pub(super) fn set(&self) -> Option<SequenceNumber> {
        self.coherent_set.filter(|first| first.0 > 0)
    }
}

impl Change {
    /// The news that an instance has lost its last writer without a word from it.
    pub(super) fn orphaned(instance: KeyHash, writer: Guid, now: Instant) -> Self {
        Self {
            writer,
            sequence: SequenceNumber::UNKNOWN,
            timestamp: None,
            reception: now,
            expiry: None,
            instance,
            status: StatusInfo {
                unregistered: true,
                ..StatusInfo::default()
            },
            valid_data: false,
            payload: Bytes::new(),
            membership: None,
        }
    }

    /// Whether it is nothing to its instance.
    pub(super) fn is_void(&self) -> bool {
        !self.valid_data && self.status.is_alive()
    }
}

/// What a DATA and the DATA_FRAGs of a sample say of a change beside its payload.
#[derive(Debug)]
pub(super) struct Arrival {
    pub(super) writer: Guid,
    pub(super) sequence: SequenceNumber,
    pub(super) timestamp: Option<Timestamp>,
    pub(super) reception: Instant,
    pub(super) inline_qos: InlineQos,
    pub(super) kind: PayloadKind,
}

/// A serialized payload, still in its datagram or put together from fragments.
#[derive(Debug)]
pub(super) enum Payload<'a> {
    Borrowed(&'a [u8]),
    Owned(Bytes),
}

impl Payload<'_> {
    pub(super) fn as_slice(&self) -> &[u8] {
        match self {
            Self::Borrowed(bytes) => bytes,
            Self::Owned(bytes) => bytes,
        }
    }

    pub(super) fn into_bytes(self) -> Bytes {
        match self {
            Self::Borrowed(bytes) => Bytes::copy_from_slice(bytes),
            Self::Owned(bytes) => bytes,
        }
    }
}

/// What a change is to this reader.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Meaning {
    /// An update of this instance.
    Update(KeyHash),
    /// Nothing: its writer or this reader filtered it out, or it says nothing.
    Irrelevant,
    /// Its instance cannot be told from its payload.
    Malformed,
}

impl Arrival {
    /// Finds out what the change means.
    pub(super) fn meaning(&self, config: &ReaderConfig, payload: &[u8]) -> Meaning {
        let status = self.inline_qos.status;
        let has_data = self.kind == PayloadKind::Data;
        if status.filtered || (status.is_alive() && !has_data) {
            return Meaning::Irrelevant;
        }
        if let Some(is_wanted) = &config.content_filter
            && self.kind != PayloadKind::None
            && !is_wanted(self.kind, payload)
        {
            return Meaning::Irrelevant;
        }
        if !config.guid.entity.has_key() {
            return Meaning::Update(KeyHash::default());
        }
        if let Some(hash) = self.inline_qos.key_hash {
            return Meaning::Update(hash);
        }
        match (&config.instance_of, self.kind) {
            (_, PayloadKind::None) => Meaning::Malformed,
            (None, _) => Meaning::Update(KeyHash::default()),
            (Some(instance_of), kind) => {
                instance_of(kind, payload).map_or(Meaning::Malformed, Meaning::Update)
            }
        }
    }

    /// The change, of a writer with this LIFESPAN.
    pub(super) fn to_change(
        &self,
        instance: KeyHash,
        payload: Bytes,
        lifespan: Option<Duration>,
    ) -> Change {
        Change {
            expiry: self.expiry(lifespan),
            writer: self.writer,
            sequence: self.sequence,
            timestamp: self.timestamp,
            reception: self.reception,
            instance,
            status: self.inline_qos.status,
            valid_data: self.kind == PayloadKind::Data,
            payload,
            membership: None,
        }
    }

    /// A change in the place of one that is nothing to the reader, for what it says of coherent sets.
    pub(super) fn to_void(&self) -> Change {
        let change = self.to_change(KeyHash::default(), Bytes::new(), None);
        Change {
            status: StatusInfo::default(),
            valid_data: false,
            ..change
        }
    }

    /// What the change belongs to, if anything.
    pub(super) fn membership(&self) -> Option<Box<Membership>> {
        let membership = Membership {
            coherent_set: self.inline_qos.coherent_set,
            sequence: self.inline_qos.group_sequence,
            group_set: self.inline_qos.group_coherent_set,
            writers: self.inline_qos.writer_group,
        };
        (membership != Membership::default()).then(|| Box::new(membership))
    }

    /// LIFESPAN counts from the reception: what a writer still sends is not over there, and how far its clock is off
    /// is not known (DDS 1.4 section 2.2.3.16 allows it).
    fn expiry(&self, lifespan: Option<Duration>) -> Option<Instant> {
        let lifespan = match self.inline_qos.lifespan {
            Some(own) => own.to_std(),
            None => lifespan,
        };
        let has_data = self.kind == PayloadKind::Data;
        self.reception.checked_add(lifespan.filter(|_| has_data)?)
    }
}
