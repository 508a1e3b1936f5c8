//! LIVELINESS of a writer whose app asserts it: MANUAL_BY_PARTICIPANT and MANUAL_BY_TOPIC (DDS 1.4 section
//! 2.2.3.11). AUTOMATIC is the layer's business.

use std::time::Instant;

use super::Writer;
use crate::qos::{Liveliness, LivelinessKind};

/// The lease that runs since the last assertion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lease {
    asserted: Option<Instant>,
    deadline: Option<Instant>,
}

impl Lease {
    /// The app has shown that the writer is alive.
    pub(super) fn renew(&mut self, now: Instant, liveliness: Liveliness) {
        let is_manual = liveliness.kind != LivelinessKind::Automatic;
        if is_manual {
            let lease = liveliness.lease.to_std();
            self.asserted = Some(now);
            self.deadline = lease.and_then(|lease| now.checked_add(lease));
        }
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

impl Writer {
    /// When it was last asserted to be alive, where each writer of the app that is MANUAL_BY_PARTICIPANT asserts it for all
    /// of them.
    pub(crate) fn asserted_for_all(&self) -> Option<Instant> {
        self.lease.asserted.filter(|_| self.is_asserted_by_others())
    }

    /// Whether its lease ends now, unless another writer has asserted their liveliness meanwhile.
    pub(crate) fn depends_on_others(&self, now: Instant) -> bool {
        let is_due = self.lease.deadline.is_some_and(|deadline| deadline <= now);
        is_due && self.is_asserted_by_others()
    }

    /// Another writer was asserted to be alive at that time.
    pub(crate) fn handle_assertion(&mut self, at: Instant) {
        if self.lease.asserted.is_some_and(|asserted| asserted < at) {
            self.lease.renew(at, self.config.qos.liveliness);
        }
    }

    /// Whether it is MANUAL_BY_PARTICIPANT.
    pub(crate) fn is_asserted_by_others(&self) -> bool {
        self.config.qos.liveliness.kind == LivelinessKind::ManualByParticipant
    }
}
