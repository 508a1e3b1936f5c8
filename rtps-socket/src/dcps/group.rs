//! What publishers and subscribers have in common: policies, defaults for their endpoints, and when those are enabled.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Topic;
use crate::cdr::DdsType;
use crate::error::SetQosError;
use crate::qos::{PolicyId, Qos, policies};
use crate::socket::{Group, RtpsSocket, Template};

/// See the module.
pub(super) struct GroupState {
    pub(super) socket: RtpsSocket,
    pub(super) group: Arc<Group>,
    policies: Mutex<Policies>,
}

struct Policies {
    qos: Qos,
    default_endpoint_qos: Qos,
    is_enabled: bool,
}

impl GroupState {
    pub(super) fn new(socket: RtpsSocket, qos: Qos, is_enabled: bool) -> Self {
        Self {
            group: socket.create_group(qos.presentation_policy()),
            socket,
            policies: Mutex::new(Policies {
                qos,
                default_endpoint_qos: Qos::default(),
                is_enabled,
            }),
        }
    }

    /// What an endpoint of the group is created from.
    pub(super) fn template<T: DdsType>(
        &self,
        topic: &Topic<T>,
        qos: Qos,
        into_policies: impl FnOnce(Qos) -> policies::Qos,
    ) -> Template {
        let policies = self.lock();
        let inherits = qos.inherits();
        let qos = into_policies(qos.on_topic(topic.qos()).in_group(&policies.qos));
        Template {
            group: Some(Arc::clone(&self.group)),
            inherits,
            is_enabled: policies.is_enabled && policies.qos.autoenables(),
            ..Template::new(topic.name(), T::TYPE_NAME, qos)
        }
    }

    pub(super) fn qos(&self) -> Qos {
        self.lock().qos.clone()
    }

    pub(super) fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        let mut policies = self.lock();
        if qos.presentation_policy() != policies.qos.presentation_policy() {
            return Err(SetQosError::Immutable(PolicyId::Presentation));
        }
        self.group.set_qos(&qos.clone().into_writer())?;
        policies.qos = qos;
        Ok(())
    }

    pub(super) fn default_endpoint_qos(&self) -> Qos {
        self.lock().default_endpoint_qos.clone()
    }

    pub(super) fn set_default_endpoint_qos(&self, qos: Qos) {
        self.lock().default_endpoint_qos = qos;
    }

    /// Enables the group, and its endpoints where ENTITY_FACTORY says so.
    pub(super) fn enable(&self) {
        let mut policies = self.lock();
        let was_enabled = std::mem::replace(&mut policies.is_enabled, true);
        if !was_enabled && policies.qos.autoenables() {
            self.group.enable();
        }
    }

    /// An endpoint may only be enabled after its group.
    pub(super) fn is_enabled(&self) -> bool {
        self.lock().is_enabled
    }

    fn lock(&self) -> MutexGuard<'_, Policies> {
        self.policies.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
