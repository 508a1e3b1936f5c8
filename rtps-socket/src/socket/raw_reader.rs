//! A reader of payloads that stay serialized.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use futures_core::Stream;
use rtps_user::reader::{InstanceOf, Sample, Selection};
use rtps_user::wire::Guid;

use super::endpoint::EndpointHandle;
use crate::driver::{Core, Limit};
use crate::error::WaitError;
use crate::status::StatusEvent;

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
        self.endpoint.shared().poll(|core, _| {
            let reader = core.endpoints.reader_mut(self.endpoint.id());
            reader.map_or_else(Vec::new, |reader| reader.take(max, selection))
        })
    }

    /// Reads up to `max` samples of a selection, which stay in the reader and count as read then.
    pub fn read(&self, max: usize, selection: &Selection) -> Vec<Sample> {
        self.endpoint.shared().poll(|core, _| {
            let reader = core.endpoints.reader_mut(self.endpoint.id());
            reader.map_or_else(Vec::new, |reader| reader.read(max, selection))
        })
    }

    /// Takes the next sample, waiting for it up to `timeout`. A wait without end ends where the layer is lost, of
    /// which [`StatusEvent::LayerLost`] tells.
    pub fn recv(&self, timeout: Duration) -> Option<Sample> {
        self.recv_within(&mut timeout.into())
    }

    /// As [`recv`](Self::recv), one of several waits that share a limit.
    pub(crate) fn recv_within(&self, limit: &mut Limit) -> Option<Sample> {
        let shared = self.endpoint.shared();
        shared.wait_within(limit, |core, _| self.take_one(core))
    }

    /// Waits until there is a sample that has not been read; false when `timeout` passes before.
    pub fn wait(&self, timeout: Duration) -> bool {
        let found = self.endpoint.shared().wait_until(timeout, |core, _| {
            core.endpoints
                .reader(self.endpoint.id())?
                .has_data()
                .then_some(())
        });
        found.is_some()
    }

    /// Takes the next sample, or has the task woken when there may be one.
    pub(crate) fn poll_recv(&self, context: &mut Context<'_>) -> Poll<Sample> {
        self.endpoint.shared().poll(|core, _| {
            if let Some(sample) = self.take_one(core) {
                return Poll::Ready(sample);
            }
            core.wake_later(self.endpoint.id(), context.waker());
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

    /// Waits until at least `count` writers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.endpoint.wait_for_matched(count, timeout)
    }

    /// What has happened since the last call, up to the newest 256 events; nothing where there is a listener.
    pub fn status_events(&self) -> Vec<StatusEvent> {
        self.endpoint.status_events()
    }

    /// Has `listener` called with every event, by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(StatusEvent) + Send + Sync + 'static) {
        self.endpoint.set_listener(Arc::new(listener));
    }

    /// Reports what the typed API finds out.
    pub(crate) fn report(&self, event: StatusEvent) {
        let id = self.endpoint.id();
        self.endpoint
            .shared()
            .with(|core, _| core.report(id, event));
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
