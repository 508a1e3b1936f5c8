//! DataReader (DDS 1.4 section 2.2.2.5.3).

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use futures_core::Stream;
use rtps_user::wire::Guid;

use super::EndpointBuiltinTopicData;
use super::Sample;
use super::access::{Form, instance_of_payload};
use super::content_filtered_topic::Filter;
use super::keys::Keys;
use crate::cdr::DdsType;
use crate::error::{CreateError, SetQosError, WaitError};
use crate::qos::{Qos, policies};
use crate::socket::{FilterSetter, RawReader, RtpsSocket, Template};

/// A reader of samples of type `T`. Dropped, it is withdrawn.
pub struct DataReader<T> {
    pub(super) reader: RawReader,
    pub(super) keys: Keys,
    /// Where it belongs to a filtered topic: what its filter is changed with, as long as the reader is there.
    _filtered: Option<Arc<FilterSetter>>,
    sample: std::marker::PhantomData<fn() -> T>,
}

impl<T: DdsType> DataReader<T> {
    pub(super) fn new(
        socket: &RtpsSocket,
        mut template: Template,
        filter: Option<&Filter>,
    ) -> Result<Self, CreateError> {
        template.describe::<T>();
        if let Some(filter) = filter {
            let (announced, payloads) = filter.current();
            template.content_filter = Some(announced);
            template.payload_filter = Some(payloads);
        }
        let instance_of = T::HAS_KEY.then(instance_of_payload::<T>);
        let reader = socket.create_reader_of(template, instance_of)?;
        let filtered = filter.map(|filter| {
            let setter = Arc::new(reader.filter_setter());
            filter.follow(&setter).map(|()| setter)
        });
        let filtered = filtered.transpose()?;
        Ok(Self {
            reader,
            keys: Keys::default(),
            _filtered: filtered,
            sample: std::marker::PhantomData,
        })
    }

    /// Takes the next sample, waiting for it up to `timeout`; `None` when none has come. A wait without end ends where the
    /// layer is lost, of which [`StatusEvent::LayerLost`] tells.
    pub fn take_next(&self, timeout: Duration) -> Option<Sample<T>> {
        let mut limit = timeout.into();
        loop {
            let sample = self.reader.recv_within(&mut limit)?;
            if let Some(sample) = self.decode(sample, Form::Take) {
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
            if let Some(sample) = self.decode(sample, Form::Take) {
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

    /// What is known of a writer that it is matched with.
    pub fn matched_publication_data(&self, writer: Guid) -> Option<EndpointBuiltinTopicData> {
        self.reader.matched_publication_data(writer)
    }

    /// Waits until at least `count` writers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.reader.wait_for_matched(count, timeout)
    }

    /// Waits until everything has come that writers matched now keep for readers that come late: of TRANSIENT_LOCAL and
    /// up. Of writers that are still to be matched it knows nothing: see [`wait_for_matched`](Self::wait_for_matched).
    ///
    /// # Errors
    /// When it has not before `timeout`.
    pub fn wait_for_historical_data(&self, timeout: Duration) -> Result<(), WaitError> {
        self.reader.wait_for_historical_data(timeout)
    }

    /// Its policies, with those of its subscriber.
    pub fn qos(&self) -> policies::Qos {
        self.reader.qos()
    }

    /// Changes its policies, and has others learn of it: USER_DATA, DEADLINE, LATENCY_BUDGET, TIME_BASED_FILTER,
    /// READER_DATA_LIFECYCLE and, where it has no subscriber, PARTITION.
    ///
    /// # Errors
    /// When a policy is among them that may not change, or that makes no sense.
    pub fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        self.reader.set_qos(qos)
    }

    /// Has others learn of the reader, where it was created not to be known yet.
    pub fn enable(&self) {
        self.reader.enable();
    }
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
