//! What the writers of a publisher, or the readers of a subscriber, have in common.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rtps_user::qos::{Presentation, PresentationScope};
use rtps_user::reader::{Reader, Selection};
use rtps_user::wire::{EntityId, Guid};
use rtps_user::writer;

use super::condition::{Trigger, Watched};
use super::group_order::in_order;
use super::raw_writer::to_timestamp;
use super::template::check_endpoint;
use crate::driver::{Core, Driver, EntityListener, GroupId, Scope};
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
    /// What the writers number their changes by, where PRESENTATION has GROUP scope. Locked after the core.
    sequence: Option<Mutex<writer::Group>>,
}

impl Group {
    pub(super) fn new(driver: &Arc<Driver>, presentation: Presentation) -> Self {
        let is_used = presentation.coherent || presentation.ordered;
        let is_numbered = is_used && presentation.scope == PresentationScope::Group;
        let id = driver.shared().with(|core, _| core.audience.add_group());
        Self {
            driver: Arc::clone(driver),
            id,
            is_suspended: AtomicBool::new(false),
            depth: AtomicU32::new(0),
            sequence: is_numbered.then(Mutex::default),
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

    /// A condition of the endpoints.
    pub(crate) fn watch(&self, trigger: Trigger) -> Watched {
        Watched::new(self.driver.shared(), Scope::Group(self.id), trigger)
    }

    /// The statuses of the endpoints that have changed since they were last asked for.
    pub(crate) fn status_changes(&self) -> StatusMask {
        let scope = Scope::Group(self.id);
        self.driver
            .shared()
            .poll(|core, _| core.status_changes(scope))
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

    /// What the writers number their changes by, if by anything in common.
    pub(super) fn sequence(&self) -> Option<MutexGuard<'_, writer::Group>> {
        let sequence = self.sequence.as_ref()?;
        Some(sequence.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// A writer has come or gone.
    pub(super) fn refresh_writers(&self) {
        self.driver.shared().with(|core, _| {
            let members = core.audience.members(self.id).to_vec();
            if let Some(mut sequence) = self.sequence() {
                sequence.set_writers(members.iter().copied());
            }
            if self.depth.load(Ordering::Relaxed) > 0 {
                begin_coherent(core, &members);
            }
        });
    }

    /// What the writers write from now on is one coherent set.
    pub(crate) fn begin_coherent_changes(&self) {
        self.driver.shared().with(|core, _| {
            if self.depth.fetch_add(1, Ordering::Relaxed) > 0 {
                return;
            }
            if let Some(mut sequence) = self.sequence() {
                sequence.begin_set();
            }
            let members = core.audience.members(self.id).to_vec();
            begin_coherent(core, &members);
        });
    }

    /// Ends the coherent set, if one is open.
    pub(crate) fn end_coherent_changes(&self) {
        self.driver.shared().with(|core, now| {
            if !self.leave() {
                return;
            }
            let timestamp = to_timestamp(core.wall_time(now));
            let mut sequence = self.sequence();
            for member in core.audience.members(self.id).to_vec() {
                let Some(writer) = core.endpoints.writer_mut(member) else {
                    continue;
                };
                match sequence.as_deref() {
                    Some(group) => writer.end_coherent_in(group, timestamp),
                    None => writer.end_coherent(timestamp),
                };
            }
            if let Some(sequence) = &mut sequence {
                sequence.end_set();
            }
        });
    }

    /// Freezes what the readers show.
    pub(crate) fn begin_access(&self) {
        self.driver.shared().poll(|core, _| {
            if self.depth.fetch_add(1, Ordering::Relaxed) == 0 {
                core.release_groups(self.id);
                self.for_each_reader(core, Reader::freeze);
            }
        });
    }

    /// A reader has come: while the readers are frozen it shows nothing either.
    pub(super) fn welcome_reader(&self, core: &mut Core, reader: EntityId) {
        if self.depth.load(Ordering::Relaxed) > 0 {
            core.endpoints.reader_mut(reader).map(Reader::freeze);
        }
    }

    /// Lets the readers show what has come.
    pub(crate) fn end_access(&self) {
        self.driver.shared().with(|core, _| {
            if self.leave() {
                self.for_each_reader(core, Reader::thaw);
            }
        });
    }

    /// The readers that have samples that have not been read, one entry for each, in the order of writing.
    pub(crate) fn readers_in_order(&self) -> Vec<Guid> {
        let samples = self.driver.shared().with(|core, _| {
            let members = core.audience.members(self.id).iter();
            let readers = members.filter_map(|member| core.endpoints.reader(*member));
            let not_read = Selection::not_read();
            let mut samples = Vec::new();
            for reader in readers {
                let infos = reader.infos(&not_read);
                samples.extend(infos.map(|info| (reader.guid(), info)));
            }
            samples
        });
        in_order(samples)
    }

    fn for_each_reader(&self, core: &mut Core, act: impl Fn(&mut Reader)) {
        for member in core.audience.members(self.id).to_vec() {
            core.endpoints.reader_mut(member).map(&act);
        }
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

/// What is written is part of a set; where a writer has one open already, of that.
fn begin_coherent(core: &mut Core, members: &[EntityId]) {
    for member in members {
        if let Some(writer) = core.endpoints.writer_mut(*member) {
            writer.begin_coherent();
        }
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.driver
            .shared()
            .with(|core, _| core.audience.remove_group(self.id));
    }
}
