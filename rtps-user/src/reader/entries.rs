//! The samples of a cache, each a member of two lists: all in the order of arrival, and those of its instance.

use std::time::Instant;

use bytes::Bytes;

use super::change::Extras;
use crate::slab::Slab;
use crate::wire::{Guid, SequenceNumber, Timestamp};

const NONE: u32 = u32::MAX;

/// A sample in a cache.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) payload: Bytes,
    pub(super) valid_data: bool,
    pub(super) read: bool,
    pub(super) writer: Guid,
    pub(super) sequence: SequenceNumber,
    pub(super) timestamp: Option<Timestamp>,
    pub(super) extras: Option<Box<Extras>>,
    pub(super) reception: Instant,
    pub(super) disposed_generation: u32,
    pub(super) no_writers_generation: u32,
    /// Where its instance is.
    pub(super) instance: u32,
    /// How many samples had been added before it.
    pub(super) arrival: u64,
}

impl Entry {
    /// Both generation counts together, for the ranks.
    pub(super) fn generation(&self) -> u32 {
        self.disposed_generation
            .wrapping_add(self.no_writers_generation)
    }
}

#[derive(Clone, Copy, Debug)]
struct Links {
    previous: u32,
    next: u32,
}

#[derive(Debug)]
struct Node {
    entry: Entry,
    arrival: Links,
    sibling: Links,
}

/// First and last of a list.
#[derive(Clone, Copy, Debug)]
pub(super) struct List {
    head: u32,
    tail: u32,
}

impl Default for List {
    fn default() -> Self {
        Self {
            head: NONE,
            tail: NONE,
        }
    }
}

impl List {
    pub(super) fn first(self) -> Option<u32> {
        (self.head != NONE).then_some(self.head)
    }

    pub(super) fn last(self) -> Option<u32> {
        (self.tail != NONE).then_some(self.tail)
    }

    pub(super) fn is_empty(self) -> bool {
        self.head == NONE
    }
}

/// Which of its two lists.
type Of = fn(&mut Node) -> &mut Links;

/// The samples by their places, and the list of all.
#[derive(Debug, Default)]
pub(super) struct Entries {
    nodes: Slab<Node>,
    arrival: List,
    count: u64,
}

impl Entries {
    /// All in the order of arrival.
    pub(super) fn arrival(&self) -> List {
        self.arrival
    }

    /// How many there have ever been.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    pub(super) fn get(&self, place: u32) -> &Entry {
        &self.nodes[place].entry
    }

    pub(super) fn get_mut(&mut self, place: u32) -> &mut Entry {
        &mut self.nodes[place].entry
    }

    /// The one that arrived after `place`.
    pub(super) fn next_arrival(&self, place: u32) -> Option<u32> {
        let next = self.nodes[place].arrival.next;
        (next != NONE).then_some(next)
    }

    /// The one of the same instance that arrived after `place`.
    pub(super) fn next_sibling(&self, place: u32) -> Option<u32> {
        let next = self.nodes[place].sibling.next;
        (next != NONE).then_some(next)
    }

    /// Those of an instance.
    pub(super) fn siblings(&self, siblings: List) -> impl Iterator<Item = &Entry> + '_ {
        let places = std::iter::successors(siblings.first(), |place| self.next_sibling(*place));
        places.map(|place| self.get(place))
    }

    /// All, the last one first.
    pub(super) fn arrivals_back(&self) -> impl Iterator<Item = u32> + '_ {
        self.back(self.arrival, |node| node.arrival)
    }

    /// Those of an instance, the last one first.
    pub(super) fn siblings_back(&self, siblings: List) -> impl Iterator<Item = u32> + '_ {
        self.back(siblings, |node| node.sibling)
    }

    fn back(&self, list: List, of: fn(&Node) -> Links) -> impl Iterator<Item = u32> + '_ {
        let step = move |place: &u32| {
            let previous = of(&self.nodes[*place]).previous;
            (previous != NONE).then_some(previous)
        };
        std::iter::successors(list.last(), step)
    }

    /// Adds an entry as the newest of all and of its instance; returns its place.
    #[inline]
    pub(super) fn push(&mut self, siblings: &mut List, entry: Entry) -> u32 {
        self.insert(siblings, entry, None, None)
    }

    /// Adds an entry before others, of its instance and of all; as the newest where there is none.
    #[inline]
    pub(super) fn insert(
        &mut self,
        siblings: &mut List,
        mut entry: Entry,
        next_sibling: Option<u32>,
        next_arrival: Option<u32>,
    ) -> u32 {
        entry.arrival = self.count;
        self.count += 1;
        let unlinked = Links {
            previous: NONE,
            next: NONE,
        };
        let place = self.nodes.insert(Node {
            entry,
            arrival: unlinked,
            sibling: unlinked,
        });
        let mut arrival = self.arrival;
        self.link(&mut arrival, place, next_arrival, |node| &mut node.arrival);
        self.arrival = arrival;
        self.link(siblings, place, next_sibling, |node| &mut node.sibling);
        place
    }

    /// Removes an entry.
    pub(super) fn remove(&mut self, siblings: &mut List, place: u32) {
        let mut arrival = self.arrival;
        self.unlink(&mut arrival, place, |node| &mut node.arrival);
        self.arrival = arrival;
        self.unlink(siblings, place, |node| &mut node.sibling);
        self.nodes.clear(place);
    }

    fn link(&mut self, list: &mut List, place: u32, before: Option<u32>, of: Of) {
        let next = before.unwrap_or(NONE);
        let previous = match before {
            Some(next) => std::mem::replace(&mut of(&mut self.nodes[next]).previous, place),
            None => std::mem::replace(&mut list.tail, place),
        };
        *of(&mut self.nodes[place]) = Links { previous, next };
        match self.nodes.get_mut(previous) {
            Some(node) => of(node).next = place,
            None => list.head = place,
        }
    }

    fn unlink(&mut self, list: &mut List, place: u32, of: Of) {
        let Links { previous, next } = *of(&mut self.nodes[place]);
        match self.nodes.get_mut(previous) {
            Some(node) => of(node).next = next,
            None => list.head = next,
        }
        match self.nodes.get_mut(next) {
            Some(node) => of(node).previous = previous,
            None => list.tail = previous,
        }
    }
}
