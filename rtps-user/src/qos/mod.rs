//! Quality of service: the policies of DDS 1.4 section 2.2.3 that the layer acts on, as values.
//!
//! [`Qos`] is what an endpoint of either kind is declared with; policies that concern only the other kind keep
//! their defaults and are not announced.

pub(crate) mod content_filter;
mod matching;
pub(crate) mod parameters;
mod partition;
mod policies;
#[cfg(test)]
pub(crate) mod strategies;

pub use content_filter::ContentFilter;
pub use matching::compatible;
pub(crate) use partition::glob_matches;
pub use policies::{
    Deadline, DestinationOrder, Durability, DurabilityService, History, LatencyBudget, Lifespan,
    Liveliness, LivelinessKind, Ownership, Partition, PolicyId, Presentation, PresentationScope,
    ReaderDataLifecycle, Reliability, ResourceLimits, TimeBasedFilter, TypeConsistency,
    WriterDataLifecycle,
};

use serde::{Deserialize, Serialize};

/// DATA_REPRESENTATION: how samples are serialized (XTypes 1.3 section 7.6.3.1.1).
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub enum DataRepresentation {
    /// XCDR version 1, id 0.
    Xcdr1,
    /// XML, id 1: never offered by us.
    Xml,
    /// XCDR version 2, id 2.
    Xcdr2,
}

/// The policies of a writer or reader, and those of its publisher or subscriber, topic and participant that
/// are announced with it.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Qos {
    /// RELIABILITY.
    pub reliability: Reliability,
    /// DURABILITY.
    pub durability: Durability,
    /// DURABILITY_SERVICE (writers).
    pub durability_service: DurabilityService,
    /// HISTORY.
    pub history: History,
    /// RESOURCE_LIMITS.
    pub resource_limits: ResourceLimits,
    /// DEADLINE.
    pub deadline: Deadline,
    /// LATENCY_BUDGET.
    pub latency_budget: LatencyBudget,
    /// LIVELINESS.
    pub liveliness: Liveliness,
    /// OWNERSHIP, with OWNERSHIP_STRENGTH for writers.
    pub ownership: Ownership,
    /// DESTINATION_ORDER.
    pub destination_order: DestinationOrder,
    /// PRESENTATION of the publisher or subscriber.
    pub presentation: Presentation,
    /// PARTITION of the publisher or subscriber.
    pub partition: Partition,
    /// LIFESPAN (writers).
    pub lifespan: Lifespan,
    /// TIME_BASED_FILTER (readers).
    pub time_based_filter: TimeBasedFilter,
    /// TRANSPORT_PRIORITY (writers).
    pub transport_priority: i32,
    /// DATA_REPRESENTATION: what a writer offers (the first only) or a reader accepts; empty means XCDR1.
    pub representation: Vec<DataRepresentation>,
    /// TYPE_CONSISTENCY_ENFORCEMENT (readers).
    pub type_consistency: TypeConsistency,
    /// WRITER_DATA_LIFECYCLE: of the app alone.
    pub writer_data_lifecycle: WriterDataLifecycle,
    /// READER_DATA_LIFECYCLE: of the app alone.
    pub reader_data_lifecycle: ReaderDataLifecycle,
    /// USER_DATA.
    pub user_data: Vec<u8>,
    /// TOPIC_DATA.
    pub topic_data: Vec<u8>,
    /// GROUP_DATA of the publisher or subscriber.
    pub group_data: Vec<u8>,
}
