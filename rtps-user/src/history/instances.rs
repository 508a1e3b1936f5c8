//! The instances that changes belong to.

use std::collections::HashMap;

use crate::own_keys::OwnKeys;
use crate::wire::{KeyHash, SequenceNumber};

/// The changes of one instance.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Instance {
    /// The oldest that is still there.
    pub oldest: SequenceNumber,
    /// The newest.
    pub newest: SequenceNumber,
    /// How many there are.
    pub len: usize,
}

/// The number of no change.
const NONE: SequenceNumber = SequenceNumber::ZERO;
/// What a topic without key has for a key hash.
const NAMELESS: KeyHash = KeyHash([0; 16]);

/// Instances by their key hash. That of a topic without key needs no search.
#[derive(Clone, Debug, Default)]
pub(super) struct Instances {
    nameless: Option<Instance>,
    named: HashMap<KeyHash, Instance, OwnKeys>,
}

impl Instances {
    pub(super) fn len(&self) -> usize {
        usize::from(self.nameless.is_some()) + self.named.len()
    }

    pub(super) fn get(&self, hash: KeyHash) -> Option<Instance> {
        match hash {
            NAMELESS => self.nameless,
            hash => self.named.get(&hash).copied(),
        }
    }

    /// Appends a change to its instance; gives the one that was the newest before, or 0.
    pub(super) fn append(&mut self, hash: KeyHash, sequence: SequenceNumber) -> SequenceNumber {
        let new = Instance {
            oldest: sequence,
            newest: NONE,
            len: 0,
        };
        let instance = match hash {
            NAMELESS => self.nameless.get_or_insert(new),
            hash => self.named.entry(hash).or_insert(new),
        };
        instance.len += 1;
        std::mem::replace(&mut instance.newest, sequence)
    }

    /// A change was taken out that stood between `older` and `newer`, which are 0 at the ends.
    pub(super) fn unlink(&mut self, hash: KeyHash, older: SequenceNumber, newer: SequenceNumber) {
        if (older, newer) == (NONE, NONE) {
            match hash {
                NAMELESS => self.nameless = None,
                hash => _ = self.named.remove(&hash),
            }
            return;
        }
        let instance = match hash {
            NAMELESS => self.nameless.as_mut(),
            hash => self.named.get_mut(&hash),
        };
        if let Some(instance) = instance {
            if older == NONE {
                instance.oldest = newer;
            }
            if newer == NONE {
                instance.newest = older;
            }
            instance.len -= 1;
        }
    }
}
