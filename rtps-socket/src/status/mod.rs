//! Communication statuses (DDS 1.4 section 2.2.4.1): what happens to a writer or reader beside its data.
//!
//! Each event ([`StatusEvent`]) counts in a status of its endpoint ([`Statuses`]). It is told to the listener that is
//! nearest: the endpoint's own, else its publisher's or subscriber's, else the participant's.

mod counts;
mod kind;

use std::sync::Arc;

use rtps_user::qos::PolicyId;
use rtps_user::reader::RejectedReason;
use rtps_user::wire::{Guid, KeyHash};

pub(crate) use counts::Statuses;
pub use counts::{
    Count, DeadlineMissedStatus, IncompatibleQosStatus, InconsistentTopicStatus,
    LivelinessChangedStatus, LivelinessLostStatus, MatchedStatus, SampleLostStatus,
    SampleRejectedStatus,
};
pub use kind::{StatusKind, StatusMask};

/// An event of one of several endpoints, for a listener of a publisher, subscriber or participant.
#[derive(Clone, Debug, PartialEq)]
pub struct EntityEvent {
    /// The writer or reader.
    pub entity: Guid,
    /// Its topic.
    pub topic: Arc<str>,
    /// The registered name of the topic's type.
    pub type_name: Arc<str>,
    /// What has happened to it.
    pub event: StatusEvent,
}

/// Something that has happened to a writer or reader. Told to a listener if there is one for it, else kept for
/// `status_events`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StatusEvent {
    /// PUBLICATION_MATCHED: a reader was matched with the writer, or is gone.
    PublicationMatched {
        /// Matched readers now.
        current: usize,
        /// Change of `current`.
        change: isize,
        /// Matches in all so far.
        total: u64,
        /// The reader.
        reader: Guid,
    },
    /// SUBSCRIPTION_MATCHED: a writer was matched with the reader, or is gone.
    SubscriptionMatched {
        /// Matched writers now.
        current: usize,
        /// Change of `current`.
        change: isize,
        /// Matches in all so far.
        total: u64,
        /// The writer.
        writer: Guid,
    },
    /// OFFERED_INCOMPATIBLE_QOS: a reader of the topic wants more than the writer offers, so they do not match.
    OfferedIncompatibleQos {
        /// The first policy that does not fit.
        policy: PolicyId,
        /// Such readers so far.
        total: u64,
        /// The reader.
        reader: Guid,
    },
    /// REQUESTED_INCOMPATIBLE_QOS: a writer of the topic offers less than the reader wants, so they do not match.
    RequestedIncompatibleQos {
        /// The first policy that does not fit.
        policy: PolicyId,
        /// Such writers so far.
        total: u64,
        /// The writer.
        writer: Guid,
    },
    /// INCONSISTENT_TOPIC: another endpoint uses the topic's name with another type.
    InconsistentTopic {
        /// Such endpoints so far.
        total: u64,
        /// The other endpoint.
        remote: Guid,
    },
    /// LIVELINESS_LOST: the writer's lease passed without an assertion.
    LivelinessLost {
        /// How often so far.
        total: u64,
    },
    /// LIVELINESS_CHANGED: a matched writer has come, gone, lost its liveliness or got it back.
    LivelinessChanged {
        /// Matched writers that are alive.
        alive: u32,
        /// Change of `alive`.
        alive_change: i32,
        /// Matched writers that are not.
        not_alive: u32,
        /// Change of `not_alive`.
        not_alive_change: i32,
        /// The writer.
        writer: Guid,
    },
    /// SAMPLE_LOST: samples of a writer will never come.
    SampleLost {
        /// How many.
        count: u64,
        /// How many of all writers so far.
        total: u64,
        /// The writer.
        writer: Guid,
    },
    /// SAMPLE_REJECTED: the reader has no room. A reliable writer sends it again when samples have been taken.
    SampleRejected {
        /// The limit of RESOURCE_LIMITS.
        reason: RejectedReason,
        /// The instance of the sample.
        instance: KeyHash,
        /// How often so far.
        total: u64,
        /// The writer.
        writer: Guid,
    },
    /// OFFERED_DEADLINE_MISSED: an instance was not written for longer than DEADLINE allows.
    OfferedDeadlineMissed {
        /// The instance.
        instance: KeyHash,
        /// Deadlines missed so far, of all instances.
        total: u64,
    },
    /// REQUESTED_DEADLINE_MISSED: an instance got no sample for longer than DEADLINE allows.
    RequestedDeadlineMissed {
        /// The instance.
        instance: KeyHash,
        /// Deadlines missed so far, of all instances.
        total: u64,
    },
    /// DATA_AVAILABLE: the reader has got samples. Only for listeners that ask for it, and not kept.
    DataAvailable,
    /// DATA_ON_READERS: the same, for listeners of subscribers and participants that ask for it.
    DataOnReaders,
    /// The layer refuses a declaration of the participant, this endpoint's or another's.
    Refused {
        /// Why, and what can be done.
        reason: String,
    },
    /// The layer was set up anew while the app had no connection to it, and the participant is no longer part of
    /// the domain. Nothing is sent or received any more: open the participant again.
    LayerLost,
    /// A sample is not of the topic's type and was left out.
    Undecodable {
        /// The writer.
        writer: Guid,
        /// What is wrong with it.
        error: crate::cdr::DecodeError,
    },
}

impl StatusEvent {
    /// The status that it counts in.
    #[must_use]
    pub fn kind(&self) -> StatusKind {
        match self {
            Self::PublicationMatched { .. } => StatusKind::PublicationMatched,
            Self::SubscriptionMatched { .. } => StatusKind::SubscriptionMatched,
            Self::OfferedIncompatibleQos { .. } => StatusKind::OfferedIncompatibleQos,
            Self::RequestedIncompatibleQos { .. } => StatusKind::RequestedIncompatibleQos,
            Self::InconsistentTopic { .. } => StatusKind::InconsistentTopic,
            Self::LivelinessLost { .. } => StatusKind::LivelinessLost,
            Self::LivelinessChanged { .. } => StatusKind::LivelinessChanged,
            Self::SampleLost { .. } => StatusKind::SampleLost,
            Self::SampleRejected { .. } => StatusKind::SampleRejected,
            Self::OfferedDeadlineMissed { .. } => StatusKind::OfferedDeadlineMissed,
            Self::RequestedDeadlineMissed { .. } => StatusKind::RequestedDeadlineMissed,
            Self::DataAvailable => StatusKind::DataAvailable,
            Self::DataOnReaders => StatusKind::DataOnReaders,
            Self::Refused { .. } | Self::LayerLost | Self::Undecodable { .. } => {
                StatusKind::Trouble
            }
        }
    }
}
