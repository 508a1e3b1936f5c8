//! A set of numbers as ranges, for sequence numbers and fragment numbers that are dealt with.
//!
//! Every operation costs by the number of ranges that it touches, never by the numbers that they span: a GAP of
//! 2^40 numbers is one entry.

use std::collections::BTreeMap;
use std::ops::Range;

/// Disjoint ranges that do not touch each other, by their starts.
#[derive(Clone, Debug, Default)]
pub(super) struct Ranges {
    ends: BTreeMap<i64, i64>,
}

impl Ranges {
    /// How many ranges there are.
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    pub(super) fn contains(&self, number: i64) -> bool {
        self.ends
            .range(..=number)
            .next_back()
            .is_some_and(|(_, end)| number < *end)
    }

    /// Whether one range covers all from `start` on to `end`.
    pub(super) fn covers(&self, range: Range<i64>) -> bool {
        self.ends
            .range(..=range.start)
            .next_back()
            .is_some_and(|(_, end)| range.end <= *end)
    }

    /// The end of the last range.
    pub(super) fn end(&self) -> Option<i64> {
        self.ends.last_key_value().map(|(_, end)| *end)
    }

    /// Adds the numbers of `range`; returns how many were new.
    pub(super) fn insert(&mut self, range: Range<i64>) -> u64 {
        if range.is_empty() {
            return 0;
        }
        if let Some(mut last) = self.ends.last_entry()
            && *last.get() == range.start
        {
            *last.get_mut() = range.end;
            return range.end.abs_diff(range.start);
        }
        self.merge(range)
    }

    fn merge(&mut self, Range { mut start, mut end }: Range<i64>) -> u64 {
        let mut added = end.abs_diff(start);
        let (asked_start, asked_end) = (start, end);
        while let Some((&from, &to)) = self.ends.range(..=end).next_back()
            && to >= start
        {
            let overlap = to.min(asked_end).saturating_sub(from.max(asked_start));
            added -= overlap.max(0).unsigned_abs();
            start = start.min(from);
            end = end.max(to);
            self.ends.remove(&from);
        }
        self.ends.insert(start, end);
        added
    }

    /// The end of the range that `number` is in, or `number` itself.
    pub(super) fn first_missing(&self, number: i64) -> i64 {
        match self.ends.range(..=number).next_back() {
            Some((_, end)) => number.max(*end),
            None => number,
        }
    }

    /// Forgets all numbers below `number`.
    pub(super) fn remove_below(&mut self, number: i64) {
        while let Some(first) = self.ends.first_entry()
            && *first.key() < number
        {
            let (_, end) = first.remove_entry();
            if end > number {
                self.ends.insert(number, end);
            }
        }
    }

    /// The numbers of `range` that are not in the set, in order; takes time by the numbers that it yields.
    pub(super) fn missing(&self, range: Range<i64>) -> impl Iterator<Item = i64> + '_ {
        let mut next = self.first_missing(range.start);
        std::iter::from_fn(move || {
            let number = next;
            next = self.first_missing(number.saturating_add(1));
            (number < range.end).then_some(number)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn huge_ranges_are_single_entries() {
        let mut ranges = Ranges::default();
        assert_eq!(ranges.insert(1..1 << 40), (1 << 40) - 1);
        assert_eq!(ranges.insert(5..i64::MAX), i64::MAX as u64 - (1 << 40));
        assert_eq!(ranges.len(), 1);
        assert_eq!(ranges.first_missing(7), i64::MAX);
        assert_eq!(ranges.missing(0..i64::MAX).collect::<Vec<_>>(), [0]);
        ranges.remove_below(i64::MAX);
        assert!(ranges.is_empty());
    }

    proptest! {
        #[test]
        fn behaves_as_a_set(operations in prop::collection::vec((any::<bool>(), 0..60i64, 0..12i64), 0..60)) {
            let (mut ranges, mut model) = (Ranges::default(), BTreeSet::new());
            for (insert, start, length) in operations {
                if insert {
                    let before = model.len();
                    model.extend(start..start + length);
                    prop_assert_eq!(ranges.insert(start..start + length), (model.len() - before) as u64);
                } else {
                    ranges.remove_below(start);
                    model.retain(|number| *number >= start);
                }
                for number in 0..80 {
                    prop_assert_eq!(ranges.contains(number), model.contains(&number));
                }
                let missing: Vec<_> = (0..80).filter(|number| !model.contains(number)).collect();
                prop_assert_eq!(ranges.missing(0..80).collect::<Vec<_>>(), missing);
                prop_assert_eq!(ranges.end(), model.last().map(|last| last + 1));
            }
        }
    }
}
