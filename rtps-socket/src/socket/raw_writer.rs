//! A writer of payloads that are serialized already.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use bytes::Bytes;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::qos::{Qos, Reliability};
use rtps_user::wire::{Guid, KeyHash, SequenceNumber, Timestamp};
use rtps_user::writer::{self, Refused};

use super::Group;
use super::condition::{Trigger, Watched};
use super::endpoint::{EndpointHandle, deadline};
use super::loan::{Loan, Pool};
use crate::dcps::EndpointBuiltinTopicData;
use crate::driver::{Core, Patience, PatienceCell};
use crate::error::{SetQosError, WaitError, WriteError};
use crate::status::{
    DeadlineMissedStatus, IncompatibleQosStatus, InconsistentTopicStatus, LivelinessLostStatus,
    MatchedStatus, StatusEvent, StatusKind, StatusMask, Statuses,
};

/// The encapsulation header.
const HEADER_LEN: usize = 4;

/// What a [`RawWriter`] sends.
#[derive(Clone, Debug)]
pub struct RawChange {
    /// What it does to its instance.
    pub kind: ChangeKind,
    /// The instance; zeros where the topic has no key.
    pub instance: KeyHash,
    /// The serialized sample with its encapsulation header; only the key where the kind is not `Alive`.
    pub payload: Bytes,
    /// The source timestamp; now, where there is none.
    pub timestamp: Option<SystemTime>,
}

/// A writer. Dropped, it is withdrawn: samples that readers still lack are gone.
pub struct RawWriter {
    endpoint: EndpointHandle,
    max_blocking_time: Option<Duration>,
    patience: PatienceCell,
    is_enabled: AtomicBool,
    loans: Arc<Pool>,
}

impl RawWriter {
    pub(super) fn new(endpoint: EndpointHandle, qos: &Qos, is_enabled: bool) -> Self {
        let max_blocking_time = match qos.reliability {
            Reliability::Reliable { max_blocking_time } => max_blocking_time.to_std(),
            Reliability::BestEffort => Some(Duration::ZERO),
        };
        Self {
            endpoint,
            max_blocking_time,
            patience: PatienceCell::new(qos),
            is_enabled: AtomicBool::new(is_enabled),
            loans: Arc::default(),
        }
    }

    /// Sends a sample of a topic without key: the payload with its encapsulation header.
    ///
    /// # Errors
    /// As [`send_change`](Self::send_change).
    pub fn send(&self, payload: impl Into<Bytes>) -> Result<SequenceNumber, WriteError> {
        self.send_change(RawChange {
            kind: ChangeKind::Alive,
            instance: KeyHash::default(),
            payload: payload.into(),
            timestamp: None,
        })
    }

    /// Lends a buffer for a payload of `len` bytes, its encapsulation header among them.
    pub fn loan(&self, len: usize) -> Loan {
        self.loans.lend(len)
    }

    /// Sends what was written into a loan, without copying it into the history: of the instance with this key hash,
    /// zeros where the topic has no key.
    ///
    /// # Errors
    /// As [`send_change`](Self::send_change).
    pub fn send_loaned(&self, loan: Loan, instance: KeyHash) -> Result<SequenceNumber, WriteError> {
        self.send_change(RawChange {
            kind: ChangeKind::Alive,
            instance,
            payload: loan.into_payload(),
            timestamp: None,
        })
    }

    /// Sends a change at once, from the caller's thread. While a reliable KEEP_ALL history is full it waits, up to
    /// the writer's max_blocking_time.
    ///
    /// # Errors
    /// When the history stays full, or cannot take the change at all.
    pub fn send_change(&self, change: RawChange) -> Result<SequenceNumber, WriteError> {
        if change.kind == ChangeKind::Alive && change.payload.len() < HEADER_LEN {
            return Err(WriteError::NoEncapsulation(change.payload.len()));
        }
        if !self.is_enabled.load(Ordering::Relaxed) && !self.check_enabled() {
            return Err(WriteError::NotEnabled);
        }
        let (len, shared) = (change.payload.len(), self.endpoint.shared());
        let written = shared.write(len, self.patience(), |core, now| {
            if core.is_lost() {
                return Err(WriteError::LayerLost);
            }
            let change = stamped(change, || core.wall_time(now));
            self.write(core, now, change).ok_or(WriteError::Closed)
        });
        match written? {
            Ok(sequence) => Ok(sequence),
            Err(refused) if refused.error == writer::WriteError::HistoryFull => {
                self.send_when_there_is_room(refused.change)
            }
            Err(refused) => Err(WriteError::Refused(refused.error)),
        }
    }

    fn patience(&self) -> Patience {
        let patience = self.patience.get();
        match self.endpoint.group() {
            Some(group) if group.is_suspended() => patience.suspended(),
            _ => patience,
        }
    }

    fn send_when_there_is_room(&self, change: NewChange) -> Result<SequenceNumber, WriteError> {
        let deadline = self.max_blocking_time.and_then(deadline);
        let mut unsent = Some(change);
        let written = self.endpoint.shared().wait_until(deadline, |core, now| {
            match self.write(core, now, unsent.take()?)? {
                Err(refused) if refused.error == writer::WriteError::HistoryFull => {
                    unsent = Some(refused.change);
                    None
                }
                written => {
                    core.resume_stream(now);
                    Some(written.map_err(|refused| refused.error))
                }
            }
        });
        written
            .ok_or(WriteError::Timeout)?
            .map_err(WriteError::Refused)
    }

    /// Takes the change where the history has room for it; `None` where there is no writer any more.
    fn write(
        &self,
        core: &mut Core,
        now: Instant,
        change: NewChange,
    ) -> Option<Result<SequenceNumber, Refused>> {
        let writer = core.endpoints.writer_mut(self.endpoint.id())?;
        let mut group = self.endpoint.group().and_then(Group::sequence);
        Some(writer.write_or_return(now, change, group.as_deref_mut()))
    }

    /// Registers an instance before its first sample, which takes its place within max_instances.
    ///
    /// # Errors
    /// When there is no place.
    pub fn register_instance(&self, instance: KeyHash) -> Result<(), WriteError> {
        let registered = self.endpoint.shared().with(|core, now| {
            let writer = core.endpoints.writer_mut(self.endpoint.id());
            writer.map(|writer| writer.register_instance(now, instance))
        });
        registered
            .ok_or(WriteError::Closed)?
            .map_err(WriteError::Refused)
    }

    /// Whether an instance is registered, by [`register_instance`](Self::register_instance) or by being written. Without
    /// max_instances and DEADLINE no book is kept, and only instances in the history are.
    pub fn is_registered(&self, instance: KeyHash) -> bool {
        self.endpoint.shared().with(|core, _| {
            let writer = core.endpoints.writer(self.endpoint.id());
            writer.is_some_and(|writer| writer.is_registered(instance))
        })
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.endpoint.guid()
    }

    /// The readers that it is matched with.
    pub fn matched(&self) -> Vec<Guid> {
        self.endpoint.matched()
    }

    /// What is known of a reader that it is matched with.
    pub fn matched_subscription_data(&self, reader: Guid) -> Option<EndpointBuiltinTopicData> {
        self.endpoint.matched_endpoint(reader)
    }

    /// Waits until at least `count` readers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.endpoint.wait_for_matched(count, timeout)
    }

    /// Waits until every reliable reader has acknowledged everything.
    ///
    /// # Errors
    /// When one has not after `timeout`.
    pub fn wait_for_acknowledgments(&self, timeout: Duration) -> Result<(), WaitError> {
        let acknowledged = self.endpoint.shared().wait_until(timeout, |core, _| {
            if core.is_lost() {
                return Some(Err(WaitError::LayerLost));
            }
            let writer = core.endpoints.writer(self.endpoint.id());
            writer
                .is_none_or(|writer| writer.all_acknowledged())
                .then_some(Ok(()))
        });
        acknowledged.unwrap_or(Err(WaitError::Unacknowledged))
    }

    /// Asserts that the writer is alive, where LIVELINESS is manual; of MANUAL_BY_PARTICIPANT all of the participant's are then.
    /// Writing does as well.
    pub fn assert_liveliness(&self) {
        self.endpoint.shared().with(|core, now| {
            if let Some(writer) = core.endpoints.writer_mut(self.endpoint.id()) {
                writer.assert_liveliness(now);
            }
        });
    }

    /// Its policies, with those of its publisher.
    pub fn qos(&self) -> Qos {
        self.endpoint.qos()
    }

    /// Changes its policies, and has others learn of it.
    ///
    /// # Errors
    /// When a policy is among them that may not change, or that makes no sense.
    pub fn set_qos(&self, qos: crate::qos::Qos) -> Result<(), SetQosError> {
        let inherits = qos.inherits();
        let qos = self.endpoint.set_qos(inherits, qos.into_writer())?;
        self.patience.set(&qos);
        Ok(())
    }

    /// Has others learn of the writer, where it was created not to be known yet; only then can it write.
    pub fn enable(&self) {
        self.endpoint.enable();
    }

    /// Its publisher may have enabled it.
    fn check_enabled(&self) -> bool {
        let is_enabled = self.endpoint.is_enabled();
        self.is_enabled.store(is_enabled, Ordering::Relaxed);
        is_enabled
    }

    /// What has happened since the last call, up to the newest 256 events; nothing that a listener was told.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.endpoint.status_events()
    }

    /// Has `listener` called with every event, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.set_listener_for(StatusMask::ALL, listener);
    }

    /// Has `listener` called with the events that `mask` holds; others go to the listeners of publisher and
    /// participant.
    pub fn set_listener_for(
        &self,
        mask: StatusMask,
        listener: impl Fn(StatusEvent) + Send + Sync + 'static,
    ) {
        self.endpoint.set_listener(mask, Arc::new(listener));
    }

    /// A condition of the writer.
    pub(crate) fn watch(&self, trigger: Trigger) -> Watched {
        self.endpoint.watch(trigger)
    }

    /// The statuses that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        self.endpoint.status_changes()
    }

    /// PUBLICATION_MATCHED.
    pub fn publication_matched_status(&self) -> MatchedStatus {
        self.endpoint
            .status(|statuses| statuses.matched(StatusKind::PublicationMatched))
    }

    /// OFFERED_INCOMPATIBLE_QOS.
    pub fn offered_incompatible_qos_status(&self) -> IncompatibleQosStatus {
        self.endpoint
            .status(|statuses| statuses.incompatible(StatusKind::OfferedIncompatibleQos))
    }

    /// OFFERED_DEADLINE_MISSED.
    pub fn offered_deadline_missed_status(&self) -> DeadlineMissedStatus {
        self.endpoint
            .status(|statuses| statuses.deadline(StatusKind::OfferedDeadlineMissed))
    }

    /// LIVELINESS_LOST.
    pub fn liveliness_lost_status(&self) -> LivelinessLostStatus {
        self.endpoint.status(Statuses::liveliness_lost)
    }

    /// INCONSISTENT_TOPIC, as far as this writer is concerned.
    pub fn inconsistent_topic_status(&self) -> InconsistentTopicStatus {
        self.endpoint.status(Statuses::inconsistent)
    }
}

fn stamped(change: RawChange, now: impl FnOnce() -> SystemTime) -> NewChange {
    NewChange {
        kind: change.kind,
        instance: change.instance,
        payload: change.payload,
        timestamp: to_timestamp(change.timestamp.unwrap_or_else(now)),
    }
}

/// Times before 1970 count as 1970.
pub(super) fn to_timestamp(time: SystemTime) -> Timestamp {
    let since_epoch = time.duration_since(SystemTime::UNIX_EPOCH);
    Timestamp::from_unix(since_epoch.unwrap_or_default())
}
