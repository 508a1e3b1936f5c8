//! Quality of service for writers and readers: presets and builder methods over [`policies`].
//!
//! What is not set has the default of DDS 1.4 section 2.2.3: KEEP_LAST 1, VOLATILE, writers RELIABLE, readers
//! BEST_EFFORT.

mod consistency;

use std::time::Duration;

/// The policies themselves.
pub use rtps_user::qos as policies;
use rtps_user::qos::{
    DataRepresentation, Deadline, LatencyBudget, Lifespan, Liveliness, Ownership, Partition,
    Presentation, ReaderDataLifecycle, ResourceLimits, TimeBasedFilter, WriterDataLifecycle,
};
pub use rtps_user::qos::{
    DestinationOrder, Durability, DurabilityService, History, LivelinessKind, PolicyId,
    PresentationScope, Reliability, TypeConsistency,
};
use rtps_user::wire;

pub(crate) use self::consistency::check as check_consistency;
use crate::driver::Inherits;
use crate::error::InconsistentPolicy;

/// The policies of a writer or reader.
///
/// ```
/// use rtps_socket::Qos;
///
/// let state = Qos::reliable().transient_local().keep_last(10);
/// let stream = Qos::best_effort();
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Qos {
    reliability: Option<Reliability>,
    policies: policies::Qos,
    /// ENTITY_FACTORY, turned round: its default is true.
    leaves_disabled: bool,
}

impl Qos {
    /// Lost samples are repeated.
    pub fn reliable() -> Self {
        Self {
            reliability: Some(Reliability::RELIABLE),
            ..Self::default()
        }
    }

    /// Lost samples stay lost.
    pub fn best_effort() -> Self {
        Self {
            reliability: Some(Reliability::BestEffort),
            ..Self::default()
        }
    }

    /// How long a reliable write may wait for room in the history; the default is 100 ms.
    #[must_use]
    pub fn max_blocking_time(mut self, time: Duration) -> Self {
        self.reliability = Some(Reliability::Reliable {
            max_blocking_time: wire::Duration::from_std(time),
        });
        self
    }

    /// HISTORY: keeps the newest `depth` samples of each instance.
    #[must_use]
    pub fn keep_last(mut self, depth: u32) -> Self {
        self.policies.history = History::KeepLast(depth);
        self
    }

    /// HISTORY: keeps every sample, within the resource limits; a full history holds the writer up.
    #[must_use]
    pub fn keep_all(mut self) -> Self {
        self.policies.history = History::KeepAll;
        self
    }

    /// RESOURCE_LIMITS: samples in all, instances, samples of each instance; `None` is unlimited.
    #[must_use]
    pub fn resource_limits(
        mut self,
        samples: Option<u32>,
        instances: Option<u32>,
        samples_per_instance: Option<u32>,
    ) -> Self {
        self.policies.resource_limits = ResourceLimits {
            max_samples: samples,
            max_instances: instances,
            max_samples_per_instance: samples_per_instance,
        };
        self
    }

    /// DURABILITY: readers that join late get what the writer's history has.
    #[must_use]
    pub fn transient_local(mut self) -> Self {
        self.policies.durability = Durability::TransientLocal;
        self
    }

    /// DURABILITY.
    #[must_use]
    pub fn durability(mut self, durability: Durability) -> Self {
        self.policies.durability = durability;
        self
    }

    /// DURABILITY_SERVICE: what TRANSIENT and PERSISTENT writers keep for readers that join late.
    #[must_use]
    pub fn durability_service(mut self, service: DurabilityService) -> Self {
        self.policies.durability_service = service;
        self
    }

    /// DEADLINE: the longest time between two samples of an instance.
    #[must_use]
    pub fn deadline(mut self, period: Duration) -> Self {
        self.policies.deadline = Deadline(wire::Duration::from_std(period));
        self
    }

    /// LATENCY_BUDGET.
    #[must_use]
    pub fn latency_budget(mut self, budget: Duration) -> Self {
        self.policies.latency_budget = LatencyBudget(wire::Duration::from_std(budget));
        self
    }

    /// LIVELINESS: who asserts that a writer is alive, and how long that holds.
    #[must_use]
    pub fn liveliness(mut self, kind: LivelinessKind, lease: Duration) -> Self {
        let lease = wire::Duration::from_std(lease);
        self.policies.liveliness = Liveliness { kind, lease };
        self
    }

    /// OWNERSHIP: only the strongest writer of an instance counts. Readers' strength has no meaning.
    #[must_use]
    pub fn exclusive_ownership(mut self, strength: i32) -> Self {
        self.policies.ownership = Ownership::Exclusive { strength };
        self
    }

    /// DESTINATION_ORDER.
    #[must_use]
    pub fn destination_order(mut self, order: DestinationOrder) -> Self {
        self.policies.destination_order = order;
        self
    }

    /// LIFESPAN: how long a sample is worth something.
    #[must_use]
    pub fn lifespan(mut self, lifespan: Duration) -> Self {
        self.policies.lifespan = Lifespan(wire::Duration::from_std(lifespan));
        self
    }

    /// TIME_BASED_FILTER: a reader wants no two samples of an instance within less time.
    #[must_use]
    pub fn time_based_filter(mut self, minimum_separation: Duration) -> Self {
        let separation = wire::Duration::from_std(minimum_separation);
        self.policies.time_based_filter = TimeBasedFilter(separation);
        self
    }

    /// TRANSPORT_PRIORITY: a writer's datagrams carry it as DSCP, 0 to 63.
    #[must_use]
    pub fn transport_priority(mut self, priority: i32) -> Self {
        self.policies.transport_priority = priority;
        self
    }

    /// WRITER_DATA_LIFECYCLE: whether an instance that the writer unregisters is disposed as well, as it is by default.
    #[must_use]
    pub fn autodispose_unregistered_instances(mut self, autodispose: bool) -> Self {
        self.policies.writer_data_lifecycle = WriterDataLifecycle {
            autodispose_unregistered_instances: autodispose,
        };
        self
    }

    /// READER_DATA_LIFECYCLE: how long samples that nobody takes stay after their instance has lost its last writer, or
    /// was disposed; for ever by default.
    #[must_use]
    pub fn autopurge(mut self, nowriter: Duration, disposed: Duration) -> Self {
        self.policies.reader_data_lifecycle = ReaderDataLifecycle {
            autopurge_nowriter_samples_delay: wire::Duration::from_std(nowriter),
            autopurge_disposed_samples_delay: wire::Duration::from_std(disposed),
        };
        self
    }

    /// TYPE_CONSISTENCY_ENFORCEMENT: which writers' types a reader takes.
    #[must_use]
    pub fn type_consistency(mut self, consistency: TypeConsistency) -> Self {
        self.policies.type_consistency = consistency;
        self
    }

    /// ENTITY_FACTORY: whether a publisher or subscriber enables what it creates, as it does by default.
    #[must_use]
    pub fn autoenable_created_entities(mut self, autoenable: bool) -> Self {
        self.leaves_disabled = !autoenable;
        self
    }

    /// DATA_REPRESENTATION: a writer writes XCDR version 1, which is the default; a reader reads nothing else.
    #[must_use]
    pub fn xcdr1(mut self) -> Self {
        self.policies.representation = vec![DataRepresentation::Xcdr1];
        self
    }

    /// DATA_REPRESENTATION: a writer writes XCDR version 2; a reader reads nothing else.
    #[must_use]
    pub fn xcdr2(mut self) -> Self {
        self.policies.representation = vec![DataRepresentation::Xcdr2];
        self
    }

    /// PARTITION: only endpoints with a partition in common match; `*`, `?` and `[...]` are wildcards.
    #[must_use]
    pub fn partition<S: Into<String>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        self.policies.partition = Partition(names.into_iter().map(Into::into).collect());
        self
    }

    /// PRESENTATION: what coherent and ordered access span.
    #[must_use]
    pub fn presentation(mut self, scope: PresentationScope, coherent: bool, ordered: bool) -> Self {
        self.policies.presentation = Presentation {
            scope,
            coherent,
            ordered,
        };
        self
    }

    /// USER_DATA: bytes that others see in the endpoint's announcement.
    #[must_use]
    pub fn user_data(mut self, data: impl Into<Vec<u8>>) -> Self {
        self.policies.user_data = data.into();
        self
    }

    /// GROUP_DATA: bytes that others see in the announcements of the publisher's or subscriber's endpoints.
    #[must_use]
    pub fn group_data(mut self, data: impl Into<Vec<u8>>) -> Self {
        self.policies.group_data = data.into();
        self
    }

    /// TOPIC_DATA: bytes that others see in the announcements of the topic's endpoints.
    #[must_use]
    pub fn topic_data(mut self, data: impl Into<Vec<u8>>) -> Self {
        self.policies.topic_data = data.into();
        self
    }

    /// Any other policies, RELIABILITY included.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut policies::Qos)) -> Self {
        self.policies.reliability = self.reliability.unwrap_or_default();
        let before = self.policies.reliability;
        change(&mut self.policies);
        if self.policies.reliability != before {
            self.reliability = Some(self.policies.reliability);
        }
        self
    }

    /// Takes over what a topic says ([`Topic::qos`](crate::Topic::qos)), in place of what is said here: all policies that a topic
    /// has in common with writers and readers (`copy_from_topic_qos`, DDS 1.4 section 2.2.2.4.1.15).
    #[must_use]
    pub fn copy_from_topic(mut self, topic: &Self) -> Self {
        self.reliability = topic.reliability;
        let (own, topic) = (&mut self.policies, &topic.policies);
        own.reliability = topic.reliability;
        own.durability = topic.durability;
        own.durability_service = topic.durability_service;
        own.deadline = topic.deadline;
        own.latency_budget = topic.latency_budget;
        own.liveliness = topic.liveliness;
        own.destination_order = topic.destination_order;
        own.history = topic.history;
        own.resource_limits = topic.resource_limits;
        own.transport_priority = topic.transport_priority;
        own.lifespan = topic.lifespan;
        own.ownership = topic.ownership;
        own.representation.clone_from(&topic.representation);
        own.topic_data.clone_from(&topic.topic_data);
        self
    }

    /// Refuses policies that contradict each other.
    pub(crate) fn check(&self) -> Result<(), InconsistentPolicy> {
        check_consistency(&self.policies)
    }

    /// TOPIC_DATA is the topic's, where nothing is said of it.
    #[must_use]
    pub(crate) fn on_topic(mut self, topic: &Self) -> Self {
        if self.policies.topic_data.is_empty() {
            self.policies
                .topic_data
                .clone_from(&topic.policies.topic_data);
        }
        self
    }

    /// What a publisher or subscriber says for its endpoints, where this one says nothing itself.
    #[must_use]
    pub(crate) fn in_group(mut self, group: &Self) -> Self {
        let (own, group) = (&mut self.policies, &group.policies);
        if own.partition == Partition::default() {
            own.partition.clone_from(&group.partition);
        }
        if own.presentation == Presentation::default() {
            own.presentation = group.presentation;
        }
        if own.group_data.is_empty() {
            own.group_data.clone_from(&group.group_data);
        }
        self
    }

    /// What an endpoint with these policies has from its publisher or subscriber.
    pub(crate) fn inherits(&self) -> Inherits {
        Inherits {
            partition: self.policies.partition == Partition::default(),
            group_data: self.policies.group_data.is_empty(),
        }
    }

    /// ENTITY_FACTORY.
    pub(crate) fn autoenables(&self) -> bool {
        !self.leaves_disabled
    }

    /// PRESENTATION.
    pub(crate) fn presentation_policy(&self) -> Presentation {
        self.policies.presentation
    }

    /// The policies of a writer.
    pub(crate) fn into_writer(self) -> policies::Qos {
        let mut policies = self.policies;
        policies.reliability = self.reliability.unwrap_or(Reliability::RELIABLE);
        policies
    }

    /// The policies of a reader. It reads both representations unless told otherwise.
    pub(crate) fn into_reader(self) -> policies::Qos {
        let mut policies = self.policies;
        policies.reliability = self.reliability.unwrap_or(Reliability::BestEffort);
        if policies.representation.is_empty() {
            policies.representation = vec![DataRepresentation::Xcdr1, DataRepresentation::Xcdr2];
        }
        policies
    }
}

/// The first policy of two sets that differ in it although it may not change (DDS 1.4 section 2.2.3), OWNERSHIP's
/// strength and RELIABILITY's time aside.
pub(crate) fn changed_for_good(before: &policies::Qos, after: &policies::Qos) -> Option<PolicyId> {
    let kind = |ownership| matches!(ownership, Ownership::Exclusive { .. });
    [
        (
            before.reliability != after.reliability,
            PolicyId::Reliability,
        ),
        (before.durability != after.durability, PolicyId::Durability),
        (
            before.durability_service != after.durability_service,
            PolicyId::DurabilityService,
        ),
        (before.history != after.history, PolicyId::History),
        (
            before.resource_limits != after.resource_limits,
            PolicyId::ResourceLimits,
        ),
        (before.liveliness != after.liveliness, PolicyId::Liveliness),
        (
            kind(before.ownership) != kind(after.ownership),
            PolicyId::Ownership,
        ),
        (
            before.destination_order != after.destination_order,
            PolicyId::DestinationOrder,
        ),
        (
            before.presentation != after.presentation,
            PolicyId::Presentation,
        ),
        (
            before.representation != after.representation,
            PolicyId::DataRepresentation,
        ),
        (
            before.type_consistency != after.type_consistency,
            PolicyId::TypeConsistency,
        ),
    ]
    .into_iter()
    .find_map(|(differs, policy)| differs.then_some(policy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_of_the_standard() {
        let (writer, reader) = (Qos::default().into_writer(), Qos::default().into_reader());
        assert_eq!(writer.reliability, Reliability::RELIABLE);
        assert_eq!(reader.reliability, Reliability::BestEffort);
        assert_eq!(writer.history, History::KeepLast(1));
        assert!(writer.representation.is_empty());
        assert_eq!(reader.representation.len(), 2);
    }

    #[test]
    fn what_is_set_stays() {
        let qos = Qos::best_effort().keep_all().transient_local().xcdr2();
        let qos = qos
            .with(|policies| policies.transport_priority = 3)
            .into_writer();
        assert_eq!(qos.reliability, Reliability::BestEffort);
        assert_eq!(qos.history, History::KeepAll);
        assert_eq!(qos.durability, Durability::TransientLocal);
        assert_eq!(qos.representation, [DataRepresentation::Xcdr2]);
        assert_eq!(qos.transport_priority, 3);
    }

    #[test]
    fn a_topic_is_copied_but_for_what_it_does_not_have() {
        let topic = Qos::best_effort().keep_last(7).topic_data(*b"t");
        let qos = Qos::reliable().keep_all().partition(["p"]);
        let qos = qos.copy_from_topic(&topic).into_writer();
        assert_eq!(qos.reliability, Reliability::BestEffort);
        assert_eq!(qos.history, History::KeepLast(7));
        assert_eq!(
            (&qos.topic_data[..], &*qos.partition.0[0]),
            (&b"t"[..], "p")
        );
    }

    #[test]
    fn a_group_speaks_for_endpoints_that_say_nothing() {
        let group = Qos::default().partition(["a", "b"]).group_data(*b"g");
        let silent = Qos::default().in_group(&group).into_reader();
        assert_eq!(silent.partition.0, ["a", "b"]);
        assert_eq!(silent.group_data, b"g");
        let own = Qos::default()
            .partition(["own"])
            .in_group(&group)
            .into_reader();
        assert_eq!(own.partition.0, ["own"]);
    }

    #[test]
    fn what_may_not_change_is_named() {
        let before = Qos::reliable().exclusive_ownership(1).into_writer();
        let after = Qos::reliable()
            .exclusive_ownership(2)
            .deadline(Duration::from_secs(1))
            .partition(["p"])
            .user_data(*b"u")
            .into_writer();
        assert_eq!(changed_for_good(&before, &after), None);
        for (after, policy) in [
            (Qos::reliable(), PolicyId::Ownership),
            (Qos::best_effort(), PolicyId::Reliability),
            (Qos::reliable().transient_local(), PolicyId::Durability),
            (Qos::reliable().keep_all(), PolicyId::History),
            (Qos::reliable().xcdr2(), PolicyId::DataRepresentation),
        ] {
            let after = after.into_writer();
            let ownership = before.ownership;
            let after = match policy {
                PolicyId::Ownership => after,
                _ => policies::Qos { ownership, ..after },
            };
            assert_eq!(changed_for_good(&before, &after), Some(policy));
        }
    }
}
