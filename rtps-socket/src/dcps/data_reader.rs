//! DataReader (DDS 1.4 section 2.2.2.5.3).

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use bytes::Bytes;
use futures_core::Stream;
use rtps_user::reader::{self, InstanceOf, InstanceState, SampleInfo, Selection};
use rtps_user::wire::{Guid, KeyHash, PayloadKind};

use super::{Sample, Topic, instance_of};
use crate::cdr::{
    DdsType, DecodeError, Encapsulation, Representation, from_key_payload, from_payload,
    key_payload,
};
use crate::error::{CreateError, WaitError};
use crate::qos::Qos;
use crate::socket::{RawReader, RtpsSocket};
use crate::status::StatusEvent;

/// A reader of samples of type `T`. Dropped, it is withdrawn.
pub struct DataReader<T> {
    reader: RawReader,
    /// The keys of the instances that are alive: who disposes one may send its hash alone.
    keys: Mutex<HashMap<KeyHash, Bytes>>,
    sample: std::marker::PhantomData<fn() -> T>,
}

impl<T: DdsType> DataReader<T> {
    pub(super) fn new(
        socket: &RtpsSocket,
        topic: &Topic<T>,
        qos: Qos,
    ) -> Result<Self, CreateError> {
        let instance_of = T::HAS_KEY.then(payload_instance::<T>);
        Ok(Self {
            reader: socket.create_reader(topic.name(), T::TYPE_NAME, qos, instance_of)?,
            keys: Mutex::default(),
            sample: std::marker::PhantomData,
        })
    }

    /// Takes all samples, without waiting.
    pub fn take(&self) -> Vec<Sample<T>> {
        self.take_selection(usize::MAX, &Selection::default())
    }

    /// Takes up to `max` samples of a selection, without waiting.
    pub fn take_selection(&self, max: usize, selection: &Selection) -> Vec<Sample<T>> {
        self.decode_all(self.reader.take(max, selection))
    }

    /// Reads all samples that have not been read before; they stay in the reader.
    pub fn read(&self) -> Vec<Sample<T>> {
        self.read_selection(usize::MAX, &Selection::not_read())
    }

    /// Reads up to `max` samples of a selection, which stay in the reader and count as read then.
    pub fn read_selection(&self, max: usize, selection: &Selection) -> Vec<Sample<T>> {
        self.decode_all(self.reader.read(max, selection))
    }

    /// Takes the next sample, waiting for it up to `timeout`; `None` when none has come. A wait without end ends where the
    /// layer is lost, of which [`StatusEvent::LayerLost`] tells.
    pub fn take_next(&self, timeout: Duration) -> Option<Sample<T>> {
        let mut limit = timeout.into();
        loop {
            let sample = self.reader.recv_within(&mut limit)?;
            if let Some(sample) = self.decode(sample) {
                return Some(sample);
            }
        }
    }

    /// Waits until there is a sample that has not been read; false when `timeout` passes before.
    pub fn wait(&self, timeout: Duration) -> bool {
        self.reader.wait(timeout)
    }

    /// Takes the next sample, for `async` code with any runtime.
    pub async fn next(&self) -> Sample<T> {
        std::future::poll_fn(|context| self.poll_take(context)).await
    }

    /// Samples as they come, for `async` code with any runtime. It never ends.
    pub fn samples(&self) -> Samples<'_, T> {
        Samples { reader: self }
    }

    fn poll_take(&self, context: &mut Context<'_>) -> Poll<Sample<T>> {
        loop {
            let Poll::Ready(sample) = self.reader.poll_recv(context) else {
                return Poll::Pending;
            };
            if let Some(sample) = self.decode(sample) {
                return Poll::Ready(sample);
            }
        }
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.reader.guid()
    }

    /// The writers that it is matched with.
    pub fn matched(&self) -> Vec<Guid> {
        self.reader.matched()
    }

    /// Waits until at least `count` writers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.reader.wait_for_matched(count, timeout)
    }

    /// What has happened since the last call, up to the newest 256 events; nothing where there is a listener.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.reader.status_events()
    }

    /// Has `listener` called with every event, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.reader.set_listener(listener);
    }

    fn decode_all(&self, samples: Vec<reader::Sample>) -> Vec<Sample<T>> {
        let samples = samples.into_iter();
        samples.filter_map(|sample| self.decode(sample)).collect()
    }

    /// The typed sample; what is not of the type is reported and left out.
    fn decode(&self, sample: reader::Sample) -> Option<Sample<T>> {
        let info = sample.info;
        let decoded = match info.valid_data {
            true => from_payload(&sample.payload).map(|data| (Some(data), None)),
            false => self.decode_key(&sample).map(|key| (None, key)),
        };
        match decoded {
            Ok((data, key)) => {
                self.note_instance(&info, data.as_ref());
                Some(Sample { data, key, info })
            }
            Err(error) => {
                let writer = info.writer;
                tracing::warn!(%writer, "a sample is left out, as it is no {}: {error}", T::TYPE_NAME);
                self.reader
                    .report(StatusEvent::Undecodable { writer, error });
                None
            }
        }
    }

    fn decode_key(&self, sample: &reader::Sample) -> Result<Option<T>, DecodeError> {
        if !sample.payload.is_empty() {
            return from_key_payload(&sample.payload).map(Some);
        }
        let keys = self.keys.lock().unwrap_or_else(PoisonError::into_inner);
        let known = keys.get(&sample.info.instance);
        known.map(|key| from_key_payload(key)).transpose()
    }

    fn note_instance(&self, info: &SampleInfo, data: Option<&T>) {
        if !T::HAS_KEY {
            return;
        }
        let mut keys = self.keys.lock().unwrap_or_else(PoisonError::into_inner);
        match (info.instance_state, data) {
            (InstanceState::Alive, Some(data)) if !keys.contains_key(&info.instance) => {
                let mut key = Vec::new();
                // What was decoded can be encoded; else only the key of a later dispose is missing.
                if key_payload(data, Representation::Xcdr2, &mut key).is_ok() {
                    keys.insert(info.instance, key.into());
                }
            }
            (InstanceState::Alive, _) | (_, Some(_)) => {}
            (_, None) => drop(keys.remove(&info.instance)),
        }
    }
}

/// Finds the instance of a serialized payload.
fn payload_instance<T: DdsType>() -> InstanceOf {
    Arc::new(|kind, payload| {
        let (encapsulation, _) = Encapsulation::split(payload).ok()?;
        let value: T = match kind {
            PayloadKind::Data => from_payload(payload).ok()?,
            PayloadKind::Key => from_key_payload(payload).ok()?,
            PayloadKind::None => return None,
        };
        instance_of(&value, encapsulation.representation, &mut Vec::new()).ok()
    })
}

/// The samples of a [`DataReader`] as a stream.
pub struct Samples<'a, T> {
    reader: &'a DataReader<T>,
}

impl<T: DdsType> Stream for Samples<'_, T> {
    type Item = Sample<T>;

    fn poll_next(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Sample<T>>> {
        self.reader.poll_take(context).map(Some)
    }
}
