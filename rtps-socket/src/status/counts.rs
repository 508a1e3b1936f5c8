//! Communication statuses as counts (DDS 1.4 section 2.2.4.1 and figure 2.13), one type for what writers and readers
//! count alike.
//!
//! The fields that end in `_change` are since the status was last asked for, or told to a listener.

use rtps_user::qos::PolicyId;
use rtps_user::reader::RejectedReason;
use rtps_user::wire::{Guid, KeyHash};

use super::{StatusEvent, StatusKind, StatusMask};

/// How often something has happened.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Count {
    /// In all.
    pub total_count: u64,
    /// Change of it.
    pub total_count_change: u64,
}

impl Count {
    /// Counts `more`, and returns the total.
    fn add(&mut self, more: u64) -> u64 {
        self.total_count = self.total_count.saturating_add(more);
        self.total_count_change = self.total_count_change.saturating_add(more);
        self.total_count
    }
}

/// INCONSISTENT_TOPIC.
pub type InconsistentTopicStatus = Count;
/// LIVELINESS_LOST.
pub type LivelinessLostStatus = Count;
/// SAMPLE_LOST.
pub type SampleLostStatus = Count;

/// PUBLICATION_MATCHED or SUBSCRIPTION_MATCHED.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct MatchedStatus {
    /// Matches so far.
    pub total: Count,
    /// Matched endpoints now.
    pub current_count: usize,
    /// Change of `current_count`.
    pub current_count_change: isize,
    /// The endpoint that came or went last.
    pub last: Option<Guid>,
}

/// OFFERED_INCOMPATIBLE_QOS or REQUESTED_INCOMPATIBLE_QOS.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct IncompatibleQosStatus {
    /// Endpoints whose policies did not fit.
    pub total: Count,
    /// The policy that did not fit last.
    pub last_policy: Option<PolicyId>,
    /// How often each policy did not fit; those that always did are left out.
    pub policies: Vec<(PolicyId, u64)>,
}

/// OFFERED_DEADLINE_MISSED or REQUESTED_DEADLINE_MISSED.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct DeadlineMissedStatus {
    /// Deadlines missed, of all instances.
    pub total: Count,
    /// The instance of the last one.
    pub last_instance: Option<KeyHash>,
}

/// LIVELINESS_CHANGED.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct LivelinessChangedStatus {
    /// Matched writers that are alive.
    pub alive_count: u32,
    /// Change of `alive_count`.
    pub alive_count_change: i32,
    /// Matched writers that are not.
    pub not_alive_count: u32,
    /// Change of `not_alive_count`.
    pub not_alive_count_change: i32,
    /// The writer of the last change.
    pub last_writer: Option<Guid>,
}

/// SAMPLE_REJECTED.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct SampleRejectedStatus {
    /// Samples rejected; one that is sent again may be rejected again.
    pub total: Count,
    /// The limit that the last one met.
    pub last_reason: Option<RejectedReason>,
    /// The instance of the last one.
    pub last_instance: Option<KeyHash>,
}

/// The statuses of one writer or reader.
#[derive(Debug, Default)]
pub(crate) struct Statuses {
    matched: MatchedStatus,
    incompatible: IncompatibleQosStatus,
    deadline: DeadlineMissedStatus,
    inconsistent: Count,
    liveliness_lost: Count,
    liveliness: LivelinessChangedStatus,
    lost: Count,
    rejected: SampleRejectedStatus,
    changed: StatusMask,
}

impl Statuses {
    /// Counts an event, and writes into it how it counts.
    pub(crate) fn note(&mut self, event: &mut StatusEvent) {
        self.changed.insert(event.kind());
        match event {
            StatusEvent::PublicationMatched {
                current,
                change,
                total,
                reader: remote,
            }
            | StatusEvent::SubscriptionMatched {
                current,
                change,
                total,
                writer: remote,
            } => (*current, *total) = self.note_match(*change, *remote),
            StatusEvent::OfferedIncompatibleQos { policy, total, .. }
            | StatusEvent::RequestedIncompatibleQos { policy, total, .. } => {
                *total = self.note_incompatible(*policy);
            }
            StatusEvent::InconsistentTopic { total, .. } => *total = self.inconsistent.add(1),
            StatusEvent::LivelinessLost { total } => *total = self.liveliness_lost.add(1),
            StatusEvent::SampleLost { count, total, .. } => *total = self.lost.add(*count),
            StatusEvent::LivelinessChanged {
                alive,
                alive_change,
                not_alive,
                not_alive_change,
                writer,
            } => {
                let status = &mut self.liveliness;
                (status.alive_count, status.not_alive_count) = (*alive, *not_alive);
                status.alive_count_change += *alive_change;
                status.not_alive_count_change += *not_alive_change;
                status.last_writer = Some(*writer);
            }
            StatusEvent::SampleRejected {
                reason,
                instance,
                total,
                ..
            } => {
                let status = &mut self.rejected;
                *total = status.total.add(1);
                (status.last_reason, status.last_instance) = (Some(*reason), Some(*instance));
            }
            StatusEvent::OfferedDeadlineMissed { instance, total }
            | StatusEvent::RequestedDeadlineMissed { instance, total } => {
                *total = self.deadline.total.add(1);
                self.deadline.last_instance = Some(*instance);
            }
            StatusEvent::DataAvailable
            | StatusEvent::DataOnReaders
            | StatusEvent::Refused { .. }
            | StatusEvent::LayerLost
            | StatusEvent::Undecodable { .. } => {}
        }
    }

    fn note_match(&mut self, change: isize, remote: Guid) -> (usize, u64) {
        let status = &mut self.matched;
        if change > 0 {
            status.total.add(1);
        }
        status.current_count = status.current_count.saturating_add_signed(change);
        status.current_count_change += change;
        status.last = Some(remote);
        (status.current_count, status.total.total_count)
    }

    fn note_incompatible(&mut self, policy: PolicyId) -> u64 {
        let status = &mut self.incompatible;
        status.last_policy = Some(policy);
        let mut known = status.policies.iter_mut();
        match known.find(|(known, _)| *known == policy) {
            Some((_, count)) => *count += 1,
            None => status.policies.push((policy, 1)),
        }
        status.total.add(1)
    }

    /// What has changed since it was last asked for, or told to a listener.
    pub(crate) fn changed(&self) -> StatusMask {
        self.changed
    }

    /// A listener was told, which is as good as asking: the changes begin anew.
    pub(crate) fn told(&mut self, kind: StatusKind) {
        self.changed.remove(kind);
        match kind {
            StatusKind::PublicationMatched | StatusKind::SubscriptionMatched => {
                self.matched(kind);
            }
            StatusKind::OfferedIncompatibleQos | StatusKind::RequestedIncompatibleQos => {
                self.incompatible.total.total_count_change = 0;
            }
            StatusKind::OfferedDeadlineMissed | StatusKind::RequestedDeadlineMissed => {
                self.deadline(kind);
            }
            StatusKind::InconsistentTopic => _ = self.inconsistent(),
            StatusKind::LivelinessLost => _ = self.liveliness_lost(),
            StatusKind::LivelinessChanged => _ = self.liveliness(),
            StatusKind::SampleLost => _ = self.lost(),
            StatusKind::SampleRejected => _ = self.rejected(),
            StatusKind::DataOnReaders | StatusKind::DataAvailable | StatusKind::Trouble => {}
        }
    }

    pub(crate) fn matched(&mut self, kind: StatusKind) -> MatchedStatus {
        self.changed.remove(kind);
        let status = self.matched;
        self.matched.total.total_count_change = 0;
        self.matched.current_count_change = 0;
        status
    }

    pub(crate) fn incompatible(&mut self, kind: StatusKind) -> IncompatibleQosStatus {
        self.changed.remove(kind);
        let status = self.incompatible.clone();
        self.incompatible.total.total_count_change = 0;
        status
    }

    pub(crate) fn deadline(&mut self, kind: StatusKind) -> DeadlineMissedStatus {
        self.changed.remove(kind);
        let status = self.deadline;
        self.deadline.total.total_count_change = 0;
        status
    }

    pub(crate) fn inconsistent(&mut self) -> InconsistentTopicStatus {
        self.changed.remove(StatusKind::InconsistentTopic);
        take(&mut self.inconsistent)
    }

    pub(crate) fn liveliness_lost(&mut self) -> LivelinessLostStatus {
        self.changed.remove(StatusKind::LivelinessLost);
        take(&mut self.liveliness_lost)
    }

    pub(crate) fn lost(&mut self) -> SampleLostStatus {
        self.changed.remove(StatusKind::SampleLost);
        take(&mut self.lost)
    }

    pub(crate) fn liveliness(&mut self) -> LivelinessChangedStatus {
        self.changed.remove(StatusKind::LivelinessChanged);
        let status = self.liveliness;
        self.liveliness.alive_count_change = 0;
        self.liveliness.not_alive_count_change = 0;
        status
    }

    pub(crate) fn rejected(&mut self) -> SampleRejectedStatus {
        self.changed.remove(StatusKind::SampleRejected);
        let status = self.rejected;
        self.rejected.total.total_count_change = 0;
        status
    }
}

/// The count; its change is over.
fn take(count: &mut Count) -> Count {
    let taken = *count;
    count.total_count_change = 0;
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    fn incompatible(policy: PolicyId) -> StatusEvent {
        StatusEvent::OfferedIncompatibleQos {
            policy,
            total: 0,
            reader: Guid::UNKNOWN,
        }
    }

    #[test]
    fn counts_go_on_and_changes_begin_anew() {
        let mut statuses = Statuses::default();
        for policy in [PolicyId::Deadline, PolicyId::Durability, PolicyId::Deadline] {
            statuses.note(&mut incompatible(policy));
        }
        let kind = StatusKind::OfferedIncompatibleQos;
        assert!(statuses.changed().contains(kind));
        let status = statuses.incompatible(kind);
        let count = |total_count, total_count_change| Count {
            total_count,
            total_count_change,
        };
        assert_eq!(status.total, count(3, 3));
        assert_eq!(status.last_policy, Some(PolicyId::Deadline));
        let each = [(PolicyId::Deadline, 2), (PolicyId::Durability, 1)];
        assert_eq!(status.policies, each);
        assert!(!statuses.changed().contains(kind));
        let mut event = incompatible(PolicyId::Deadline);
        statuses.note(&mut event);
        assert!(matches!(
            event,
            StatusEvent::OfferedIncompatibleQos { total: 4, .. }
        ));
        assert_eq!(statuses.incompatible(kind).total, count(4, 1));
    }

    #[test]
    fn what_a_listener_was_told_is_no_change_any_more() {
        let mut statuses = Statuses::default();
        let kind = StatusKind::SampleRejected;
        for instance in [KeyHash([1; 16]), KeyHash([2; 16])] {
            statuses.note(&mut StatusEvent::SampleRejected {
                reason: RejectedReason::SamplesPerInstance,
                instance,
                total: 0,
                writer: Guid::UNKNOWN,
            });
            statuses.note(&mut incompatible(PolicyId::Deadline));
            statuses.told(kind);
        }
        assert!(!statuses.changed().contains(kind));
        let status = statuses.rejected();
        assert_eq!(
            (status.total.total_count, status.total.total_count_change),
            (2, 0)
        );
        assert_eq!(status.last_instance, Some(KeyHash([2; 16])));
        assert_eq!(status.last_reason, Some(RejectedReason::SamplesPerInstance));
        let untold = statuses.incompatible(StatusKind::OfferedIncompatibleQos);
        assert_eq!(untold.total.total_count_change, 2);
    }

    #[test]
    fn matches_count_up_and_down() {
        let mut statuses = Statuses::default();
        for change in [1, 1, -1] {
            statuses.note(&mut StatusEvent::PublicationMatched {
                current: 0,
                change,
                total: 0,
                reader: Guid::UNKNOWN,
            });
        }
        let status = statuses.matched(StatusKind::PublicationMatched);
        assert_eq!((status.total.total_count, status.current_count), (2, 1));
        assert_eq!(status.current_count_change, 1);
        assert_eq!(
            statuses
                .matched(StatusKind::PublicationMatched)
                .current_count_change,
            0
        );
    }
}
