//! OWNERSHIP EXCLUSIVE: of all writers of an instance one owns it (DDS 1.4 section 2.2.3.9.2).
//!
//! The owner is the strongest writer, of equally strong ones the one with the smallest GUID, so that all readers
//! agree. A stronger one takes over with its next change. Where the owner gives the instance up, or is gone, the
//! strongest of the others inherits it; where it only missed the deadline, nobody owns it until somebody writes.

use std::cmp::Reverse;
use std::collections::HashMap;

use crate::qos::Ownership;
use crate::wire::Guid;

/// The strengths of the matched writers.
#[derive(Debug, Default)]
pub(super) struct Strengths {
    of: HashMap<Guid, i32>,
}

impl Strengths {
    /// A writer is matched, or has changed its OWNERSHIP_STRENGTH.
    pub(super) fn set(&mut self, writer: Guid, offered: Ownership) {
        let strength = match offered {
            Ownership::Exclusive { strength } => strength,
            Ownership::Shared => 0,
        };
        self.of.insert(writer, strength);
    }

    /// A writer is matched no more.
    pub(super) fn remove(&mut self, writer: Guid) {
        self.of.remove(&writer);
    }

    /// Whether `writer` may change an instance that `owner` owns.
    pub(super) fn admits(&self, writer: Guid, owner: Option<Guid>) -> bool {
        owner.is_none_or(|owner| owner == writer || self.rank(writer) > self.rank(owner))
    }

    /// The one of `writers` that owns what they all write.
    pub(super) fn strongest(&self, writers: &[Guid]) -> Option<Guid> {
        writers
            .iter()
            .copied()
            .max_by_key(|writer| self.rank(*writer))
    }

    fn rank(&self, writer: Guid) -> (i32, Reverse<Guid>) {
        let strength = self.of.get(&writer).copied();
        (strength.unwrap_or(i32::MIN), Reverse(writer))
    }
}
