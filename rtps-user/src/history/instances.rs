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

    /// Appends a change to its instance; gives the one that was the newest before.
    pub(super) fn append(
        &mut self,
        hash: KeyHash,
        sequence: SequenceNumber,
    ) -> Option<SequenceNumber> {
        let new = Instance {
            oldest: sequence,
            newest: sequence,
            len: 0,
        };
        let instance = match hash {
            NAMELESS => self.nameless.get_or_insert(new),
            hash => self.named.entry(hash).or_insert(new),
        };
        let older = (instance.len > 0).then_some(instance.newest);
        instance.newest = sequence;
        instance.len += 1;
        older
    }

    /// A change was taken out that stood between `older` and `newer`.
    pub(super) fn unlink(
        &mut self,
        hash: KeyHash,
        older: Option<SequenceNumber>,
        newer: Option<SequenceNumber>,
    ) {
        if older.is_none() && newer.is_none() {
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
            instance.oldest = newer.filter(|_| older.is_none()).unwrap_or(instance.oldest);
            instance.newest = older.filter(|_| newer.is_none()).unwrap_or(instance.newest);
            instance.len -= 1;
        }
    }
}
