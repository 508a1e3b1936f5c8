//! What can be waited for of a writer or reader.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rtps_user::reader::Selection;
use rtps_user::wire::EntityId;

use crate::driver::{Core, Shared};
use crate::filter::PayloadFilter;
use crate::status::{StatusKind, StatusMask};

/// A condition of one endpoint.
pub(crate) struct Watched {
    shared: Arc<Shared>,
    id: EntityId,
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
}

impl Watched {
    pub(super) fn new(shared: &Arc<Shared>, id: EntityId, trigger: Trigger) -> Self {
        Self {
            shared: Arc::clone(shared),
            id,
            trigger,
        }
    }

    /// The participant.
    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// The endpoint.
    pub(crate) fn id(&self) -> EntityId {
        self.id
    }

    pub(crate) fn trigger(&self) -> &Trigger {
        &self.trigger
    }

    /// Whether the condition is true; that of an endpoint that is gone never is.
    pub(crate) fn is_true(&self, core: &Core) -> bool {
        let reader = core.endpoints.reader(self.id);
        match &self.trigger {
            Trigger::Status(mask) => {
                let mask = StatusMask::from_bits(mask.load(Ordering::Relaxed));
                let wants_data = mask.contains(StatusKind::DataAvailable);
                let has_data = wants_data && reader.is_some_and(|reader| reader.has_data());
                let entity = core.entity(self.id);
                has_data || entity.is_some_and(|entity| entity.statuses.changed().intersects(mask))
            }
            Trigger::Read(selection) => reader.is_some_and(|reader| reader.has_matching(selection)),
            Trigger::Query(selection, filter) => reader.is_some_and(|reader| {
                let filter = filter.lock().unwrap_or_else(PoisonError::into_inner);
                reader.has_matching_where(selection, &filter)
            }),
        }
    }
}
