//! HistoryCache: the changes that a writer still has (RTPS 2.5 section 8.2.2).

use std::collections::VecDeque;

use bytes::Bytes;

use super::changes::Changes;
use super::instances::Instances;
use super::{CacheChange, ChangeKind, Instance, Membership, NewChange};
use crate::wire::{KeyHash, SequenceNumber, Timestamp};

/// Changes by sequence number, and the list of each instance's changes through them. No operation on one change costs
/// more than O(log n), and those that a stream of changes consists of cost O(1).
#[derive(Clone, Debug, Default)]
pub struct HistoryCache {
    changes: Changes,
    instances: Instances,
    bytes: usize,
    /// Changes that only end a coherent set.
    set_ends: usize,
    /// Of all changes that were ever taken in.
    weight: u64,
    journal: Option<VecDeque<Entry>>,
}

/// What has happened to a history.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Entry {
    /// A change was taken in.
    Inserted(SequenceNumber),
    /// A change was taken out.
    Removed(SequenceNumber),
}

impl HistoryCache {
    /// Keeps a journal from now on, for one who repeats all that happens.
    pub fn keep_journal(&mut self) {
        self.journal = Some(VecDeque::new());
    }

    /// Whether there is something in the journal.
    pub fn has_news(&self) -> bool {
        self.journal
            .as_ref()
            .is_some_and(|journal| !journal.is_empty())
    }

    /// Takes the oldest entry out of the journal.
    pub fn next_news(&mut self) -> Option<Entry> {
        self.journal.as_mut()?.pop_front()
    }

    fn note(&mut self, entry: Entry) {
        if let Some(journal) = &mut self.journal {
            journal.push_back(entry);
        }
    }

    /// Appends a change; `sequence` must be above all that are in here.
    pub fn insert(&mut self, sequence: SequenceNumber, change: NewChange) {
        self.insert_member(sequence, change, None);
    }

    /// Appends a change of a coherent set or a group; `sequence` must be above all that are in here.
    pub fn insert_member(
        &mut self,
        sequence: SequenceNumber,
        change: NewChange,
        membership: Option<Box<Membership>>,
    ) {
        debug_assert!(self.last().is_none_or(|last| last < sequence));
        let older = self.instances.append(change.instance, sequence);
        if let Some(older) = self.changes.get_mut(older) {
            older.newer = sequence;
        }
        self.bytes += change.payload.len();
        let change = CacheChange::new(change, membership, self.weight, older);
        self.push(sequence, change);
    }

    /// Appends what says that a coherent set has ended. It belongs to no instance.
    pub fn insert_set_end(
        &mut self,
        sequence: SequenceNumber,
        membership: Membership,
        timestamp: Timestamp,
    ) {
        debug_assert!(membership.ends_set());
        let nothing = NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash::default(),
            payload: Bytes::new(),
            timestamp,
        };
        let change = CacheChange::new(
            nothing,
            Some(Box::new(membership)),
            self.weight,
            SequenceNumber::ZERO,
        );
        self.set_ends += 1;
        self.push(sequence, change);
    }

    fn push(&mut self, sequence: SequenceNumber, change: CacheChange) {
        self.weight += change.weight();
        self.changes.push(sequence, change);
        self.note(Entry::Inserted(sequence));
    }

    /// Takes a change out.
    pub fn remove(&mut self, sequence: SequenceNumber) -> Option<CacheChange> {
        let change = self.changes.remove(sequence)?;
        self.bytes -= change.payload.len();
        if change.ends_set() {
            self.set_ends -= 1;
        } else {
            self.unlink(&change);
        }
        self.note(Entry::Removed(sequence));
        Some(change)
    }

    /// Takes the oldest changes of an instance out until there is room for one more among `depth`.
    pub fn replace_in(&mut self, instance: Instance, depth: usize) {
        let mut oldest = instance.oldest;
        for _ in depth..=instance.len {
            let Some(change) = self.remove(oldest) else {
                return;
            };
            oldest = change.newer;
        }
    }

    /// Takes the oldest change out if it is not above `limit`.
    pub fn pop_through(&mut self, limit: SequenceNumber) -> Option<CacheChange> {
        let oldest = self.first().filter(|oldest| *oldest <= limit)?;
        self.remove(oldest)
    }

    /// The change with that number.
    pub fn get(&self, sequence: SequenceNumber) -> Option<&CacheChange> {
        self.changes.get(sequence)
    }

    /// The oldest change that is not below `sequence`.
    pub fn next_from(&self, sequence: SequenceNumber) -> Option<(SequenceNumber, &CacheChange)> {
        self.changes.next_from(sequence)
    }

    /// The lowest number.
    pub fn first(&self) -> Option<SequenceNumber> {
        self.changes.first()
    }

    /// The highest number.
    pub fn last(&self) -> Option<SequenceNumber> {
        self.changes.last()
    }

    /// All changes.
    pub fn len(&self) -> usize {
        self.changes.len()
    }

    /// Changes of all instances, without those that end sets: what RESOURCE_LIMITS counts.
    pub fn samples(&self) -> usize {
        self.changes.len() - self.set_ends
    }

    /// Whether there is no change.
    pub fn is_empty(&self) -> bool {
        self.changes.len() == 0
    }

    /// Bytes of all payloads.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// The weight of the changes from `sequence` on, and of those that were taken out from among them.
    pub fn weight_from(&self, sequence: SequenceNumber) -> u64 {
        let first = self.changes.next_from(sequence);
        first.map_or(0, |(_, change)| self.weight - change.before)
    }

    /// Instances that have changes in here.
    pub fn instances(&self) -> usize {
        self.instances.len()
    }

    /// An instance that has changes in here.
    pub fn instance(&self, instance: KeyHash) -> Option<Instance> {
        self.instances.get(instance)
    }

    /// Closes the gap that a change leaves in the list of its instance.
    fn unlink(&mut self, change: &CacheChange) {
        let CacheChange { older, newer, .. } = *change;
        if let Some(older) = self.changes.get_mut(older) {
            older.newer = newer;
        }
        if let Some(newer) = self.changes.get_mut(newer) {
            newer.older = older;
        }
        self.instances.unlink(change.instance, older, newer);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::history::ChangeKind;
    use crate::wire::Timestamp;

    fn change(instance: u8, bytes: usize) -> NewChange {
        NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash([instance; 16]),
            payload: vec![0; bytes].into(),
            timestamp: Timestamp::default(),
        }
    }

    /// Stands for what belongs to none.
    const NO_INSTANCE: u8 = u8::MAX;

    const SET_END: Membership = Membership {
        coherent_set: Some(SequenceNumber::UNKNOWN),
        group: None,
        writers: None,
    };

    #[derive(Clone, Debug)]
    enum Operation {
        Insert(u8, usize),
        EndSet,
        /// Leaves numbers out.
        Skip(i64),
        Remove(i64),
        PopThrough(i64),
    }

    fn operation() -> impl Strategy<Value = Operation> {
        prop_oneof![
            3 => (0..4u8, 0..9usize).prop_map(|(instance, bytes)| Operation::Insert(instance, bytes)),
            1 => Just(Operation::EndSet),
            1 => (1..4i64).prop_map(Operation::Skip),
            3 => (0..128i64).prop_map(Operation::Remove),
            1 => (0..64i64).prop_map(Operation::PopThrough),
        ]
    }

    proptest! {
        /// The cache against a plain list that is searched from end to end.
        #[test]
        fn agrees_with_a_list(operations in prop::collection::vec(operation(), 0..200)) {
            let mut cache = HistoryCache::default();
            let mut list: Vec<(i64, u8, usize)> = Vec::new();
            let mut last = 0;
            for operation in operations {
                match operation {
                    Operation::Insert(instance, bytes) => {
                        last += 1;
                        cache.insert(SequenceNumber(last), change(instance, bytes));
                        list.push((last, instance, bytes));
                    }
                    Operation::EndSet => {
                        last += 1;
                        cache.insert_set_end(SequenceNumber(last), SET_END, Timestamp::default());
                        list.push((last, NO_INSTANCE, 0));
                    }
                    Operation::Skip(numbers) => last += numbers,
                    Operation::Remove(number) => {
                        let removed = cache.remove(SequenceNumber(number)).is_some();
                        prop_assert_eq!(removed, list.iter().any(|entry| entry.0 == number));
                        list.retain(|entry| entry.0 != number);
                    }
                    Operation::PopThrough(limit) => {
                        let popped = cache.pop_through(SequenceNumber(limit)).is_some();
                        prop_assert_eq!(popped, list.first().is_some_and(|entry| entry.0 <= limit));
                        if popped {
                            list.remove(0);
                        }
                    }
                }
                prop_assert_eq!(cache.len(), list.len());
                let samples = list.iter().filter(|entry| entry.1 != NO_INSTANCE);
                prop_assert_eq!(cache.samples(), samples.count());
                prop_assert_eq!(cache.bytes(), list.iter().map(|entry| entry.2).sum::<usize>());
                prop_assert_eq!(cache.first().map(|n| n.0), list.first().map(|entry| entry.0));
                prop_assert_eq!(cache.last().map(|n| n.0), list.last().map(|entry| entry.0));
                for number in 0..=last + 1 {
                    let expected = list.iter().find(|entry| entry.0 >= number).map(|entry| entry.0);
                    let next = cache.next_from(SequenceNumber(number)).map(|(next, _)| next.0);
                    prop_assert_eq!(next, expected);
                    let is_there = cache.get(SequenceNumber(number)).is_some();
                    prop_assert_eq!(is_there, expected == Some(number));
                }
                for instance in 0..4u8 {
                    let hash = KeyHash([instance; 16]);
                    let of_instance: Vec<_> = list.iter().filter(|entry| entry.1 == instance).collect();
                    let expected = of_instance.first().zip(of_instance.last()).map(|(oldest, newest)| Instance {
                        oldest: SequenceNumber(oldest.0),
                        newest: SequenceNumber(newest.0),
                        len: of_instance.len(),
                    });
                    prop_assert_eq!(cache.instance(hash), expected);
                }
            }
        }
    }
}
