//! Arbitrary policies for property tests.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

use super::{
    DataRepresentation, Deadline, DestinationOrder, Durability, DurabilityService, History,
    LatencyBudget, Lifespan, Liveliness, LivelinessKind, Ownership, Partition, Presentation,
    PresentationScope, Qos, Reliability, ResourceLimits, TimeBasedFilter, TypeConsistency,
};
use crate::wire::Duration;

fn duration() -> impl Strategy<Value = Duration> {
    prop_oneof![
        Just(Duration::INFINITE),
        (0..i32::MAX, any::<u32>()).prop_map(|(seconds, fraction)| Duration { seconds, fraction }),
    ]
}

fn reliability() -> impl Strategy<Value = Reliability> {
    prop_oneof![
        Just(Reliability::BestEffort),
        duration().prop_map(|max_blocking_time| Reliability::Reliable { max_blocking_time }),
    ]
}

fn ordering() -> impl Strategy<Value = (DestinationOrder, Presentation)> {
    use DestinationOrder::{ByReceptionTimestamp, BySourceTimestamp};
    use PresentationScope::{Group, Instance, Topic};
    let order = prop_oneof![Just(ByReceptionTimestamp), Just(BySourceTimestamp)];
    let scope = prop_oneof![Just(Instance), Just(Topic), Just(Group)];
    (order, scope, any::<bool>(), any::<bool>()).prop_map(|(order, scope, coherent, ordered)| {
        (
            order,
            Presentation {
                scope,
                coherent,
                ordered,
            },
        )
    })
}

fn keeping() -> impl Strategy<Value = (Durability, History, ResourceLimits)> {
    use Durability::{Persistent, Transient, TransientLocal, Volatile};
    let durability = prop_oneof![
        Just(Volatile),
        Just(TransientLocal),
        Just(Transient),
        Just(Persistent)
    ];
    let history = prop_oneof![
        Just(History::KeepAll),
        (1..=0x7fff_ffff_u32).prop_map(History::KeepLast)
    ];
    let limit = || option::of(0..=0x7fff_ffff_u32);
    (durability, history, limit(), limit(), limit()).prop_map(
        |(durability, history, max_samples, max_instances, max_samples_per_instance)| {
            let limits = ResourceLimits {
                max_samples,
                max_instances,
                max_samples_per_instance,
            };
            (durability, history, limits)
        },
    )
}

fn liveliness() -> impl Strategy<Value = Liveliness> {
    use LivelinessKind::{Automatic, ManualByParticipant, ManualByTopic};
    let kind = prop_oneof![
        Just(Automatic),
        Just(ManualByParticipant),
        Just(ManualByTopic)
    ];
    (kind, duration()).prop_map(|(kind, lease)| Liveliness { kind, lease })
}

fn representation() -> impl Strategy<Value = Vec<DataRepresentation>> {
    use DataRepresentation::{Xcdr1, Xcdr2, Xml};
    vec(prop_oneof![Just(Xcdr1), Just(Xml), Just(Xcdr2)], 0..4)
}

fn octets() -> impl Strategy<Value = Vec<u8>> {
    vec(any::<u8>(), 0..40)
}

/// Policies that a writer, or else a reader, can announce.
pub(crate) fn qos(writer: bool) -> impl Strategy<Value = Qos> {
    let times = (duration(), duration(), duration());
    let ownership = prop_oneof![
        Just(Ownership::Shared),
        any::<i32>().prop_map(move |strength| Ownership::Exclusive {
            strength: if writer { strength } else { 0 }
        }),
    ];
    let partition = vec("[a-z*?]{0,9}", 0..4).prop_map(Partition);
    let data = (octets(), octets(), octets());
    let numbers = (any::<i32>(), representation());
    (
        reliability(),
        keeping(),
        times,
        liveliness(),
        ownership,
        ordering(),
        partition,
        data,
        numbers,
    )
        .prop_map(
            move |(
                reliability,
                (durability, history, resource_limits),
                (deadline, latency_budget, other),
                liveliness,
                ownership,
                (destination_order, presentation),
                partition,
                (user_data, topic_data, group_data),
                (priority, representation),
            )| {
                let mut qos = Qos {
                    reliability,
                    durability,
                    history,
                    resource_limits,
                    deadline: Deadline(deadline),
                    latency_budget: LatencyBudget(latency_budget),
                    liveliness,
                    ownership,
                    destination_order,
                    presentation,
                    partition,
                    representation,
                    user_data,
                    topic_data,
                    group_data,
                    ..Qos::default()
                };
                match writer {
                    true => of_writer(&mut qos, other, priority),
                    false => of_reader(&mut qos, other, priority),
                }
                qos
            },
        )
}

fn of_writer(qos: &mut Qos, lifespan: Duration, priority: i32) {
    qos.lifespan = Lifespan(lifespan);
    qos.transport_priority = priority;
    qos.durability_service = DurabilityService {
        cleanup_delay: qos.deadline.0,
        history: qos.history,
        resource_limits: qos.resource_limits,
    };
}

fn of_reader(qos: &mut Qos, separation: Duration, flags: i32) {
    qos.time_based_filter = TimeBasedFilter(separation);
    qos.type_consistency = TypeConsistency {
        allow_coercion: flags & 1 == 0,
        prevent_type_widening: flags & 2 == 0,
        force_type_validation: flags & 4 == 0,
        ..TypeConsistency::default()
    };
}
