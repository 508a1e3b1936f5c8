//! What writers and readers have in common: matches and statuses.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rtps_user::wire::{EntityId, Guid};

use super::condition::{Trigger, Watched};
use super::group::Group;
use super::template::check_endpoint;
use crate::dcps::EndpointBuiltinTopicData;
use crate::driver::{Driver, Inherits, Listener, Scope, Shared};
use crate::error::{SetQosError, WaitError};
use crate::qos::{changed_for_good, policies};
use crate::status::{StatusEvent, StatusMask, Statuses};

/// An endpoint of the participant; dropped, it is withdrawn.
pub(super) struct EndpointHandle {
    driver: Arc<Driver>,
    guid: Guid,
    /// Its publisher or subscriber, which lasts as long.
    group: Option<Arc<Group>>,
}

impl EndpointHandle {
    pub(super) fn new(driver: &Arc<Driver>, guid: Guid, group: Option<Arc<Group>>) -> Self {
        Self {
            driver: Arc::clone(driver),
            guid,
            group,
        }
    }

    pub(super) fn group(&self) -> Option<&Group> {
        self.group.as_deref()
    }

    pub(super) fn shared(&self) -> &Arc<Shared> {
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
            entity.map_or_else(Vec::new, |entity| entity.matched().collect())
        })
    }

    pub(super) fn matched_endpoint(&self, remote: Guid) -> Option<EndpointBuiltinTopicData> {
        self.shared().with(|core, _| {
            let remote = core.entity(self.id())?.matched_endpoint(remote);
            remote.map(EndpointBuiltinTopicData::from)
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

    pub(super) fn set_listener(&self, mask: StatusMask, listener: Listener) {
        let waiting = self
            .shared()
            .with(|core, _| core.set_listener(self.id(), mask, Arc::clone(&listener)));
        waiting.into_iter().for_each(|event| listener(event));
    }

    pub(super) fn watch(&self, trigger: Trigger) -> Watched {
        Watched::new(self.shared(), Scope::Endpoint(self.id()), trigger)
    }

    /// The statuses that have changed since they were last asked for.
    pub(super) fn status_changes(&self) -> StatusMask {
        let scope = Scope::Endpoint(self.id());
        self.shared().poll(|core, _| core.status_changes(scope))
    }

    /// Asks for a status, after taking in what has arrived.
    pub(super) fn status<R: Default>(&self, ask: impl FnOnce(&mut Statuses) -> R) -> R {
        self.shared().poll(|core, _| {
            let entity = core.entity_mut(self.id());
            entity.map_or_else(R::default, |entity| ask(&mut entity.statuses))
        })
    }

    /// Changes the policies to those that `qos` says, and to the publisher's or subscriber's where it says nothing.
    pub(super) fn set_qos(
        &self,
        inherits: Inherits,
        mut qos: policies::Qos,
    ) -> Result<policies::Qos, SetQosError> {
        self.shared().with(|core, now| {
            let Some(entity) = core.entity(self.id()) else {
                return Ok(qos);
            };
            let declaration = entity.declaration();
            let before = &declaration.endpoint.qos;
            if declaration.group.is_some() {
                inherits.apply(&mut qos, before);
                qos.presentation = before.presentation;
            }
            if let Some(policy) = changed_for_good(before, &qos) {
                return Err(SetQosError::Immutable(policy));
            }
            let mut endpoint = declaration.endpoint.clone();
            endpoint.qos.clone_from(&qos);
            check_endpoint(endpoint)?;
            core.change_qos(now, self.id(), qos.clone());
            Ok(qos)
        })
    }

    /// The policies, with those of the publisher or subscriber.
    pub(super) fn qos(&self) -> policies::Qos {
        self.shared().with(|core, _| {
            let entity = core.entity(self.id());
            entity.map_or_else(policies::Qos::default, |entity| {
                entity.declaration().endpoint.qos.clone()
            })
        })
    }

    pub(super) fn enable(&self) {
        self.shared().with(|core, now| core.enable(now, self.id()));
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.shared().with(|core, _| {
            let entity = core.entity(self.id());
            entity.is_some_and(|entity| entity.declaration().is_enabled)
        })
    }
}

impl Drop for EndpointHandle {
    fn drop(&mut self) {
        self.shared()
            .with(|core, now| core.withdraw(now, self.id()));
        if let Some(group) = self.group.as_deref().filter(|_| self.id().is_writer()) {
            group.refresh_writers();
        }
    }
}

/// When a timeout is over; `None`, never, where the clock has no such time.
pub(super) fn deadline(timeout: Duration) -> Option<Instant> {
    Instant::now().checked_add(timeout)
}
