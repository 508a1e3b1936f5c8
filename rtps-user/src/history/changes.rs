//! Changes in the order of their sequence numbers.

use std::collections::VecDeque;

use super::CacheChange;
use crate::wire::SequenceNumber;

/// A queue with holes. A writer counts without gaps and removes almost always at the front, so that a number tells where
/// its change stands; only where holes were closed, the place is searched for. Everything costs O(1) then and O(log n)
/// at most, closing the holes included, which is spread over the removals that made them.
#[derive(Clone, Debug, Default)]
pub(super) struct Changes {
    /// The first and the last are no holes.
    slots: VecDeque<Slot>,
    len: usize,
}

/// The change is missing where it was taken out.
#[derive(Clone, Debug)]
struct Slot {
    sequence: SequenceNumber,
    change: Option<CacheChange>,
}

impl Changes {
    /// So many holes more than changes are not worth closing.
    const FEW_HOLES: usize = 32;

    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn first(&self) -> Option<SequenceNumber> {
        self.slots.front().map(|slot| slot.sequence)
    }

    pub(super) fn last(&self) -> Option<SequenceNumber> {
        self.slots.back().map(|slot| slot.sequence)
    }

    /// Appends a change, whose number is above all others.
    pub(super) fn push(&mut self, sequence: SequenceNumber, change: CacheChange) {
        self.len += 1;
        let change = Some(change);
        self.slots.push_back(Slot { sequence, change });
    }

    pub(super) fn get(&self, sequence: SequenceNumber) -> Option<&CacheChange> {
        let slot = self.slots.get(self.index_from(sequence))?;
        slot.change.as_ref().filter(|_| slot.sequence == sequence)
    }

    pub(super) fn get_mut(&mut self, sequence: SequenceNumber) -> Option<&mut CacheChange> {
        let index = self.index_from(sequence);
        let slot = self.slots.get_mut(index)?;
        slot.change.as_mut().filter(|_| slot.sequence == sequence)
    }

    /// The first change that is not below `sequence`.
    pub(super) fn next_from(
        &self,
        sequence: SequenceNumber,
    ) -> Option<(SequenceNumber, &CacheChange)> {
        let slots = self.slots.range(self.index_from(sequence)..);
        slots
            .filter_map(|slot| Some((slot.sequence, slot.change.as_ref()?)))
            .next()
    }

    pub(super) fn remove(&mut self, sequence: SequenceNumber) -> Option<CacheChange> {
        let index = self.index_from(sequence);
        let slot = self.slots.get_mut(index)?;
        let change = slot.change.take_if(|_| slot.sequence == sequence)?;
        self.len -= 1;
        let is_hole = |slot: &mut Slot| slot.change.is_none();
        while self.slots.pop_front_if(is_hole).is_some() {}
        while self.slots.pop_back_if(is_hole).is_some() {}
        if self.slots.len() > 2 * self.len + Self::FEW_HOLES {
            self.slots.retain(|slot| slot.change.is_some());
        }
        Some(change)
    }

    /// Where `sequence` stands, or else the first number above it.
    fn index_from(&self, sequence: SequenceNumber) -> usize {
        let Some(first) = self.first().filter(|first| *first <= sequence) else {
            return 0;
        };
        // Numbers differ by one at least: that far from the front, and no farther.
        let distance = sequence.0.abs_diff(first.0);
        let farthest = usize::try_from(distance).unwrap_or(usize::MAX);
        match self.slots.get(farthest) {
            Some(slot) if slot.sequence == sequence => farthest,
            None if self.last() < Some(sequence) => self.slots.len(),
            _ => self.slots.partition_point(|slot| slot.sequence < sequence),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{ChangeKind, NewChange};
    use crate::wire::{KeyHash, Timestamp};

    fn change() -> CacheChange {
        let change = NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash::default(),
            payload: vec![0].into(),
            timestamp: Timestamp::default(),
        };
        CacheChange::new(change, None, 0, SequenceNumber::ZERO)
    }

    #[test]
    fn holes_do_not_pile_up_behind_an_old_change() {
        let mut changes = Changes::default();
        changes.push(SequenceNumber(1), change());
        changes.push(SequenceNumber(2), change());
        for number in 3..10_000 {
            changes.push(SequenceNumber(number), change());
            changes.remove(SequenceNumber(number - 1));
            assert!(changes.slots.len() <= 2 * changes.len() + Changes::FEW_HOLES + 1);
            let next = changes.next_from(SequenceNumber(2));
            assert_eq!(next.map(|(next, _)| next.0), Some(number));
        }
        assert_eq!(changes.len(), 2);
    }
}
