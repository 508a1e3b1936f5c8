//! What the writers of one publisher share where its PRESENTATION has GROUP scope (RTPS 2.5 sections 8.7.5 and 8.7.6).

use md5::{Digest, Md5};

use crate::history::GroupStamp;
use crate::wire::{EntityId, GroupDigest, SequenceNumber};

/// The group: its sequence number, and its coherent set. It belongs to the publisher, which lends it to the writer that
/// writes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Group {
    last: SequenceNumber,
    writers: GroupDigest,
    set: Set,
}

/// The coherent set of a group.
#[derive(Clone, Copy, Debug, Default)]
enum Set {
    #[default]
    Closed,
    /// Its first group sequence number, once a change has been written.
    Open(Option<SequenceNumber>),
}

impl Group {
    /// Says which writers there are.
    pub fn set_writers(&mut self, writers: impl IntoIterator<Item = EntityId>) {
        self.writers = digest(writers);
    }

    /// What is written from now on is one coherent set.
    pub fn begin_set(&mut self) {
        self.set = Set::Open(None);
    }

    /// The set has ended, after all writers have been told ([`Writer::end_coherent_in`](super::Writer::end_coherent_in)).
    pub fn end_set(&mut self) {
        self.set = Set::Closed;
    }

    /// The newest group sequence number; 0 before the first.
    pub fn last(&self) -> SequenceNumber {
        self.last
    }

    pub(super) fn has_open_set(&self) -> bool {
        matches!(self.set, Set::Open(_))
    }

    pub(super) fn writers(&self) -> GroupDigest {
        self.writers
    }

    /// The stamp of the next change.
    pub(super) fn stamp(&mut self) -> GroupStamp {
        self.last = self.last.next();
        if let Set::Open(first) = &mut self.set {
            first.get_or_insert(self.last);
        }
        self.stamp_of_end()
    }

    /// The stamp of what ends the set.
    pub(super) fn stamp_of_end(&self) -> GroupStamp {
        let set = match self.set {
            Set::Open(first) => first,
            Set::Closed => None,
        };
        GroupStamp {
            sequence: self.last,
            set,
        }
    }
}

/// The first bytes of the MD5 of the ids in order, serialized as a big-endian sequence; zeros for none (RTPS 9.3.2).
fn digest(writers: impl IntoIterator<Item = EntityId>) -> GroupDigest {
    let mut ids: Vec<[u8; 4]> = writers.into_iter().map(|id| id.0).collect();
    if ids.is_empty() {
        return GroupDigest::default();
    }
    ids.sort_unstable();
    let mut hash = Md5::new();
    hash.update((ids.len() as u32).to_be_bytes());
    for id in ids {
        hash.update(id);
    }
    let [a, b, c, d, ..]: [u8; 16] = hash.finalize().into();
    GroupDigest([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_go_up_across_sets() {
        let mut group = Group::default();
        assert_eq!(group.stamp().set, None);
        group.begin_set();
        assert_eq!(group.stamp_of_end().set, None, "nothing was written");
        for sequence in [2, 3] {
            let stamp = group.stamp();
            assert_eq!(
                (stamp.sequence.0, stamp.set),
                (sequence, Some(SequenceNumber(2)))
            );
        }
        group.end_set();
        assert_eq!(group.stamp().set, None);
        assert_eq!(group.last(), SequenceNumber(4));
    }

    #[test]
    fn digests_are_those_of_the_sorted_ids() {
        let ids = [EntityId([1, 0, 2, 2]), EntityId([1, 0, 1, 2])];
        let reversed = ids.into_iter().rev();
        assert_eq!(digest(ids), digest(reversed));
        assert_ne!(digest(ids), digest(ids.into_iter().take(1)));
        assert_eq!(digest([]), GroupDigest::default());
    }
}
