//! Requested versus offered (DDS 1.4 section 2.2.3, table; XTypes 1.3 section 7.6.3.1.1 for DATA_REPRESENTATION).

use super::{DataRepresentation, Ownership, PolicyId, Presentation, Qos};

/// Whether a writer that offers `offered` may serve a reader that requests `requested`; else the first policy that
/// does not fit. PARTITION is no part of it: endpoints of different partitions ignore each other silently.
pub fn compatible(offered: &Qos, requested: &Qos) -> Result<(), PolicyId> {
    let checks = [
        (
            offered.reliability.is_reliable() || !requested.reliability.is_reliable(),
            PolicyId::Reliability,
        ),
        (
            offered.durability >= requested.durability,
            PolicyId::Durability,
        ),
        (
            offered.deadline.0 <= requested.deadline.0,
            PolicyId::Deadline,
        ),
        (
            offered.latency_budget.0 <= requested.latency_budget.0,
            PolicyId::LatencyBudget,
        ),
        (
            is_exclusive(offered.ownership) == is_exclusive(requested.ownership),
            PolicyId::Ownership,
        ),
        (
            offered.liveliness.kind >= requested.liveliness.kind
                && offered.liveliness.lease <= requested.liveliness.lease,
            PolicyId::Liveliness,
        ),
        (
            offered.destination_order >= requested.destination_order,
            PolicyId::DestinationOrder,
        ),
        (
            presentation_fits(offered.presentation, requested.presentation),
            PolicyId::Presentation,
        ),
        (
            representation_fits(&offered.representation, &requested.representation),
            PolicyId::DataRepresentation,
        ),
    ];
    match checks.into_iter().find(|(fits, _)| !fits) {
        Some((_, policy)) => Err(policy),
        None => Ok(()),
    }
}

fn is_exclusive(ownership: Ownership) -> bool {
    matches!(ownership, Ownership::Exclusive { .. })
}

fn presentation_fits(offered: Presentation, requested: Presentation) -> bool {
    offered.scope >= requested.scope
        && offered.coherent >= requested.coherent
        && offered.ordered >= requested.ordered
}

/// A writer writes its first representation only; a reader takes any of its list.
fn representation_fits(offered: &[DataRepresentation], requested: &[DataRepresentation]) -> bool {
    let written = offered
        .first()
        .copied()
        .unwrap_or(DataRepresentation::Xcdr1);
    if requested.is_empty() {
        written == DataRepresentation::Xcdr1
    } else {
        requested.contains(&written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qos::{
        Deadline, DestinationOrder, Durability, LatencyBudget, Liveliness, LivelinessKind,
        PresentationScope, Reliability,
    };
    use crate::wire::Duration;

    fn seconds(seconds: i32) -> Duration {
        Duration {
            seconds,
            fraction: 0,
        }
    }

    fn liveliness(kind: LivelinessKind, lease: i32) -> Qos {
        Qos {
            liveliness: Liveliness {
                kind,
                lease: seconds(lease),
            },
            ..Qos::default()
        }
    }

    fn presentation(scope: PresentationScope, coherent: bool) -> Qos {
        with(|qos| {
            qos.presentation = Presentation {
                scope,
                coherent,
                ordered: false,
            }
        })
    }

    fn with(change: impl FnOnce(&mut Qos)) -> Qos {
        let mut qos = Qos::default();
        change(&mut qos);
        qos
    }

    /// Pairs of which the first offers less than the second requests.
    fn mismatches() -> [(PolicyId, Qos, Qos); 9] {
        use LivelinessKind::{Automatic, ManualByTopic};
        use PresentationScope::{Group, Instance, Topic};
        let plain = Qos::default;
        let reliable = with(|qos| qos.reliability = Reliability::RELIABLE);
        let kept = with(|qos| qos.durability = Durability::TransientLocal);
        let frequent = with(|qos| qos.deadline = Deadline(seconds(1)));
        let slow = with(|qos| qos.latency_budget = LatencyBudget(seconds(1)));
        let ordered = with(|qos| qos.destination_order = DestinationOrder::BySourceTimestamp);
        let (brief, long) = (liveliness(Automatic, 1), liveliness(Automatic, 2));
        let manual = liveliness(ManualByTopic, 1);
        let (small, large) = (presentation(Instance, true), presentation(Topic, true));
        let (loose, coherent) = (presentation(Group, false), presentation(Group, true));
        [
            (PolicyId::Reliability, plain(), reliable),
            (PolicyId::Durability, plain(), kept),
            (PolicyId::Deadline, plain(), frequent),
            (PolicyId::LatencyBudget, slow, plain()),
            (PolicyId::Liveliness, brief.clone(), manual),
            (PolicyId::Liveliness, long, brief),
            (PolicyId::DestinationOrder, plain(), ordered),
            (PolicyId::Presentation, small, large),
            (PolicyId::Presentation, loose, coherent),
        ]
    }

    #[test]
    fn less_than_requested_is_refused_and_more_is_taken() {
        for (policy, offered, requested) in mismatches() {
            assert_eq!(compatible(&offered, &requested), Err(policy));
            assert_eq!(compatible(&requested, &offered), Ok(()), "{policy:?}");
        }
    }

    #[test]
    fn ownership_must_be_equal() {
        let exclusive = |strength| Qos {
            ownership: Ownership::Exclusive { strength },
            ..Qos::default()
        };
        assert_eq!(
            compatible(&exclusive(1), &Qos::default()),
            Err(PolicyId::Ownership)
        );
        assert_eq!(
            compatible(&Qos::default(), &exclusive(1)),
            Err(PolicyId::Ownership)
        );
        assert_eq!(compatible(&exclusive(1), &exclusive(2)), Ok(()));
    }

    #[test]
    fn the_first_representation_of_a_writer_counts() {
        use DataRepresentation::{Xcdr1, Xcdr2};
        let with = |list: &[_]| Qos {
            representation: list.to_vec(),
            ..Qos::default()
        };
        let refused = Err(PolicyId::DataRepresentation);
        assert_eq!(compatible(&with(&[]), &with(&[])), Ok(()));
        assert_eq!(compatible(&with(&[]), &with(&[Xcdr2])), refused);
        assert_eq!(compatible(&with(&[Xcdr2]), &with(&[])), refused);
        assert_eq!(compatible(&with(&[Xcdr2, Xcdr1]), &with(&[Xcdr1])), refused);
        assert_eq!(compatible(&with(&[Xcdr2]), &with(&[Xcdr1, Xcdr2])), Ok(()));
    }
}
