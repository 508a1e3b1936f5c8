//! Changes of a writer that wait because one before them is missing, or because the cache is full.

use std::collections::BTreeMap;

use super::change::Change;
use crate::wire::SequenceNumber;

/// How many may wait.
const MAX_CHANGES: usize = 1 << 16;
/// What each takes beside its payload.
const OVERHEAD: usize = 256;

#[derive(Debug)]
pub(super) struct Held {
    changes: BTreeMap<SequenceNumber, Change>,
    bytes: usize,
    max_bytes: usize,
}

impl Held {
    /// Room for two samples of the largest size.
    pub(super) fn new(max_sample_size: usize) -> Self {
        Self {
            changes: BTreeMap::new(),
            bytes: 0,
            max_bytes: max_sample_size.saturating_mul(2),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.changes.len()
    }

    /// Whether there is room for one more with so many bytes.
    pub(super) fn has_room(&self, bytes: usize) -> bool {
        self.changes.len() < MAX_CHANGES && self.bytes.saturating_add(bytes) <= self.max_bytes
    }

    pub(super) fn insert(&mut self, change: Change) {
        self.bytes += change.payload.len() + OVERHEAD;
        self.changes.insert(change.sequence, change);
    }

    /// The oldest.
    pub(super) fn first(&self) -> Option<&Change> {
        self.changes.first_key_value().map(|(_, change)| change)
    }

    /// The number of the newest.
    pub(super) fn newest(&self) -> Option<SequenceNumber> {
        self.changes.last_key_value().map(|(sequence, _)| *sequence)
    }

    pub(super) fn pop_first(&mut self) -> Option<Change> {
        let (_, change) = self.changes.pop_first()?;
        self.bytes -= change.payload.len() + OVERHEAD;
        Some(change)
    }
}
