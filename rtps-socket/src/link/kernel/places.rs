//! All memory that datagrams come through, for threads that look without the link.

use std::sync::Arc;

use crate::link::Arrivals;
use crate::sys::Ring;
use crate::sys::channel::Inlet;

/// See the module.
#[derive(Debug)]
pub(super) struct Places {
    /// The app's ring.
    pub(super) ring: Arc<Ring>,
    /// What other apps of the host fill.
    pub(super) inlets: Vec<Arc<Inlet>>,
}

impl Arrivals for Places {
    fn has_arrived(&self) -> bool {
        self.ring.has_record() || self.inlets.iter().any(|inlet| inlet.has_record())
    }
}
