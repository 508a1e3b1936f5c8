//! One type per policy, with the defaults of DDS 1.4 table 2.2.3 for readers; writers differ in RELIABILITY,
//! whose default the DCPS API sets.

use serde::{Deserialize, Serialize};

use crate::wire::Duration;

/// QosPolicyId_t: names a policy in an incompatible-QoS status.
#[derive(Clone, Copy, Debug, Deserialize, Eq, Hash, PartialEq, Serialize)]
pub enum PolicyId {
    /// USER_DATA.
    UserData = 1,
    /// DURABILITY.
    Durability = 2,
    /// PRESENTATION.
    Presentation = 3,
    /// DEADLINE.
    Deadline = 4,
    /// LATENCY_BUDGET.
    LatencyBudget = 5,
    /// OWNERSHIP.
    Ownership = 6,
    /// OWNERSHIP_STRENGTH.
    OwnershipStrength = 7,
    /// LIVELINESS.
    Liveliness = 8,
    /// TIME_BASED_FILTER.
    TimeBasedFilter = 9,
    /// PARTITION.
    Partition = 10,
    /// RELIABILITY.
    Reliability = 11,
    /// DESTINATION_ORDER.
    DestinationOrder = 12,
    /// HISTORY.
    History = 13,
    /// RESOURCE_LIMITS.
    ResourceLimits = 14,
    /// ENTITY_FACTORY.
    EntityFactory = 15,
    /// WRITER_DATA_LIFECYCLE.
    WriterDataLifecycle = 16,
    /// READER_DATA_LIFECYCLE.
    ReaderDataLifecycle = 17,
    /// TOPIC_DATA.
    TopicData = 18,
    /// GROUP_DATA.
    GroupData = 19,
    /// TRANSPORT_PRIORITY.
    TransportPriority = 20,
    /// LIFESPAN.
    Lifespan = 21,
    /// DURABILITY_SERVICE.
    DurabilityService = 22,
    /// DATA_REPRESENTATION.
    DataRepresentation = 23,
    /// TYPE_CONSISTENCY_ENFORCEMENT.
    TypeConsistency = 24,
}

/// RELIABILITY: whether lost samples are repeated. Ordered: what is offered must be at least what is requested.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub enum Reliability {
    /// Lost samples stay lost.
    #[default]
    BestEffort,
    /// Lost samples are repeated; a write waits this long for room in the history.
    Reliable {
        /// How long a write may wait.
        max_blocking_time: Duration,
    },
}

impl Reliability {
    /// RELIABLE with the default of 100 ms for a blocked write.
    pub const RELIABLE: Self = Self::Reliable {
        max_blocking_time: Duration {
            seconds: 0,
            fraction: 0x1999_999a,
        },
    };

    /// Whether it is RELIABLE.
    pub fn is_reliable(self) -> bool {
        matches!(self, Self::Reliable { .. })
    }
}

/// DURABILITY: what a late-joining reader gets.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub enum Durability {
    /// Nothing of the past.
    #[default]
    Volatile,
    /// What the writer keeps while it lives.
    TransientLocal,
    /// As TRANSIENT_LOCAL here: there is no durability service.
    Transient,
    /// As TRANSIENT_LOCAL here: there is no durability service.
    Persistent,
}

/// DURABILITY_SERVICE: what is kept of a TRANSIENT or PERSISTENT topic, here by the writer while it lives. The default leaves
/// it to the writer's HISTORY.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct DurabilityService {
    /// How long what is known of an instance stays after it was disposed and all its writers have gone.
    pub cleanup_delay: Duration,
    /// Its HISTORY.
    pub history: History,
    /// Its RESOURCE_LIMITS.
    pub resource_limits: ResourceLimits,
}

/// HISTORY: how many samples of each instance are kept.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub enum History {
    /// The newest so many of each instance.
    KeepLast(u32),
    /// All, up to RESOURCE_LIMITS.
    KeepAll,
}

impl Default for History {
    fn default() -> Self {
        Self::KeepLast(1)
    }
}

/// RESOURCE_LIMITS; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct ResourceLimits {
    /// Samples of all instances.
    pub max_samples: Option<u32>,
    /// Instances.
    pub max_instances: Option<u32>,
    /// Samples of one instance.
    pub max_samples_per_instance: Option<u32>,
}

/// DEADLINE: the longest time between two samples of an instance.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct Deadline(pub Duration);

impl Default for Deadline {
    fn default() -> Self {
        Self(Duration::INFINITE)
    }
}

/// LATENCY_BUDGET: how long delivery may be put off to save work.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct LatencyBudget(pub Duration);

impl Default for LatencyBudget {
    fn default() -> Self {
        Self(Duration::ZERO)
    }
}

/// Who asserts that a writer is alive. Ordered: what is offered must be at least what is requested.
#[derive(
    Clone, Copy, Debug, Default, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize,
)]
pub enum LivelinessKind {
    /// The layer, as long as the app's process lives.
    #[default]
    Automatic,
    /// The app, by any of its writers or by itself.
    ManualByParticipant,
    /// The app, by this writer.
    ManualByTopic,
}

/// LIVELINESS.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct Liveliness {
    /// Who asserts.
    pub kind: LivelinessKind,
    /// How long an assertion holds.
    pub lease: Duration,
}

impl Default for Liveliness {
    fn default() -> Self {
        Self {
            kind: LivelinessKind::Automatic,
            lease: Duration::INFINITE,
        }
    }
}

/// OWNERSHIP and OWNERSHIP_STRENGTH.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub enum Ownership {
    /// All writers may update an instance.
    #[default]
    Shared,
    /// Only the strongest writer's updates count.
    Exclusive {
        /// The writer's strength; without meaning for readers.
        strength: i32,
    },
}

/// DESTINATION_ORDER. Ordered: what is offered must be at least what is requested.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub enum DestinationOrder {
    /// In the order of arrival.
    #[default]
    ByReceptionTimestamp,
    /// In the order of writing.
    BySourceTimestamp,
}

/// What coherent and ordered access span. Ordered: what is offered must be at least what is requested.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub enum PresentationScope {
    /// Each instance by itself.
    #[default]
    Instance,
    /// All instances of a writer.
    Topic,
    /// All writers of a publisher.
    Group,
}

/// PRESENTATION.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct Presentation {
    /// What the two flags span.
    pub scope: PresentationScope,
    /// Coherent sets become visible as a whole.
    pub coherent: bool,
    /// The order of writing is kept across what the scope spans.
    pub ordered: bool,
}

/// PARTITION: names, with wildcards `*`, `?` and `[...]`; none is the partition with the empty name.
#[derive(Clone, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct Partition(pub Vec<String>);

/// LIFESPAN: how long a sample is worth something.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct Lifespan(pub Duration);

impl Default for Lifespan {
    fn default() -> Self {
        Self(Duration::INFINITE)
    }
}

/// TIME_BASED_FILTER: the least time between two samples of an instance that a reader wants.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct TimeBasedFilter(pub Duration);

impl Default for TimeBasedFilter {
    fn default() -> Self {
        Self(Duration::ZERO)
    }
}

/// WRITER_DATA_LIFECYCLE.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct WriterDataLifecycle {
    /// Whether an instance that its writer unregisters is disposed as well.
    pub autodispose_unregistered_instances: bool,
}

impl Default for WriterDataLifecycle {
    fn default() -> Self {
        Self {
            autodispose_unregistered_instances: true,
        }
    }
}

/// READER_DATA_LIFECYCLE: when samples that nobody has taken are dropped.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct ReaderDataLifecycle {
    /// So long after the instance lost its last writer.
    pub autopurge_nowriter_samples_delay: Duration,
    /// So long after the instance was disposed.
    pub autopurge_disposed_samples_delay: Duration,
}

impl Default for ReaderDataLifecycle {
    fn default() -> Self {
        Self {
            autopurge_nowriter_samples_delay: Duration::INFINITE,
            autopurge_disposed_samples_delay: Duration::INFINITE,
        }
    }
}

/// TYPE_CONSISTENCY_ENFORCEMENT of a reader: which writers' types it takes (XTypes 1.3 section 7.6.3.7).
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct TypeConsistency {
    /// Whether types that are assignable will do (ALLOW_TYPE_COERCION), or only the same type.
    pub allow_coercion: bool,
    /// Whether bounds of sequences do not count.
    pub ignore_sequence_bounds: bool,
    /// Whether bounds of strings do not count.
    pub ignore_string_bounds: bool,
    /// Whether names of members do not count.
    pub ignore_member_names: bool,
    /// Whether the writer's type may have no fewer members.
    pub prevent_type_widening: bool,
    /// Whether writers without type information are refused.
    pub force_type_validation: bool,
}

impl Default for TypeConsistency {
    fn default() -> Self {
        Self {
            allow_coercion: true,
            ignore_sequence_bounds: true,
            ignore_string_bounds: true,
            ignore_member_names: false,
            prevent_type_widening: false,
            force_type_validation: false,
        }
    }
}
