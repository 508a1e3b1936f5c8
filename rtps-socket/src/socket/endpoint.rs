//! What writers and readers have in common: matches and statuses.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rtps_user::wire::{EntityId, Guid};

use crate::driver::{Driver, Listener, Shared};
use crate::error::WaitError;
use crate::status::StatusEvent;

/// An endpoint of the participant; dropped, it is withdrawn.
pub(super) struct EndpointHandle {
    driver: Arc<Driver>,
    guid: Guid,
}

impl EndpointHandle {
    pub(super) fn new(driver: &Arc<Driver>, guid: Guid) -> Self {
        Self {
            driver: Arc::clone(driver),
            guid,
        }
    }

    pub(super) fn shared(&self) -> &Shared {
        self.driver.shared()
    }

    pub(super) fn guid(&self) -> Guid {
        self.guid
    }

    pub(super) fn id(&self) -> EntityId {
        self.guid.entity
    }

    pub(super) fn matched(&self) -> Vec<Guid> {
        self.shared().poll(|core, _| {
            let entity = core.entity(self.id());
            entity.map_or_else(Vec::new, |entity| {
                entity.matched().iter().copied().collect()
            })
        })
    }

    pub(super) fn wait_for_matched(
        &self,
        wanted: usize,
        timeout: Duration,
    ) -> Result<(), WaitError> {
        let mut matched = 0;
        self.shared()
            .wait_until(timeout, |core, _| {
                matched = core.entity(self.id())?.matched().len();
                if matched < wanted && core.is_lost() {
                    return Some(Err(WaitError::LayerLost));
                }
                (matched >= wanted).then_some(Ok(()))
            })
            .unwrap_or(Err(WaitError::TooFewMatched { wanted, matched }))
    }

    pub(super) fn status_events(&self) -> Vec<StatusEvent> {
        self.shared().poll(|core, _| {
            let entity = core.entity_mut(self.id());
            entity.map_or_else(Vec::new, |entity| entity.take_events())
        })
    }

    pub(super) fn set_listener(&self, listener: Listener) {
        let waiting = self
            .shared()
            .with(|core, _| core.set_listener(self.id(), Arc::clone(&listener)));
        waiting.into_iter().for_each(|event| listener(event));
    }
}

impl Drop for EndpointHandle {
    fn drop(&mut self) {
        self.shared()
            .with(|core, now| core.withdraw(now, self.id()));
    }
}

/// When a timeout is over; `None`, never, where the clock has no such time.
pub(super) fn deadline(timeout: Duration) -> Option<Instant> {
    Instant::now().checked_add(timeout)
}
