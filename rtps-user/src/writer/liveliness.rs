//! LIVELINESS of a writer whose app asserts it: MANUAL_BY_PARTICIPANT and MANUAL_BY_TOPIC (DDS 1.4 section
//! 2.2.3.11). AUTOMATIC is the layer's business.

use std::time::Instant;

use crate::qos::{Liveliness, LivelinessKind};

/// The lease that runs since the last assertion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lease {
    deadline: Option<Instant>,
}

impl Lease {
    /// The app has shown that the writer is alive.
    pub(super) fn renew(&mut self, now: Instant, liveliness: Liveliness) {
        let is_manual = liveliness.kind != LivelinessKind::Automatic;
        let lease = liveliness.lease.to_std().filter(|_| is_manual);
        self.deadline = lease.and_then(|lease| now.checked_add(lease));
    }

    /// When it ends.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// Whether it ends now; that happens once.
    pub(super) fn expire(&mut self, now: Instant) -> bool {
        self.deadline.take_if(|deadline| *deadline <= now).is_some()
    }
}
