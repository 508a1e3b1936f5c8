//! What can be waited for of a participant and its entities.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rtps_user::reader::{Reader, Selection};

use crate::driver::{Core, Scope, Shared};
use crate::filter::PayloadFilter;
use crate::status::StatusMask;

/// A condition of an entity.
pub(crate) struct Watched {
    shared: Arc<Shared>,
    scope: Scope,
    trigger: Trigger,
}

/// When a condition is true.
pub(crate) enum Trigger {
    /// A status of the mask has changed since it was last asked for; there is data that has not been read.
    Status(AtomicU32),
    /// There is a sample of a selection.
    Read(Selection),
    /// There is a sample of a selection that passes.
    Query(Selection, Mutex<PayloadFilter>),
    /// What is found in the participant is so.
    Holds(Box<dyn Fn(&Core) -> bool + Send + Sync>),
}

impl Trigger {
    /// True while one of these statuses has changed.
    pub(crate) fn on(statuses: StatusMask) -> Self {
        Self::Status(AtomicU32::new(statuses.bits()))
    }
}

impl Watched {
    pub(crate) fn new(shared: &Arc<Shared>, scope: Scope, trigger: Trigger) -> Self {
        Self {
            shared: Arc::clone(shared),
            scope,
            trigger,
        }
    }

    /// The participant.
    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// The entity.
    pub(crate) fn scope(&self) -> Scope {
        self.scope
    }

    pub(crate) fn trigger(&self) -> &Trigger {
        &self.trigger
    }

    /// Whether the condition is true; that of an entity that is gone never is.
    pub(crate) fn is_true(&self, core: &Core) -> bool {
        match &self.trigger {
            Trigger::Status(mask) => {
                let mask = StatusMask::from_bits(mask.load(Ordering::Relaxed));
                core.status_changes(self.scope).intersects(mask)
            }
            Trigger::Holds(is_true) => is_true(core),
            Trigger::Read(selection) => self
                .reader(core)
                .is_some_and(|reader| reader.has_matching(selection)),
            Trigger::Query(selection, filter) => self.reader(core).is_some_and(|reader| {
                let filter = filter.lock().unwrap_or_else(PoisonError::into_inner);
                reader.has_matching_where(selection, &filter)
            }),
        }
    }

    fn reader<'a>(&self, core: &'a Core) -> Option<&'a Reader> {
        match self.scope {
            Scope::Endpoint(id) => core.endpoints.reader(id),
            Scope::Group(_) | Scope::Topic(_) | Scope::Participant => None,
        }
    }
}
