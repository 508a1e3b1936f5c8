//! Which HEARTBEATs of a writer to believe (RTPS 2.5 section 8.4.15.7).
//!
//! Counts filter out duplicates and what was overtaken. Numbers far beyond all that the writer has told so far
//! are not believed at once, because they would make the reader skip everything before them: the writer is asked,
//! and only what it says again after that counts.

use std::time::{Duration, Instant};

use crate::wire::{Heartbeat, SequenceNumber};

/// How far ahead of what is known a writer may be without being asked.
pub(super) const MARGIN: i64 = 1 << 16;

#[derive(Debug, Default)]
pub(super) struct HeartbeatFilter {
    /// The last count accepted, and when.
    accepted: Option<(i32, Instant)>,
    suspicion: Suspicion,
}

#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
enum Suspicion {
    #[default]
    None,
    /// A HEARTBEAT was too far ahead; the writer is to be asked.
    Raised,
    /// The writer has been asked.
    Asked,
}

impl HeartbeatFilter {
    /// Whether a HEARTBEAT with this count is new. After `validity` any count is, because the writer may count
    /// anew after a restart or a disconnection that only one side has noticed.
    pub(super) fn is_new(&mut self, now: Instant, count: i32, validity: Duration) -> bool {
        if let Some((last, at)) = self.accepted
            && count.wrapping_sub(last) <= 0
            && now.saturating_duration_since(at) < validity
        {
            return false;
        }
        self.accepted = Some((count, now));
        true
    }

    /// Whether a HEARTBEAT may be acted upon, where the writer's numbers are known up to `highest`.
    pub(super) fn is_believable(&mut self, heartbeat: &Heartbeat, highest: SequenceNumber) -> bool {
        let far = heartbeat.last > highest.plus(MARGIN);
        if far && self.suspicion != Suspicion::Asked {
            self.suspicion = Suspicion::Raised;
            return false;
        }
        self.suspicion = Suspicion::None;
        true
    }

    /// Whether the writer must be asked; it is with the ACKNACK that is sent now.
    pub(super) fn ask(&mut self) -> bool {
        let raised = self.suspicion == Suspicion::Raised;
        if raised {
            self.suspicion = Suspicion::Asked;
        }
        raised
    }
}
