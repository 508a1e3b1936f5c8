//! A change as it comes from a writer, and what it means to a reader (RTPS 2.5 sections 8.2.1.3 and 9.6.4).

use std::time::{Duration, Instant};

use bytes::Bytes;

use super::ReaderConfig;
use crate::wire::{
    ContentFilterInfo, GroupDigest, Guid, InlineQos, KeyHash, PayloadKind, SequenceNumber,
    StatusInfo, Timestamp,
};

/// A change that is worth keeping.
#[derive(Debug)]
pub(super) struct Change {
    pub(super) writer: Guid,
    pub(super) sequence: SequenceNumber,
    pub(super) timestamp: Option<Timestamp>,
    pub(super) reception: Instant,
    pub(super) instance: KeyHash,
    pub(super) status: StatusInfo,
    pub(super) valid_data: bool,
    pub(super) payload: Bytes,
    /// What few changes have.
    pub(super) extras: Option<Box<Extras>>,
}

/// What is known of few changes, or of interest to few readers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Extras {
    /// When the change is worth nothing any more (LIFESPAN).
    pub(super) expiry: Option<Instant>,
    coherent_set: Option<SequenceNumber>,
    /// Its number among the changes of its publisher (RTPS 2.5 section 8.7.5).
    pub(super) group_sequence: Option<SequenceNumber>,
    /// The group sequence number that the publisher's coherent set begins with (RTPS 2.5 section 8.7.6).
    pub(super) group_set: Option<SequenceNumber>,
    /// The writers of the publisher.
    pub(super) writers: Option<GroupDigest>,
}

impl Extras {
    /// The first change of its coherent set; `None` where it only says that there is none, or none any more.
    pub(super) fn set(&self) -> Option<SequenceNumber> {
        self.coherent_set.filter(|first| first.0 > 0)
    }
}

/// On what terms a reader gets the changes of a writer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Terms {
    /// The writer's LIFESPAN.
    pub(super) lifespan: Option<Duration>,
    /// Whether the reader has asked for coherent or ordered access.
    pub(super) presents: bool,
}

impl Change {
    /// The news that an instance has lost its last writer without a word from it.
    pub(super) fn orphaned(instance: KeyHash, writer: Guid, now: Instant) -> Self {
        Self {
            writer,
            sequence: SequenceNumber::UNKNOWN,
            timestamp: None,
            reception: now,
            instance,
            status: StatusInfo {
                unregistered: true,
                ..StatusInfo::default()
            },
            valid_data: false,
            payload: Bytes::new(),
            extras: None,
        }
    }

    /// When it is worth nothing any more, if ever.
    pub(super) fn expiry(&self) -> Option<Instant> {
        self.extras.as_ref()?.expiry
    }

    /// Whether it is nothing to its instance.
    pub(super) fn is_void(&self) -> bool {
        !self.valid_data && self.status.is_alive()
    }
}

/// What a DATA and the DATA_FRAGs of a sample say of a change beside its payload.
#[derive(Debug)]
pub(super) struct Arrival<'a> {
    pub(super) writer: Guid,
    pub(super) sequence: SequenceNumber,
    pub(super) timestamp: Option<Timestamp>,
    pub(super) reception: Instant,
    pub(super) inline_qos: &'a InlineQos,
    pub(super) filters: Option<ContentFilterInfo<'a>>,
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

impl Arrival<'_> {
    /// Finds out what the change means.
    pub(super) fn meaning(&self, config: &ReaderConfig, payload: &[u8]) -> Meaning {
        let status = self.inline_qos.status;
        let has_data = self.kind == PayloadKind::Data;
        if status.filtered || (status.is_alive() && !has_data) {
            return Meaning::Irrelevant;
        }
        if let Some(is_wanted) = &config.content_filter
            && self.kind != PayloadKind::None
            && !self
                .passed(config)
                .unwrap_or_else(|| is_wanted(self.kind, payload))
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

    /// Whether a sample has passed the reader's filter at the writer; `None` where the reader has to find out.
    fn passed(&self, config: &ReaderConfig) -> Option<bool> {
        let filters = self.filters.filter(|_| self.kind == PayloadKind::Data)?;
        filters.result_of(config.filter_signature?)
    }

    /// The change as the reader gets it.
    #[inline]
    pub(super) fn to_change(&self, instance: KeyHash, payload: Bytes, terms: &Terms) -> Change {
        Change {
            writer: self.writer,
            sequence: self.sequence,
            timestamp: self.timestamp,
            reception: self.reception,
            instance,
            status: self.inline_qos.status,
            valid_data: self.kind == PayloadKind::Data,
            payload,
            extras: self.extras(terms),
        }
    }

    /// A change in the place of one that is nothing to the reader, for what it says of coherent sets.
    pub(super) fn to_void(&self, terms: &Terms) -> Change {
        Change {
            status: StatusInfo::default(),
            valid_data: false,
            ..self.to_change(KeyHash::default(), Bytes::new(), terms)
        }
    }

    #[inline]
    fn extras(&self, terms: &Terms) -> Option<Box<Extras>> {
        let has_lifespan = terms.lifespan.is_some() || self.inline_qos.lifespan.is_some();
        if !has_lifespan && !terms.presents {
            return None;
        }
        let mut extras = Extras {
            expiry: self.expiry(terms.lifespan),
            ..Extras::default()
        };
        if terms.presents {
            let named = self.inline_qos.coherent_set;
            extras.coherent_set = named.filter(|_| !self.says_nothing());
            extras.group_sequence = self.inline_qos.group_sequence;
            extras.group_set = self.inline_qos.group_coherent_set;
            extras.writers = self.inline_qos.writer_group;
        }
        (extras != Extras::default()).then(|| Box::new(extras))
    }

    /// Whether it can be nothing but the end of a coherent set, whatever set it names.
    fn says_nothing(&self) -> bool {
        self.kind == PayloadKind::None && self.inline_qos.status == StatusInfo::default()
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
