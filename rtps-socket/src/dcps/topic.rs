//! Topic (DDS 1.4 section 2.2.2.3.2).

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use super::StatusCondition;
use crate::cdr::DdsType;
use crate::driver::{Scope, Shared, TopicId};
use crate::error::CreateError;
use crate::qos::Qos;
use crate::socket::{RtpsSocket, Trigger, Watched};
use crate::status::{InconsistentTopicStatus, StatusMask};

/// A name under which samples of one type are exchanged, with policies that its endpoints may take over. Clones are the same
/// topic.
///
/// It does not keep its participant in the domain.
pub struct Topic<T> {
    state: Arc<TopicState>,
    sample: PhantomData<fn() -> T>,
}

/// What clones have in common.
struct TopicState {
    shared: Arc<Shared>,
    id: TopicId,
    name: String,
    qos: Qos,
}

impl Drop for TopicState {
    fn drop(&mut self) {
        self.shared
            .with(|core, _| core.audience.remove_topic(self.id));
    }
}

impl<T> Clone for Topic<T> {
    fn clone(&self) -> Self {
        Self {
            state: Arc::clone(&self.state),
            sample: PhantomData,
        }
    }
}

impl<T> fmt::Debug for Topic<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Topic")
            .field("name", &self.state.name)
            .field("qos", &self.state.qos)
            .finish_non_exhaustive()
    }
}

impl<T: DdsType> Topic<T> {
    pub(super) fn new(socket: &RtpsSocket, name: &str, qos: Qos) -> Result<Self, CreateError> {
        if !Self::is_name(name) {
            return Err(CreateError::InvalidName(name.to_owned()));
        }
        qos.check().map_err(CreateError::Inconsistent)?;
        let shared = Arc::clone(socket.shared());
        let state = TopicState {
            id: shared.with(|core, _| core.audience.topics.add(name)),
            shared,
            name: name.to_owned(),
            qos,
        };
        Ok(Self {
            state: Arc::new(state),
            sample: PhantomData,
        })
    }

    /// 1 to 255 bytes without NUL.
    pub(super) fn is_name(name: &str) -> bool {
        !name.is_empty() && name.len() <= 255 && !name.contains('\0')
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.state.name
    }

    /// Its policies: what a writer or reader may be created with ([`Qos::copy_from_topic`]). Without that TOPIC_DATA alone
    /// holds for them, where they say nothing of it.
    pub fn qos(&self) -> &Qos {
        &self.state.qos
    }

    /// The registered name of its type.
    pub fn type_name(&self) -> &'static str {
        T::TYPE_NAME
    }

    /// INCONSISTENT_TOPIC: endpoints of others that use its name with another type, once for each writer and reader here
    /// that met them.
    pub fn inconsistent_topic_status(&self) -> InconsistentTopicStatus {
        let id = self.state.id;
        self.state
            .shared
            .poll(|core, _| core.audience.topics.inconsistent(id))
    }

    /// Has `listener` called with [`inconsistent_topic_status`](Self::inconsistent_topic_status) when it changes, where the
    /// endpoint has no listener for that; by whatever thread drives.
    pub fn set_listener(&self, listener: impl Fn(InconsistentTopicStatus) + Send + Sync + 'static) {
        let (id, listener) = (self.state.id, Arc::new(listener));
        self.state
            .shared
            .with(|core, _| core.audience.set_topic_listener(id, listener));
    }

    /// A condition that is true while INCONSISTENT_TOPIC has changed since it was last asked for, if `statuses` holds it.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        let scope = Scope::Topic(self.state.id);
        let watched = Watched::new(&self.state.shared, scope, Trigger::on(statuses));
        StatusCondition::new(watched)
    }

    /// The statuses that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        let scope = Scope::Topic(self.state.id);
        self.state.shared.poll(|core, _| core.status_changes(scope))
    }
}
