//! The topics that the app holds: what is counted and told of others that use their names with other types
//! (INCONSISTENT_TOPIC).

use std::collections::BTreeMap;
use std::sync::Arc;

use rtps_user::wire::Guid;

use super::entity::Notice;
use crate::status::{InconsistentTopicStatus, StatusEvent, StatusMask, Statuses};

/// Called when others use the name of a topic with another type.
pub(crate) type TopicListener = Arc<dyn Fn(InconsistentTopicStatus) + Send + Sync>;

/// Names a topic within its participant.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(crate) struct TopicId(u32);

/// See the module.
#[derive(Default)]
pub(crate) struct Topics {
    known: BTreeMap<TopicId, Topic>,
    last: u32,
}

struct Topic {
    name: String,
    statuses: Statuses,
    listener: Option<TopicListener>,
}

impl Topics {
    /// A new topic; there may be others of its name.
    pub(crate) fn add(&mut self, name: &str) -> TopicId {
        self.last = self.last.wrapping_add(1);
        let id = TopicId(self.last);
        let topic = Topic {
            name: name.to_owned(),
            statuses: Statuses::default(),
            listener: None,
        };
        self.known.insert(id, topic);
        id
    }

    /// A topic is gone; its listener is to be dropped.
    pub(super) fn remove(&mut self, id: TopicId) -> Option<TopicListener> {
        self.known.remove(&id)?.listener
    }

    /// Has `listener` called, in place of another, which is to be dropped.
    pub(super) fn set_listener(
        &mut self,
        id: TopicId,
        listener: TopicListener,
    ) -> Option<TopicListener> {
        match self.known.get_mut(&id) {
            Some(topic) => topic.listener.replace(listener),
            None => Some(listener),
        }
    }

    /// An endpoint of that topic has met one with another type.
    pub(super) fn note_inconsistent(&mut self, name: &str, remote: Guid) {
        for topic in self.known.values_mut().filter(|topic| topic.name == name) {
            let mut event = StatusEvent::InconsistentTopic { total: 0, remote };
            topic.statuses.note(&mut event);
        }
    }

    /// Has the listeners of the topic called; false where there is none.
    pub(super) fn tell(&mut self, name: &str, notices: &mut Vec<Notice>) -> bool {
        let before = notices.len();
        for topic in self.known.values_mut().filter(|topic| topic.name == name) {
            if let Some(listener) = &topic.listener {
                let status = topic.statuses.inconsistent();
                notices.push(Notice::Topic(Arc::clone(listener), status));
            }
        }
        notices.len() > before
    }

    /// What has changed of a topic since it was last asked for.
    pub(super) fn changed(&self, id: TopicId) -> StatusMask {
        let topic = self.known.get(&id);
        topic.map_or(StatusMask::NONE, |topic| topic.statuses.changed())
    }

    /// INCONSISTENT_TOPIC.
    pub(crate) fn inconsistent(&mut self, id: TopicId) -> InconsistentTopicStatus {
        let topic = self.known.get_mut(&id);
        topic.map_or_else(Default::default, |topic| topic.statuses.inconsistent())
    }
}
