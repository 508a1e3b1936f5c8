//! What the writers of a publisher, or the readers of a subscriber, have in common.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Instant;

use rtps_user::wire::EntityId;

use super::template::check_endpoint;
use crate::driver::{Core, Driver, EntityListener, GroupId};
use crate::error::{SetQosError, WaitError};
use crate::qos::policies;
use crate::status::StatusMask;

/// A publisher or subscriber: there as long as its handle or one of its endpoints.
pub(crate) struct Group {
    driver: Arc<Driver>,
    id: GroupId,
    is_suspended: AtomicBool,
    /// How deep coherent sets, or accesses, are nested.
    depth: AtomicU32,
}

impl Group {
    pub(super) fn new(driver: &Arc<Driver>) -> Self {
        let id = driver.shared().with(|core, _| core.audience.add_group());
        Self {
            driver: Arc::clone(driver),
            id,
            is_suspended: AtomicBool::new(false),
            depth: AtomicU32::new(0),
        }
    }

    pub(super) fn id(&self) -> GroupId {
        self.id
    }

    /// Has `listener` hear the events of `mask` of endpoints that have no listener for them.
    pub(crate) fn set_listener(&self, mask: StatusMask, listener: EntityListener) {
        self.driver
            .shared()
            .with(|core, _| core.set_entity_listener(Some(self.id), mask, listener));
    }

    /// Makes the endpoints known that are not yet.
    pub(crate) fn enable(&self) {
        self.for_each(|core, now, member| core.enable(now, member));
    }

    /// Changes the policies of the endpoints that have them from here.
    pub(crate) fn set_qos(&self, group: &policies::Qos) -> Result<(), SetQosError> {
        self.driver.shared().with(|core, now| {
            let mut changes = Vec::new();
            for member in core.audience.members(self.id) {
                let Some(entity) = core.entity(*member) else {
                    continue;
                };
                let declaration = entity.declaration();
                let mut endpoint = declaration.endpoint.clone();
                declaration.inherits.apply(&mut endpoint.qos, group);
                if endpoint != declaration.endpoint {
                    check_endpoint(endpoint.clone())?;
                    changes.push((*member, endpoint.qos));
                }
            }
            for (member, qos) in changes {
                core.change_qos(now, member, qos);
            }
            Ok(())
        })
    }

    /// Whether what is written may wait for more.
    pub(super) fn is_suspended(&self) -> bool {
        self.is_suspended.load(Ordering::Relaxed)
    }

    /// Says whether what is written may wait for more; if not, what waits is sent.
    pub(crate) fn suspend(&self, is_suspended: bool) {
        self.is_suspended.store(is_suspended, Ordering::Relaxed);
        self.driver.shared().with(|_, _| ());
    }

    /// What the writers write from now on is one coherent set.
    pub(crate) fn begin_coherent_changes(&self) {
        self.depth.fetch_add(1, Ordering::Relaxed);
    }

    /// Ends the coherent set, if one is open.
    pub(crate) fn end_coherent_changes(&self) {
        self.leave();
    }

    /// Freezes what the readers show.
    pub(crate) fn begin_access(&self) {
        self.depth.fetch_add(1, Ordering::Relaxed);
    }

    /// Lets the readers show what has come.
    pub(crate) fn end_access(&self) {
        self.leave();
    }

    /// Whether it was the outermost that is left.
    fn leave(&self) -> bool {
        let depth = self
            .depth
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |depth| {
                depth.checked_sub(1)
            });
        depth == Ok(1)
    }

    /// Waits until every reliable reader has everything that the writers have written.
    pub(crate) fn wait_for_acknowledgments(
        &self,
        deadline: Option<Instant>,
    ) -> Result<(), WaitError> {
        let acknowledged = self.driver.shared().wait_until(deadline, |core, _| {
            if core.is_lost() {
                return Some(Err(WaitError::LayerLost));
            }
            let mut writers = core
                .audience
                .members(self.id)
                .iter()
                .filter_map(|member| core.endpoints.writer(*member));
            writers
                .all(|writer| writer.all_acknowledged())
                .then_some(Ok(()))
        });
        acknowledged.unwrap_or(Err(WaitError::Unacknowledged))
    }

    /// Does something with each endpoint.
    fn for_each(&self, mut act: impl FnMut(&mut Core, Instant, EntityId)) {
        self.driver.shared().with(|core, now| {
            for member in core.audience.members(self.id).to_vec() {
                act(core, now, member);
            }
        });
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.driver
            .shared()
            .with(|core, _| core.audience.remove_group(self.id));
    }
}
