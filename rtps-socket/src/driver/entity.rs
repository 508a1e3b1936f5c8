//! What the driver knows of a writer or reader beside its protocol state.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::task::Waker;

use rtps_user::wire::{EntityId, Guid};

use crate::status::StatusEvent;

/// Called with each status event.
pub(crate) type Listener = Arc<dyn Fn(StatusEvent) + Send + Sync>;

/// Status events kept for who asks; older ones give way.
const KEPT_EVENTS: usize = 256;

/// See the module.
pub(crate) struct Entity {
    /// The topic's name, for the log.
    pub(crate) topic: String,
    id: EntityId,
    matched: HashSet<Guid>,
    total_matched: u64,
    events: VecDeque<StatusEvent>,
    listener: Option<Listener>,
    wakers: Vec<Waker>,
}

/// What is to be called once the lock is free.
pub(super) enum Notice {
    Status(Listener, StatusEvent),
    Wake(Waker),
    /// An endpoint is gone. What its listener owns may be other endpoints, which take the lock when they go.
    Gone(Box<Entity>),
    /// A listener was replaced: the same.
    Replaced(Listener),
}

impl Notice {
    pub(super) fn deliver(self) {
        match self {
            Self::Status(listener, event) => listener(event),
            Self::Wake(waker) => waker.wake(),
            Self::Gone(entity) => drop(entity),
            Self::Replaced(listener) => drop(listener),
        }
    }
}

impl Entity {
    pub(crate) fn new(id: EntityId, topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            id,
            matched: HashSet::new(),
            total_matched: 0,
            events: VecDeque::new(),
            listener: None,
            wakers: Vec::new(),
        }
    }

    /// Remote endpoints that are matched now.
    pub(crate) fn matched(&self) -> &HashSet<Guid> {
        &self.matched
    }

    /// Events since the last call.
    pub(crate) fn take_events(&mut self) -> Vec<StatusEvent> {
        self.events.drain(..).collect()
    }

    /// Calls `listener` with all further events, and first with those that wait.
    pub(super) fn set_listener(
        &mut self,
        listener: Listener,
        notices: &mut Vec<Notice>,
    ) -> Vec<StatusEvent> {
        let replaced = self.listener.replace(listener);
        notices.extend(replaced.map(Notice::Replaced));
        self.take_events()
    }

    /// Wakes a task when the next thing happens.
    pub(crate) fn wake_later(&mut self, waker: &Waker) {
        if !self.wakers.iter().any(|known| known.will_wake(waker)) {
            self.wakers.push(waker.clone());
        }
    }

    pub(super) fn wake(&mut self, notices: &mut Vec<Notice>) {
        notices.extend(self.wakers.drain(..).map(Notice::Wake));
    }

    /// A match, new or changed.
    pub(super) fn add_match(&mut self, remote: Guid, notices: &mut Vec<Notice>) {
        if self.matched.insert(remote) {
            self.total_matched += 1;
            self.report(self.matched_event(remote, 1), notices);
        }
    }

    /// The end of a match.
    pub(super) fn remove_match(&mut self, remote: Guid, notices: &mut Vec<Notice>) {
        if self.matched.remove(&remote) {
            self.report(self.matched_event(remote, -1), notices);
        }
    }

    fn matched_event(&self, remote: Guid, change: isize) -> StatusEvent {
        let (current, total) = (self.matched.len(), self.total_matched);
        match self.id.is_writer() {
            true => StatusEvent::PublicationMatched {
                current,
                change,
                total,
                reader: remote,
            },
            false => StatusEvent::SubscriptionMatched {
                current,
                change,
                total,
                writer: remote,
            },
        }
    }

    /// Hands an event to whom it may concern.
    pub(super) fn report(&mut self, event: StatusEvent, notices: &mut Vec<Notice>) {
        self.wake(notices);
        if let Some(listener) = &self.listener {
            notices.push(Notice::Status(Arc::clone(listener), event));
            return;
        }
        if self.events.len() == KEPT_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}

#[cfg(test)]
mod tests {
    use rtps_user::wire::{EntityKind, GuidPrefix};

    use super::*;

    fn writer() -> Entity {
        Entity::new(EntityId::of_app(1, 1, EntityKind::WriterNoKey), "Square")
    }

    #[test]
    fn a_match_counts_once() {
        let (mut entity, mut notices) = (writer(), Vec::new());
        let remote = Guid::new(
            GuidPrefix([7; 12]),
            EntityId::of_app(1, 1, EntityKind::ReaderNoKey),
        );
        entity.add_match(remote, &mut notices);
        entity.add_match(remote, &mut notices);
        entity.remove_match(remote, &mut notices);
        entity.remove_match(remote, &mut notices);
        let changes: Vec<_> = entity
            .take_events()
            .into_iter()
            .map(|event| match event {
                StatusEvent::PublicationMatched {
                    current,
                    change,
                    total,
                    ..
                } => (current, change, total),
                other => panic!("unexpected {other:?}"),
            })
            .collect();
        assert_eq!(changes, [(1, 1, 1), (0, -1, 1)]);
        assert!(notices.is_empty());
    }

    #[test]
    fn events_that_nobody_takes_are_bounded() {
        let (mut entity, mut notices) = (writer(), Vec::new());
        for _ in 0..3 * KEPT_EVENTS {
            entity.report(StatusEvent::LivelinessLost, &mut notices);
        }
        assert_eq!(entity.take_events().len(), KEPT_EVENTS);
    }
}
