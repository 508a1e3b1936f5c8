//! The statuses of typed writers and readers, and who is told of them (DDS 1.4 section 2.2.4).

use super::{DataReader, DataWriter, StatusCondition};
use crate::cdr::DdsType;
use crate::socket::Trigger;
use crate::status::{
    DeadlineMissedStatus, IncompatibleQosStatus, InconsistentTopicStatus, LivelinessChangedStatus,
    LivelinessLostStatus, MatchedStatus, SampleLostStatus, SampleRejectedStatus, StatusEvent,
    StatusMask,
};

impl<T: DdsType> DataWriter<T> {
    /// What has happened since the last call, up to the newest 256 events; nothing that a listener was told.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.writer.status_events()
    }

    /// Has `listener` called with every event, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.writer.set_listener(listener);
    }

    /// Has `listener` called with the events that `mask` holds; others go to the listeners of publisher and
    /// participant.
    pub fn set_listener_for(
        &self,
        mask: StatusMask,
        listener: impl Fn(StatusEvent) + Send + Sync + 'static,
    ) {
        self.writer.set_listener_for(mask, listener);
    }

    /// A condition that is true while one of these statuses has changed since it was last asked for.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        StatusCondition::new(self.writer.watch(Trigger::on(statuses)))
    }

    /// The statuses that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        self.writer.status_changes()
    }

    /// PUBLICATION_MATCHED: the readers that it is matched with.
    pub fn publication_matched_status(&self) -> MatchedStatus {
        self.writer.publication_matched_status()
    }

    /// OFFERED_INCOMPATIBLE_QOS: readers that want more than it offers.
    pub fn offered_incompatible_qos_status(&self) -> IncompatibleQosStatus {
        self.writer.offered_incompatible_qos_status()
    }

    /// OFFERED_DEADLINE_MISSED: instances that were not written in time.
    pub fn offered_deadline_missed_status(&self) -> DeadlineMissedStatus {
        self.writer.offered_deadline_missed_status()
    }

    /// LIVELINESS_LOST: how often its lease passed without an assertion.
    pub fn liveliness_lost_status(&self) -> LivelinessLostStatus {
        self.writer.liveliness_lost_status()
    }

    /// INCONSISTENT_TOPIC: readers that use the name of its topic with another type.
    pub fn inconsistent_topic_status(&self) -> InconsistentTopicStatus {
        self.writer.inconsistent_topic_status()
    }
}

impl<T: DdsType> DataReader<T> {
    /// What has happened since the last call, up to the newest 256 events; nothing that a listener was told.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.reader.status_events()
    }

    /// Has `listener` called with every event but the arrival of samples, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.reader.set_listener(listener);
    }

    /// Has `listener` called with the events that `mask` holds; others go to the listeners of subscriber and
    /// participant.
    pub fn set_listener_for(
        &self,
        mask: StatusMask,
        listener: impl Fn(StatusEvent) + Send + Sync + 'static,
    ) {
        self.reader.set_listener_for(mask, listener);
    }

    /// A condition that is true while one of these statuses has changed since it was last asked for.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        StatusCondition::new(self.reader.watch(Trigger::on(statuses)))
    }

    /// The statuses that have changed since they were last asked for; DATA_AVAILABLE as long as there is a sample that has
    /// not been read.
    pub fn status_changes(&self) -> StatusMask {
        self.reader.status_changes()
    }

    /// SUBSCRIPTION_MATCHED: the writers that it is matched with.
    pub fn subscription_matched_status(&self) -> MatchedStatus {
        self.reader.subscription_matched_status()
    }

    /// REQUESTED_INCOMPATIBLE_QOS: writers that offer less than it wants.
    pub fn requested_incompatible_qos_status(&self) -> IncompatibleQosStatus {
        self.reader.requested_incompatible_qos_status()
    }

    /// REQUESTED_DEADLINE_MISSED: instances that got no sample in time.
    pub fn requested_deadline_missed_status(&self) -> DeadlineMissedStatus {
        self.reader.requested_deadline_missed_status()
    }

    /// LIVELINESS_CHANGED: the matched writers that are alive, and those that are not.
    pub fn liveliness_changed_status(&self) -> LivelinessChangedStatus {
        self.reader.liveliness_changed_status()
    }

    /// SAMPLE_LOST: samples that will never come.
    pub fn sample_lost_status(&self) -> SampleLostStatus {
        self.reader.sample_lost_status()
    }

    /// SAMPLE_REJECTED: samples that there was no room for.
    pub fn sample_rejected_status(&self) -> SampleRejectedStatus {
        self.reader.sample_rejected_status()
    }

    /// INCONSISTENT_TOPIC: writers that use the name of its topic with another type.
    pub fn inconsistent_topic_status(&self) -> InconsistentTopicStatus {
        self.reader.inconsistent_topic_status()
    }
}
