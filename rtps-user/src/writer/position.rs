//! How far a stream of changes has got: a change, and a fragment of it.

use crate::wire::SequenceNumber;

/// The next thing to be sent: fragments count from 1, and a change that is not fragmented is its own fragment 1.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(super) struct Position {
    pub(super) sequence: SequenceNumber,
    pub(super) fragment: u32,
}

impl Position {
    /// The beginning of a change.
    pub(super) fn start_of(sequence: SequenceNumber) -> Self {
        Self {
            sequence,
            fragment: 1,
        }
    }

    /// Moves on to a later change; stays in the middle of one when it is that change.
    pub(super) fn skip_to(&mut self, sequence: SequenceNumber) {
        if sequence > self.sequence {
            *self = Self::start_of(sequence);
        }
    }
}
