//! Publisher (DDS 1.4 section 2.2.2.4.1).

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::group::GroupState;
use super::{DataWriter, StatusCondition, Topic};
use crate::cdr::DdsType;
use crate::error::{CreateError, SetQosError, WaitError};
use crate::qos::Qos;
use crate::socket::{RtpsSocket, Trigger};
use crate::status::{EntityEvent, StatusMask};

/// Writers with PARTITION, PRESENTATION and GROUP_DATA in common. Clones are the same publisher.
#[derive(Clone)]
pub struct Publisher {
    state: Arc<GroupState>,
}

impl Publisher {
    pub(super) fn new(socket: RtpsSocket, qos: Qos, is_enabled: bool) -> Self {
        Self {
            state: Arc::new(GroupState::new(socket, qos, is_enabled)),
        }
    }

    /// A writer; where `qos` says nothing of partition, presentation and group data, the publisher's hold.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_writer<T: DdsType>(
        &self,
        topic: &Topic<T>,
        qos: Qos,
    ) -> Result<DataWriter<T>, CreateError> {
        let template = self.state.template::<T>(topic, qos, Qos::into_writer);
        DataWriter::new(&self.state.socket, template)
    }

    /// Its policies.
    pub fn qos(&self) -> Qos {
        self.state.qos()
    }

    /// Changes PARTITION and GROUP_DATA, also of the writers that there are, and ENTITY_FACTORY.
    ///
    /// # Errors
    /// When PRESENTATION differs, which may not change, or the policies are too large.
    pub fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        self.state.set_qos(qos)
    }

    /// The policies that [`create_writer`](Self::create_writer) is meant to be called with (DATAWRITER_QOS_DEFAULT).
    pub fn default_writer_qos(&self) -> Qos {
        self.state.default_endpoint_qos()
    }

    /// Changes what [`default_writer_qos`](Self::default_writer_qos) gives.
    pub fn set_default_writer_qos(&self, qos: Qos) {
        self.state.set_default_endpoint_qos(qos);
    }

    /// Enables the publisher where its participant did not, and its writers where ENTITY_FACTORY says so.
    pub fn enable(&self) {
        self.state.enable();
    }

    /// Whether it is enabled; only then its writers can be.
    pub fn is_enabled(&self) -> bool {
        self.state.is_enabled()
    }

    /// What its writers write from now on is one coherent set, if PRESENTATION offers coherent access: readers that want it so
    /// see all of it or nothing. Sets may be nested; the outermost counts.
    pub fn begin_coherent_changes(&self) {
        self.state.group.begin_coherent_changes();
    }

    /// Ends what [`begin_coherent_changes`](Self::begin_coherent_changes) began; without effect where nothing was.
    pub fn end_coherent_changes(&self) {
        self.state.group.end_coherent_changes();
    }

    /// A coherent set that ends when the guard is dropped.
    pub fn coherent_changes(&self) -> CoherentChanges<'_> {
        self.begin_coherent_changes();
        CoherentChanges { publisher: self }
    }

    /// Lets samples wait a little for more, whatever LATENCY_BUDGET says: many of them will follow.
    pub fn suspend_publications(&self) {
        self.state.group.suspend(true);
    }

    /// Sends what waits, and all further samples at once.
    pub fn resume_publications(&self) {
        self.state.group.suspend(false);
    }

    /// Waits until every reliable reader has acknowledged everything that any of the writers has written.
    ///
    /// # Errors
    /// When one has not after `timeout`.
    pub fn wait_for_acknowledgments(&self, timeout: Duration) -> Result<(), WaitError> {
        let deadline = Instant::now().checked_add(timeout);
        self.state.group.wait_for_acknowledgments(deadline)
    }

    /// Has `listener` called with the events that `mask` holds of its writers, where they have no listener for them.
    pub fn set_listener(
        &self,
        mask: StatusMask,
        listener: impl Fn(EntityEvent) + Send + Sync + 'static,
    ) {
        self.state.group.set_listener(mask, Arc::new(listener));
    }

    /// A condition that is true while one of these statuses of one of its writers has changed since it was last asked for. A
    /// publisher has no statuses of its own.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        StatusCondition::new(self.state.group.watch(Trigger::on(statuses)))
    }

    /// The statuses of its writers that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        self.state.group.status_changes()
    }
}

/// A coherent set that is open until this is dropped.
#[must_use = "the set ends when this is dropped"]
pub struct CoherentChanges<'a> {
    publisher: &'a Publisher,
}

impl Drop for CoherentChanges<'_> {
    fn drop(&mut self) {
        self.publisher.end_coherent_changes();
    }
}
