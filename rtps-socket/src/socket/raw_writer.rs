//! A writer of payloads that are serialized already.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use bytes::Bytes;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::qos::{Qos, Reliability};
use rtps_user::wire::{Guid, KeyHash, SequenceNumber, Timestamp};
use rtps_user::writer;

use super::endpoint::{EndpointHandle, deadline};
use crate::driver::{Core, Patience};
use crate::error::{WaitError, WriteError};
use crate::status::StatusEvent;

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
    patience: Patience,
}

impl RawWriter {
    pub(super) fn new(endpoint: EndpointHandle, qos: &Qos) -> Self {
        let max_blocking_time = match qos.reliability {
            Reliability::Reliable { max_blocking_time } => max_blocking_time.to_std(),
            Reliability::BestEffort => Some(Duration::ZERO),
        };
        Self {
            endpoint,
            max_blocking_time,
            patience: Patience::of(qos),
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

    /// Sends a change at once, from the caller's thread. While a reliable KEEP_ALL history is full it waits, up to
    /// the writer's max_blocking_time.
    ///
    /// # Errors
    /// When the history stays full, or cannot take the change at all.
    pub fn send_change(&self, change: RawChange) -> Result<SequenceNumber, WriteError> {
        if change.kind == ChangeKind::Alive && change.payload.len() < HEADER_LEN {
            return Err(WriteError::NoEncapsulation(change.payload.len()));
        }
        let (len, shared) = (change.payload.len(), self.endpoint.shared());
        let mut unsent = None;
        let written = shared.write(len, self.patience, |core, now| {
            if core.is_lost() {
                return Err(WriteError::LayerLost);
            }
            unsent = Some(stamped(change, || core.wall_time(now)));
            let written = self.write_if_there_is_room(core, now, &mut unsent);
            written.ok_or(WriteError::Closed)
        });
        match written? {
            Err(writer::WriteError::HistoryFull) => self.send_when_there_is_room(unsent),
            written => written.map_err(WriteError::Refused),
        }
    }

    fn send_when_there_is_room(
        &self,
        mut change: Option<NewChange>,
    ) -> Result<SequenceNumber, WriteError> {
        let deadline = self.max_blocking_time.and_then(deadline);
        let written = self.endpoint.shared().wait_until(deadline, |core, now| {
            match self.write_if_there_is_room(core, now, &mut change)? {
                Err(writer::WriteError::HistoryFull) => None,
                written => Some(written),
            }
        });
        written
            .ok_or(WriteError::Timeout)?
            .map_err(WriteError::Refused)
    }

    /// Takes the change where the history has room for it; `None` where there is no writer any more.
    fn write_if_there_is_room(
        &self,
        core: &mut Core,
        now: Instant,
        change: &mut Option<NewChange>,
    ) -> Option<Result<SequenceNumber, writer::WriteError>> {
        let writer = core.endpoints.writer_mut(self.endpoint.id())?;
        if let Err(error) = writer.make_room(change.as_ref()?) {
            return Some(Err(error));
        }
        Some(writer.write(now, change.take()?))
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.endpoint.guid()
    }

    /// The readers that it is matched with.
    pub fn matched(&self) -> Vec<Guid> {
        self.endpoint.matched()
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

    /// Asserts that the writer is alive, where LIVELINESS is MANUAL_BY_TOPIC.
    pub fn assert_liveliness(&self) {
        self.endpoint.shared().with(|core, now| {
            if let Some(writer) = core.endpoints.writer_mut(self.endpoint.id()) {
                writer.assert_liveliness(now);
            }
        });
    }

    /// What has happened since the last call, up to the newest 256 events; nothing where there is a listener.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.endpoint.status_events()
    }

    /// Has `listener` called with every event, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.endpoint.set_listener(Arc::new(listener));
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
fn to_timestamp(time: SystemTime) -> Timestamp {
    let since_epoch = time.duration_since(SystemTime::UNIX_EPOCH);
    Timestamp::from_unix(since_epoch.unwrap_or_default())
}
