//! Communication statuses (DDS 1.4 section 2.2.4.1): what happens to a writer or reader beside its data.

use rtps_user::qos::PolicyId;
use rtps_user::reader::RejectedReason;
use rtps_user::wire::{Guid, KeyHash};

/// Something that has happened to a writer or reader. Delivered to its listener if it has one, else kept for
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
        /// The reader.
        reader: Guid,
    },
    /// REQUESTED_INCOMPATIBLE_QOS: a writer of the topic offers less than the reader wants, so they do not match.
    RequestedIncompatibleQos {
        /// The first policy that does not fit.
        policy: PolicyId,
        /// The writer.
        writer: Guid,
    },
    /// INCONSISTENT_TOPIC: another endpoint uses the topic's name with another type.
    InconsistentTopic {
        /// The other endpoint.
        remote: Guid,
    },
    /// LIVELINESS_LOST: the writer's lease passed without an assertion.
    LivelinessLost,
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
        /// The writer.
        writer: Guid,
    },
    /// SAMPLE_REJECTED: the reader has no room. A reliable writer sends it again when samples have been taken.
    SampleRejected {
        /// The limit of RESOURCE_LIMITS.
        reason: RejectedReason,
        /// The instance of the sample.
        instance: KeyHash,
        /// The writer.
        writer: Guid,
    },
    /// REQUESTED_DEADLINE_MISSED: an instance got no sample for longer than DEADLINE allows.
    DeadlineMissed {
        /// The instance.
        instance: KeyHash,
    },
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
