//! Subscriber (DDS 1.4 section 2.2.2.5.2).

use std::sync::Arc;

use rtps_user::wire::Guid;

use super::group::GroupState;
use super::{DataReader, StatusCondition, TopicDescription};
use crate::cdr::DdsType;
use crate::error::{CreateError, SetQosError};
use crate::qos::Qos;
use crate::socket::{RtpsSocket, Trigger};
use crate::status::{EntityEvent, StatusMask};

/// Readers with PARTITION, PRESENTATION and GROUP_DATA in common. Clones are the same subscriber.
#[derive(Clone)]
pub struct Subscriber {
    state: Arc<GroupState>,
}

impl Subscriber {
    pub(super) fn new(socket: RtpsSocket, qos: Qos, is_enabled: bool) -> Self {
        Self {
            state: Arc::new(GroupState::new(socket, qos, is_enabled)),
        }
    }

    /// A reader; where `qos` says nothing of partition, presentation and group data, the subscriber's hold.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_reader<T: DdsType>(
        &self,
        topic: &impl TopicDescription<T>,
        qos: Qos,
    ) -> Result<DataReader<T>, CreateError> {
        let template = self
            .state
            .template::<T>(topic.topic(), qos, Qos::into_reader);
        DataReader::new(&self.state.socket, template, topic.filter())
    }

    /// Its policies.
    pub fn qos(&self) -> Qos {
        self.state.qos()
    }

    /// Changes PARTITION and GROUP_DATA, also of the readers that there are, and ENTITY_FACTORY.
    ///
    /// # Errors
    /// When PRESENTATION differs, which may not change, or the policies are too large.
    pub fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        self.state.set_qos(qos)
    }

    /// The policies that [`create_reader`](Self::create_reader) is meant to be called with (DATAREADER_QOS_DEFAULT).
    pub fn default_reader_qos(&self) -> Qos {
        self.state.default_endpoint_qos()
    }

    /// Changes what [`default_reader_qos`](Self::default_reader_qos) gives.
    pub fn set_default_reader_qos(&self, qos: Qos) {
        self.state.set_default_endpoint_qos(qos);
    }

    /// Enables the subscriber where its participant did not, and its readers where ENTITY_FACTORY says so.
    pub fn enable(&self) {
        self.state.enable();
    }

    /// Whether it is enabled; only then its readers can be.
    pub fn is_enabled(&self) -> bool {
        self.state.is_enabled()
    }

    /// Freezes what the readers show, until the guard is dropped: what comes meanwhile is not seen before, so that all
    /// readers are read in the same state. A reader that is created meanwhile shows nothing before, either. Accesses may be
    /// nested.
    pub fn begin_access(&self) -> Access<'_> {
        self.state.group.begin_access();
        Access { subscriber: self }
    }

    /// Has `listener` called with the events that `mask` holds of its readers, where they have no listener for them, and
    /// with [`DataOnReaders`](crate::StatusKind::DataOnReaders) before they are told of data.
    pub fn set_listener(
        &self,
        mask: StatusMask,
        listener: impl Fn(EntityEvent) + Send + Sync + 'static,
    ) {
        self.state.group.set_listener(mask, Arc::new(listener));
    }

    /// A condition that is true while one of these statuses of one of its readers has changed since it was last asked for, or
    /// one of them has samples that have not been read where it is about DATA_ON_READERS, the subscriber's own.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        StatusCondition::new(self.state.group.watch(Trigger::on(statuses)))
    }

    /// The statuses of its readers that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        self.state.group.status_changes()
    }
}

/// What the readers of a subscriber show stands still until this is dropped (`end_access`).
#[must_use = "the access ends when this is dropped"]
pub struct Access<'a> {
    subscriber: &'a Subscriber,
}

impl Access<'_> {
    /// The readers with samples that have not been read, one entry for each sample, in the order in which the writers of
    /// a publisher have written them: whoever takes one sample of each in turn has that order across topics
    /// (`get_datareaders`). It needs ordered access of GROUP scope; without that it is the order of arrival.
    pub fn readers(&self) -> Vec<Guid> {
        self.subscriber.state.group.readers_in_order()
    }

    /// Ends the access.
    pub fn end(self) {}
}

impl Drop for Access<'_> {
    fn drop(&mut self) {
        self.subscriber.state.group.end_access();
    }
}
