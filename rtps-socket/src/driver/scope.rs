//! Whose statuses are asked for, and waited for: an endpoint's, those of several, or a topic's (Entity, DDS 1.4 section
//! 2.2.2.1.1).

use std::task::Waker;

use rtps_user::wire::EntityId;

use super::audience::GroupId;
use super::core::Core;
use super::seat::Holder;
use super::topics::TopicId;
use crate::status::{StatusKind, StatusMask};

/// An entity.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Scope {
    Endpoint(EntityId),
    /// A publisher or subscriber, with its endpoints.
    Group(GroupId),
    Topic(TopicId),
    /// With all endpoints.
    Participant,
}

impl Core {
    /// The statuses that have changed since they were last asked for, or told to a listener. DATA_AVAILABLE is one as long
    /// as there is a sample that has not been read; then DATA_ON_READERS is one of the subscriber.
    pub(crate) fn status_changes(&self, scope: Scope) -> StatusMask {
        match scope {
            Scope::Endpoint(id) => self.changes_of(id),
            Scope::Topic(id) => self.audience.topics.changed(id),
            Scope::Group(id) => self.changes_of_all(self.audience.members(id).iter()),
            Scope::Participant => self.changes_of_all(self.entities.keys()),
        }
    }

    fn changes_of(&self, id: EntityId) -> StatusMask {
        let entity = self.entity(id);
        let mut changed = entity.map_or(StatusMask::NONE, |entity| entity.statuses.changed());
        let reader = self.endpoints.reader(id);
        if reader.is_some_and(|reader| reader.has_data()) {
            changed.insert(StatusKind::DataAvailable);
        }
        changed
    }

    fn changes_of_all<'a>(&self, ids: impl Iterator<Item = &'a EntityId>) -> StatusMask {
        let changes = ids.map(|id| self.changes_of(*id));
        let mut changed = changes.fold(StatusMask::NONE, StatusMask::union);
        if changed.contains(StatusKind::DataAvailable) {
            changed.insert(StatusKind::DataOnReaders);
        }
        changed
    }

    /// A task no longer waits for something to happen to an entity.
    pub(crate) fn wake_no_more(&mut self, scope: Scope, waker: &Waker) {
        match scope {
            Scope::Endpoint(id) => {
                if let Some(entity) = self.entities.get_mut(&id) {
                    entity.wake_no_more(waker);
                }
            }
            _ => self.audience.wake_no_more(waker),
        }
    }

    /// Wakes a task when something happens to an entity, which somebody has to notice.
    pub(crate) fn wake_later(&mut self, scope: Scope, waker: &Waker) {
        match scope {
            Scope::Endpoint(id) => match self.entities.get_mut(&id) {
                Some(entity) => entity.wake_later(waker),
                None => return,
            },
            _ => self.audience.wake_later(waker),
        }
        self.seat.is_wanted = !self.seat.is_external && self.seat.holder == Holder::Nobody;
    }
}
