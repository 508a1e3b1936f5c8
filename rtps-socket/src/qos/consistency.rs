//! Which policies contradict each other, or leave nothing to do (the consistency rules of DDS 1.4 section 2.2.3).

use rtps_user::qos::{History, PolicyId, Qos, ResourceLimits};
use rtps_user::wire::Duration;

use crate::error::InconsistentPolicy;

/// Refuses what no entity can be created with or changed to: INCONSISTENT_POLICY.
pub(crate) fn check(qos: &Qos) -> Result<(), InconsistentPolicy> {
    check_room(PolicyId::History, qos.history, qos.resource_limits)?;
    let service = qos.durability_service;
    check_room(
        PolicyId::DurabilityService,
        service.history,
        service.resource_limits,
    )?;
    let (deadline, separation) = (qos.deadline.0, qos.time_based_filter.0);
    if deadline == Duration::ZERO {
        return Err(InconsistentPolicy::NoPeriod);
    }
    match separation > deadline {
        true => Err(InconsistentPolicy::Separation {
            separation: separation.to_std(),
            deadline: deadline.to_std(),
        }),
        false => Ok(()),
    }
}

/// HISTORY and RESOURCE_LIMITS, those of `policy`.
fn check_room(
    policy: PolicyId,
    history: History,
    limits: ResourceLimits,
) -> Result<(), InconsistentPolicy> {
    let named = [
        ("max_samples", limits.max_samples),
        ("max_instances", limits.max_instances),
        ("max_samples_per_instance", limits.max_samples_per_instance),
    ];
    if let Some((limit, _)) = named.into_iter().find(|(_, value)| *value == Some(0)) {
        return Err(InconsistentPolicy::NoRoom { policy, limit });
    }
    if let (Some(samples), Some(per_instance)) =
        (limits.max_samples, limits.max_samples_per_instance)
        && samples < per_instance
    {
        return Err(InconsistentPolicy::Limits {
            policy,
            samples,
            per_instance,
        });
    }
    match (history, limits.max_samples_per_instance) {
        (History::KeepLast(0), _) => Err(InconsistentPolicy::NoHistory { policy }),
        (History::KeepLast(depth), Some(limit)) if depth > limit => {
            Err(InconsistentPolicy::Depth {
                policy,
                depth,
                limit,
            })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::qos::DurabilityService;

    fn refusal(qos: crate::qos::Qos) -> Option<InconsistentPolicy> {
        check(&qos.into_reader()).err()
    }

    #[test]
    fn what_is_consistent_passes() {
        let second = Duration::from_secs(1);
        let qos = crate::qos::Qos::reliable()
            .keep_last(3)
            .resource_limits(Some(3), Some(9), Some(3))
            .deadline(second)
            .time_based_filter(second);
        assert_eq!(refusal(qos.clone()), None);
        // KEEP_LAST is limited by the samples of all instances as well, without contradiction.
        assert_eq!(refusal(qos.resource_limits(Some(1), None, None)), None);
        assert_eq!(refusal(crate::qos::Qos::default()), None);
    }

    #[test]
    fn contradictions_are_named_with_their_values() {
        let qos = crate::qos::Qos::default;
        let service = DurabilityService {
            history: History::KeepLast(4),
            resource_limits: ResourceLimits {
                max_samples_per_instance: Some(2),
                ..ResourceLimits::default()
            },
            ..DurabilityService::default()
        };
        let (short, long) = (Duration::from_millis(10), Duration::from_millis(20));
        for (qos, text) in [
            (qos().keep_last(0), "History: KEEP_LAST 0"),
            (
                qos().keep_last(9).resource_limits(None, None, Some(3)),
                "KEEP_LAST 9 exceeds max_samples_per_instance 3",
            ),
            (
                qos().durability_service(service),
                "DurabilityService: KEEP_LAST 4 exceeds max_samples_per_instance 2",
            ),
            (
                qos().keep_all().resource_limits(Some(4), None, Some(5)),
                "max_samples 4 is less than max_samples_per_instance 5",
            ),
            (
                qos().keep_all().resource_limits(None, Some(0), None),
                "max_instances is 0",
            ),
            (qos().deadline(Duration::ZERO), "DEADLINE is 0"),
            (qos().deadline(short).time_based_filter(long), "20ms"),
        ] {
            let said = refusal(qos).expect(text).to_string();
            assert!(said.contains(text), "{said}");
        }
    }
}
