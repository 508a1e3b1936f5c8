//! Who is told what happens to an endpoint that has no listener for it: its publisher or subscriber, then the
//! participant (DDS 1.4 section 2.2.4.2.1).

use std::collections::HashMap;
use std::sync::Arc;
use std::task::Waker;

use rtps_user::wire::EntityId;

use super::entity::Notice;
use super::topics::{TopicId, TopicListener, Topics};
use crate::status::{EntityEvent, StatusEvent, StatusKind, StatusMask};

/// Called with each event of an endpoint.
pub(crate) type Listener = Arc<dyn Fn(StatusEvent) + Send + Sync>;

/// Called with events of endpoints that have no listener for them.
pub(crate) type EntityListener = Arc<dyn Fn(EntityEvent) + Send + Sync>;

/// Names a publisher or subscriber within its participant.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub(crate) struct GroupId(u32);

/// A listener and what it listens to.
pub(super) struct Masked<L> {
    pub(super) mask: StatusMask,
    pub(super) listener: L,
}

/// A publisher or subscriber (the Group of RTPS 2.5 section 8.2.4).
#[derive(Default)]
pub(crate) struct Group {
    members: Vec<EntityId>,
    listener: Option<Masked<EntityListener>>,
}

/// See the module.
#[derive(Default)]
pub(crate) struct Audience {
    groups: HashMap<GroupId, Group>,
    last_group: u32,
    participant: Option<Masked<EntityListener>>,
    hears_data: bool,
    /// The topics of the app.
    pub(crate) topics: Topics,
    /// Tasks that wait for something to happen to any endpoint or topic.
    wakers: Vec<Waker>,
    /// What is to be called once the lock is free.
    pub(super) notices: Vec<Notice>,
}

impl Audience {
    /// A new publisher or subscriber.
    pub(crate) fn add_group(&mut self) -> GroupId {
        self.last_group = self.last_group.wrapping_add(1);
        let id = GroupId(self.last_group);
        self.groups.insert(id, Group::default());
        id
    }

    /// A publisher or subscriber is gone, with all its endpoints.
    pub(crate) fn remove_group(&mut self, id: GroupId) {
        if let Some(group) = self.groups.remove(&id) {
            self.replaced(group.listener);
        }
    }

    /// An endpoint has come.
    pub(super) fn join(&mut self, group: Option<GroupId>, member: EntityId) {
        if let Some(group) = self.group_mut(group) {
            group.members.push(member);
        }
    }

    /// An endpoint has gone.
    pub(super) fn leave(&mut self, group: Option<GroupId>, member: EntityId) {
        if let Some(group) = self.group_mut(group) {
            group.members.retain(|known| *known != member);
        }
    }

    /// The endpoints of a publisher or subscriber.
    pub(crate) fn members(&self, group: GroupId) -> &[EntityId] {
        let group = self.groups.get(&group);
        group.map_or(&[], |group| &group.members)
    }

    /// Has `listener` called when others use the name of a topic with another type.
    pub(crate) fn set_topic_listener(&mut self, id: TopicId, listener: TopicListener) {
        let replaced = self.topics.set_listener(id, listener);
        self.notices.extend(replaced.map(Notice::ReplacedTopic));
    }

    /// A topic is gone.
    pub(crate) fn remove_topic(&mut self, id: TopicId) {
        let listener = self.topics.remove(id);
        self.notices.extend(listener.map(Notice::ReplacedTopic));
    }

    /// Tells the listeners of a topic; false where there is none.
    pub(super) fn tell_topic(&mut self, name: &str) -> bool {
        self.topics.tell(name, &mut self.notices)
    }

    /// Wakes a task when the next thing happens to any endpoint or topic.
    pub(super) fn wake_later(&mut self, waker: &Waker) {
        if !self.wakers.iter().any(|known| known.will_wake(waker)) {
            self.wakers.push(waker.clone());
        }
    }

    /// Forgets a task that no longer waits.
    pub(super) fn wake_no_more(&mut self, waker: &Waker) {
        self.wakers.retain(|known| !known.will_wake(waker));
    }

    /// Something has happened.
    pub(super) fn wake(&mut self) {
        self.notices.extend(self.wakers.drain(..).map(Notice::Wake));
    }

    /// Has a publisher or subscriber, or the participant where there is no `group`, hear what `mask` holds.
    pub(super) fn set_listener(
        &mut self,
        group: Option<GroupId>,
        mask: StatusMask,
        listener: EntityListener,
    ) {
        self.note_mask(mask);
        let masked = Some(Masked { mask, listener });
        let replaced = match group {
            None => std::mem::replace(&mut self.participant, masked),
            Some(_) => match self.group_mut(group) {
                Some(group) => std::mem::replace(&mut group.listener, masked),
                None => masked,
            },
        };
        self.replaced(replaced);
    }

    /// Somebody listens to that.
    pub(super) fn note_mask(&mut self, mask: StatusMask) {
        self.hears_data |=
            mask.contains(StatusKind::DataAvailable) || mask.contains(StatusKind::DataOnReaders);
    }

    /// Whether anybody has asked to be told of each arrival of data.
    pub(super) fn hears_data(&self) -> bool {
        self.hears_data
    }

    /// Tells a publisher or subscriber, else the participant; false when neither listens to that.
    pub(super) fn tell(
        &mut self,
        group: Option<GroupId>,
        kind: StatusKind,
        event: impl FnOnce() -> EntityEvent,
    ) -> bool {
        let group = group.and_then(|group| self.groups.get(&group)?.listener.as_ref());
        let listeners = [group, self.participant.as_ref()];
        let mut listeners = listeners.into_iter().flatten();
        let Some(masked) = listeners.find(|masked| masked.mask.contains(kind)) else {
            return false;
        };
        let listener = Arc::clone(&masked.listener);
        self.notices
            .push(Notice::Entity(listener, Box::new(event())));
        true
    }

    fn group_mut(&mut self, group: Option<GroupId>) -> Option<&mut Group> {
        self.groups.get_mut(&group?)
    }

    fn replaced(&mut self, listener: Option<Masked<EntityListener>>) {
        let replaced = listener.map(|masked| Notice::ReplacedEntity(masked.listener));
        self.notices.extend(replaced);
    }
}
