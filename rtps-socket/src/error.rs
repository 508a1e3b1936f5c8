//! Errors, one enum per operation; each says what can be done about it.

use std::time::Duration;

use rtps_user::qos::PolicyId;
use rtps_user::writer;
use thiserror::Error;

pub use crate::link::OpenError;
pub use crate::link::in_process::InProcessError;
pub use crate::link::kernel::AttachError;

use crate::cdr::EncodeError;
use crate::filter::{BindError, ParseError};

/// Why a topic, writer or reader could not be created.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum CreateError {
    /// Names are 1 to 255 bytes without NUL.
    #[error("{0:?} is no name for a topic or type: it needs 1 to 255 bytes and no NUL")]
    InvalidName(String),
    /// INCONSISTENT_POLICY.
    #[error(transparent)]
    Inconsistent(InconsistentPolicy),
    /// Entity ids have 16 bits for an app's endpoints.
    #[error("the participant has 65,535 endpoints already: drop some")]
    TooManyEndpoints,
    /// What is said of an endpoint takes one packet of the layer protocol.
    #[error(
        "the declaration of the endpoint has {size} bytes and may have {limit}: shorten its user, topic or group \
         data, or its partitions"
    )]
    TooLarge {
        /// What it would have, in bytes.
        size: usize,
        /// What it may have, in bytes.
        limit: usize,
    },
    /// USER_DATA of a participant has to fit in its announcement.
    #[error("USER_DATA of the participant has {size} bytes and may have {limit}")]
    UserDataTooLong {
        /// What it would have, in bytes.
        size: usize,
        /// What it may have, in bytes.
        limit: usize,
    },
    /// The layer was set up anew, and the participant is no longer part of the domain.
    #[error("the layer was unloaded: open the participant again")]
    LayerLost,
    /// Nothing but CDR is written.
    #[error("the XML data representation is not supported: choose xcdr1() or xcdr2()")]
    UnsupportedRepresentation,
}

/// INCONSISTENT_POLICY: policies that contradict each other or leave nothing to do (DDS 1.4 section 2.2.3). Those of HISTORY
/// and RESOURCE_LIMITS are also checked within DURABILITY_SERVICE, which `policy` is then.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum InconsistentPolicy {
    /// KEEP_LAST of nothing.
    #[error("{policy:?}: KEEP_LAST 0 keeps nothing: keep at least the last sample")]
    NoHistory {
        /// HISTORY or DURABILITY_SERVICE.
        policy: PolicyId,
    },
    /// A limit without room for anything.
    #[error("{policy:?}: {limit} is 0, so that no sample would be taken: None is no limit")]
    NoRoom {
        /// HISTORY or DURABILITY_SERVICE.
        policy: PolicyId,
        /// Its name.
        limit: &'static str,
    },
    /// RESOURCE_LIMITS leave no room for what HISTORY wants kept.
    #[error("{policy:?}: KEEP_LAST {depth} exceeds max_samples_per_instance {limit}")]
    Depth {
        /// HISTORY or DURABILITY_SERVICE.
        policy: PolicyId,
        /// Of HISTORY.
        depth: u32,
        /// Of RESOURCE_LIMITS.
        limit: u32,
    },
    /// RESOURCE_LIMITS allow more samples of an instance than of all.
    #[error(
        "{policy:?}: max_samples {samples} is less than max_samples_per_instance {per_instance}"
    )]
    Limits {
        /// HISTORY or DURABILITY_SERVICE.
        policy: PolicyId,
        /// max_samples.
        samples: u32,
        /// max_samples_per_instance.
        per_instance: u32,
    },
    /// DEADLINE without time.
    #[error("the period of DEADLINE is 0: every sample would be too late")]
    NoPeriod,
    /// A reader that wants samples rarely cannot want them often; `None` is for ever.
    #[error(
        "the minimum separation of TIME_BASED_FILTER, {}, exceeds the period of DEADLINE, {}: each deadline would be missed",
        shown(.separation),
        shown(.deadline)
    )]
    Separation {
        /// Of TIME_BASED_FILTER.
        separation: Option<Duration>,
        /// Of DEADLINE.
        deadline: Option<Duration>,
    },
}

fn shown(duration: &Option<Duration>) -> String {
    duration.map_or_else(|| "infinite".to_owned(), |time| format!("{time:?}"))
}

/// Why a filter is refused.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum FilterError {
    /// The expression is none of DDS 1.4 annex B.
    #[error("the filter cannot be read: {0}")]
    Parse(#[from] ParseError),
    /// The expression does not fit the topic's type.
    #[error("the filter does not fit the type: {0}")]
    Bind(#[from] BindError),
    /// There is `%0` to `%99`.
    #[error("{0} parameters are more than the 100 that an expression can mention")]
    TooManyParameters(usize),
    /// The name cannot be one.
    #[error(transparent)]
    Refused(#[from] CreateError),
}

/// Why policies were not changed. All stay as they were.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum SetQosError {
    /// IMMUTABLE_POLICY: others have matched because of it.
    #[error("{0:?} cannot change once the entity is there: create another")]
    Immutable(PolicyId),
    /// What cannot be created cannot be changed to either.
    #[error(transparent)]
    Refused(#[from] CreateError),
}

/// Why a sample was not written.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum WriteError {
    /// The value is not what its type can carry.
    #[error("the sample cannot be serialized: {0}")]
    Encode(#[from] EncodeError),
    /// A reliable reader did not keep up.
    #[error(
        "the history stayed full for max_blocking_time because a reliable reader does not acknowledge: \
         write more slowly, or allow a longer max_blocking_time or a larger history"
    )]
    Timeout,
    /// RESOURCE_LIMITS, or a sample beyond what RTPS can carry.
    #[error(transparent)]
    Refused(writer::WriteError),
    /// A payload begins with its 4-byte encapsulation header.
    #[error("a raw payload of {0} bytes has no encapsulation header (RTPS 2.5 section 10.2)")]
    NoEncapsulation(usize),
    /// What was written into a loan is not of the type.
    #[error(
        "the loan has no sample of type {0} in it: serialize one, with its encapsulation header"
    )]
    NoSample(&'static str),
    /// Only topics with keys have instances to dispose or unregister.
    #[error("the topic has no key, so there is no instance to dispose or unregister")]
    NoKey,
    /// An endpoint of a publisher that does not enable what it creates.
    #[error("the writer is not enabled yet: enable it or its publisher first")]
    NotEnabled,
    /// Handles come from registering an instance.
    #[error(
        "the handle is of no instance that is registered with this writer: register_instance gives one"
    )]
    UnknownInstance,
    /// The writer has been withdrawn.
    #[error("the writer's participant is closed")]
    Closed,
    /// The layer was set up anew, and the participant is no longer part of the domain.
    #[error("the layer was unloaded: open the participant again")]
    LayerLost,
}

/// A wait ended without what was waited for.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum WaitError {
    /// Fewer endpoints than wanted.
    #[error(
        "only {matched} of {wanted} endpoints matched in time: compare topic, type, partition and domain, and \
         look for incompatible-QoS events"
    )]
    TooFewMatched {
        /// Wanted.
        wanted: usize,
        /// There.
        matched: usize,
    },
    /// The layer was set up anew, and the participant is no longer part of the domain.
    #[error("the layer was unloaded: open the participant again")]
    LayerLost,
    /// Repairs are under way, or a writer has stopped.
    #[error("the history of a matched writer has not come in time")]
    HistoryIncomplete,
    /// Samples are under way, or a reader has stopped.
    #[error("a reliable reader has not acknowledged everything in time")]
    Unacknowledged,
}
