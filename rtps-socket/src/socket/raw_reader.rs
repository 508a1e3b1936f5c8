//! A reader of payloads that stay serialized.

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use futures_core::Stream;
use rtps_user::qos::ContentFilter;
use rtps_user::reader::{InstanceOf, Reader, Sample, Selection};
use rtps_user::wire::{EntityId, Guid, KeyHash};

use super::condition::{Trigger, Watched};
use super::endpoint::EndpointHandle;
use super::template::check_endpoint;
use crate::dcps::EndpointBuiltinTopicData;
use crate::driver::{Core, Limit, Scope, Shared};
use crate::error::{CreateError, SetQosError, WaitError};
use crate::filter::PayloadFilter;
use crate::qos::{Qos, policies};
use crate::status::{
    DeadlineMissedStatus, IncompatibleQosStatus, InconsistentTopicStatus, LivelinessChangedStatus,
    MatchedStatus, SampleLostStatus, SampleRejectedStatus, StatusEvent, StatusKind, StatusMask,
    Statuses,
};

/// A reader. Dropped, it is withdrawn.
pub struct RawReader {
    endpoint: EndpointHandle,
    /// The last to go: what it owns may be other endpoints, which take the lock that the reader is removed under.
    _instance_of: Option<InstanceOf>,
}

impl RawReader {
    pub(super) fn new(endpoint: EndpointHandle, instance_of: Option<InstanceOf>) -> Self {
        Self {
            endpoint,
            _instance_of: instance_of,
        }
    }

    /// Takes up to `max` samples of a selection out of the reader, without waiting.
    pub fn take(&self, max: usize, selection: &Selection) -> Vec<Sample> {
        if *selection != Selection::default() {
            return self.access(|reader| reader.take(max, selection));
        }
        let id = self.endpoint.id();
        self.endpoint.shared().poll_reader(id, |core, _| {
            let reader = core.endpoints.reader_mut(id);
            reader.map_or_else(Vec::new, |reader| reader.take(max, selection))
        })
    }

    /// Reads up to `max` samples of a selection, which stay in the reader and count as read then.
    pub fn read(&self, max: usize, selection: &Selection) -> Vec<Sample> {
        self.access(|reader| reader.read(max, selection))
    }

    /// Takes up to `max` samples of the next instance after `previous`, in the order of key hashes, that has samples of
    /// the selection, without waiting; of the first such instance where there is no previous one.
    pub fn take_next_instance(
        &self,
        previous: Option<KeyHash>,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample> {
        self.of_next_instance(previous, selection, |reader, of_instance| {
            reader.take(max, of_instance)
        })
    }

    /// Reads what [`take_next_instance`](Self::take_next_instance) would take.
    pub fn read_next_instance(
        &self,
        previous: Option<KeyHash>,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample> {
        self.of_next_instance(previous, selection, |reader, of_instance| {
            reader.read(max, of_instance)
        })
    }

    /// Takes up to `max` samples of a selection that pass a filter.
    pub(crate) fn take_where(
        &self,
        max: usize,
        selection: &Selection,
        filter: &PayloadFilter,
    ) -> Vec<Sample> {
        self.access(|reader| reader.take_where(max, selection, filter))
    }

    /// Reads up to `max` samples of a selection that pass a filter.
    pub(crate) fn read_where(
        &self,
        max: usize,
        selection: &Selection,
        filter: &PayloadFilter,
    ) -> Vec<Sample> {
        self.access(|reader| reader.read_where(max, selection, filter))
    }

    fn of_next_instance(
        &self,
        previous: Option<KeyHash>,
        selection: &Selection,
        access: impl FnOnce(&mut Reader, &Selection) -> Vec<Sample>,
    ) -> Vec<Sample> {
        self.access(|reader| {
            let instance = reader.next_instance(previous, selection);
            instance.map_or_else(Vec::new, |instance| {
                let of_instance = Selection {
                    instance: Some(instance),
                    ..*selection
                };
                access(reader, &of_instance)
            })
        })
    }

    /// Takes in what has arrived, then gives what `access` finds in the reader.
    fn access(&self, access: impl FnOnce(&mut Reader) -> Vec<Sample>) -> Vec<Sample> {
        self.endpoint.shared().poll(|core, _| {
            let reader = core.endpoints.reader_mut(self.endpoint.id());
            reader.map_or_else(Vec::new, access)
        })
    }

    /// Whether the reader knows an instance.
    pub fn lookup_instance(&self, instance: KeyHash) -> bool {
        self.endpoint.shared().with(|core, _| {
            let reader = core.endpoints.reader(self.endpoint.id());
            reader.is_some_and(|reader| reader.lookup_instance(instance))
        })
    }

    /// Leaves only the instances that the reader knows.
    pub(crate) fn retain_known<V>(&self, instances: &mut HashMap<KeyHash, V>) {
        self.endpoint.shared().with(|core, _| {
            if let Some(reader) = core.endpoints.reader(self.endpoint.id()) {
                instances.retain(|instance, _| reader.lookup_instance(*instance));
            }
        });
    }

    /// Takes the next sample, waiting for it up to `timeout`. A wait without end ends where the layer is lost, of
    /// which [`StatusEvent::LayerLost`] tells.
    pub fn recv(&self, timeout: Duration) -> Option<Sample> {
        self.recv_within(&mut timeout.into())
    }

    /// As [`recv`](Self::recv), one of several waits that share a limit.
    pub(crate) fn recv_within(&self, limit: &mut Limit) -> Option<Sample> {
        let shared = self.endpoint.shared();
        let id = self.endpoint.id();
        shared.wait_in_reader(id, limit, |core, _| self.take_one(core))
    }

    /// Waits until there is a sample that has not been read; false when `timeout` passes before.
    pub fn wait(&self, timeout: Duration) -> bool {
        let (shared, id) = (self.endpoint.shared(), self.endpoint.id());
        let found = shared.wait_in_reader(id, &mut timeout.into(), |core, _| {
            core.endpoints.reader(id)?.has_data().then_some(())
        });
        found.is_some()
    }

    /// Takes the next sample, or has the task woken when there may be one.
    pub(crate) fn poll_recv(&self, context: &mut Context<'_>) -> Poll<Sample> {
        let id = self.endpoint.id();
        self.endpoint.shared().poll_reader(id, |core, _| {
            if let Some(sample) = self.take_one(core) {
                return Poll::Ready(sample);
            }
            core.wake_later(Scope::Endpoint(id), context.waker());
            Poll::Pending
        })
    }

    /// Samples as they come, for `async` code with any runtime. It never ends.
    pub fn samples(&self) -> RawSamples<'_> {
        RawSamples { reader: self }
    }

    fn take_one(&self, core: &mut Core) -> Option<Sample> {
        let id = self.endpoint.id();
        if !core.endpoints.reader(id)?.has_data() {
            return None;
        }
        core.endpoints.take_next(id, &Selection::default())
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.endpoint.guid()
    }

    /// The writers that it is matched with.
    pub fn matched(&self) -> Vec<Guid> {
        self.endpoint.matched()
    }

    /// What is known of a writer that it is matched with.
    pub fn matched_publication_data(&self, writer: Guid) -> Option<EndpointBuiltinTopicData> {
        self.endpoint.matched_endpoint(writer)
    }

    /// Waits until at least `count` writers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.endpoint.wait_for_matched(count, timeout)
    }

    /// Waits until everything has come that writers matched now keep for readers that come late.
    ///
    /// # Errors
    /// When it has not before `timeout`.
    pub fn wait_for_historical_data(&self, timeout: Duration) -> Result<(), WaitError> {
        let complete = self.endpoint.shared().wait_until(timeout, |core, _| {
            if core.is_lost() {
                return Some(Err(WaitError::LayerLost));
            }
            let reader = core.endpoints.reader(self.endpoint.id());
            reader
                .is_none_or(|reader| reader.is_history_complete())
                .then_some(Ok(()))
        });
        complete.unwrap_or(Err(WaitError::HistoryIncomplete))
    }

    /// Its policies, with those of its subscriber.
    pub fn qos(&self) -> policies::Qos {
        self.endpoint.qos()
    }

    /// Changes its policies, and has others learn of it.
    ///
    /// # Errors
    /// When a policy is among them that may not change, or that makes no sense.
    pub fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        let inherits = qos.inherits();
        self.endpoint.set_qos(inherits, qos.into_reader())?;
        Ok(())
    }

    /// Has others learn of the reader, where it was created not to be known yet.
    pub fn enable(&self) {
        self.endpoint.enable();
    }

    /// What has happened since the last call, up to the newest 256 events; nothing that a listener was told.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.endpoint.status_events()
    }

    /// Has `listener` called with every event but the arrival of samples, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.set_listener_for(StatusMask::WITHOUT_DATA, listener);
    }

    /// Has `listener` called with the events that `mask` holds; others go to the listeners of subscriber and
    /// participant.
    pub fn set_listener_for(
        &self,
        mask: StatusMask,
        listener: impl Fn(StatusEvent) + Send + Sync + 'static,
    ) {
        self.endpoint.set_listener(mask, Arc::new(listener));
    }

    /// A condition of the reader.
    pub(crate) fn watch(&self, trigger: Trigger) -> Watched {
        self.endpoint.watch(trigger)
    }

    /// The statuses that have changed since they were last asked for; DATA_AVAILABLE as long as there is a sample that has
    /// not been read.
    pub fn status_changes(&self) -> StatusMask {
        self.endpoint.status_changes()
    }

    /// SUBSCRIPTION_MATCHED.
    pub fn subscription_matched_status(&self) -> MatchedStatus {
        self.endpoint
            .status(|statuses| statuses.matched(StatusKind::SubscriptionMatched))
    }

    /// REQUESTED_INCOMPATIBLE_QOS.
    pub fn requested_incompatible_qos_status(&self) -> IncompatibleQosStatus {
        self.endpoint
            .status(|statuses| statuses.incompatible(StatusKind::RequestedIncompatibleQos))
    }

    /// REQUESTED_DEADLINE_MISSED.
    pub fn requested_deadline_missed_status(&self) -> DeadlineMissedStatus {
        self.endpoint
            .status(|statuses| statuses.deadline(StatusKind::RequestedDeadlineMissed))
    }

    /// LIVELINESS_CHANGED.
    pub fn liveliness_changed_status(&self) -> LivelinessChangedStatus {
        self.endpoint.status(Statuses::liveliness)
    }

    /// SAMPLE_LOST.
    pub fn sample_lost_status(&self) -> SampleLostStatus {
        self.endpoint.status(Statuses::lost)
    }

    /// SAMPLE_REJECTED.
    pub fn sample_rejected_status(&self) -> SampleRejectedStatus {
        self.endpoint.status(Statuses::rejected)
    }

    /// INCONSISTENT_TOPIC, as far as this reader is concerned.
    pub fn inconsistent_topic_status(&self) -> InconsistentTopicStatus {
        self.endpoint.status(Statuses::inconsistent)
    }

    /// What the reader's content filter is changed with.
    pub(crate) fn filter_setter(&self) -> FilterSetter {
        FilterSetter {
            shared: Arc::clone(self.endpoint.shared()),
            reader: self.endpoint.id(),
        }
    }

    /// Reports what the typed API finds out.
    pub(crate) fn report(&self, event: StatusEvent) {
        let id = self.endpoint.id();
        self.endpoint
            .shared()
            .with(|core, _| core.report(id, event));
    }
}

/// Changes the content filter of a reader that is there.
pub(crate) struct FilterSetter {
    shared: Arc<Shared>,
    reader: EntityId,
}

impl FilterSetter {
    /// Has writers and the reader itself heed another filter.
    ///
    /// # Errors
    /// When it is too large to be announced; all stays as it was then.
    pub(crate) fn set(
        &self,
        announced: ContentFilter,
        payloads: PayloadFilter,
    ) -> Result<(), CreateError> {
        self.shared.with(|core, now| {
            let Some(entity) = core.entity(self.reader) else {
                return Ok(());
            };
            let mut endpoint = entity.declaration().endpoint.clone();
            endpoint.content_filter = Some(announced.clone());
            check_endpoint(endpoint)?;
            if let Some(reader) = core.endpoints.reader_mut(self.reader) {
                reader.set_content_filter(Some(payloads), Some(announced.signature()));
            }
            core.change_filter(now, self.reader, announced);
            Ok(())
        })
    }
}

/// The samples of a [`RawReader`] as a stream.
pub struct RawSamples<'a> {
    reader: &'a RawReader,
}

impl Stream for RawSamples<'_> {
    type Item = Sample;

    fn poll_next(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Sample>> {
        self.reader.poll_recv(context).map(Some)
    }
}
