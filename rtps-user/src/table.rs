//! Values by key, each at a place of its own, for what is looked up for every submessage.
//!
//! Submessages of one sender come in a row, so that the value that was found last is looked at before the hash table is.
//! The hash is a keyed one where the keys are what others choose.

use std::collections::HashMap;
use std::hash::{BuildHasher, Hash, RandomState};
use std::ops::{Index, IndexMut};

use crate::slab::Slab;

#[derive(Debug)]
pub(crate) struct Table<K, V, S = RandomState> {
    values: Slab<V>,
    places: HashMap<K, u32, S>,
    /// What was found last.
    recent: Option<(K, u32)>,
}

impl<K, V, S: Default> Default for Table<K, V, S> {
    fn default() -> Self {
        Self {
            values: Slab::default(),
            places: HashMap::default(),
            recent: None,
        }
    }
}

impl<K: Copy + Eq + Hash, V, S: BuildHasher> Table<K, V, S> {
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// The place of a key's value, which stays until the value is removed.
    #[inline]
    pub(crate) fn find(&mut self, key: K) -> Option<u32> {
        if let Some((recent, place)) = self.recent
            && recent == key
        {
            return Some(place);
        }
        let place = *self.places.get(&key)?;
        self.recent = Some((key, place));
        Some(place)
    }

    pub(crate) fn get(&self, key: K) -> Option<&V> {
        let place = match self.recent {
            Some((recent, place)) if recent == key => place,
            _ => *self.places.get(&key)?,
        };
        self.values.get(place)
    }

    #[inline]
    pub(crate) fn get_mut(&mut self, key: K) -> Option<&mut V> {
        let place = self.find(key)?;
        self.values.get_mut(place)
    }

    /// The value at a place, if there is one.
    #[inline]
    pub(crate) fn at_mut(&mut self, place: u32) -> Option<&mut V> {
        self.values.get_mut(place)
    }

    /// Adds a value, or replaces that of the same key; returns its place.
    pub(crate) fn insert(&mut self, key: K, value: V) -> u32 {
        self.remove(key);
        let place = self.values.insert(value);
        self.places.insert(key, place);
        self.recent = Some((key, place));
        place
    }

    pub(crate) fn remove(&mut self, key: K) -> Option<V> {
        let place = self.places.remove(&key)?;
        self.recent = self.recent.filter(|(recent, _)| *recent != key);
        self.values.remove(place)
    }

    /// The keys, in no particular order.
    pub(crate) fn keys(&self) -> impl Iterator<Item = K> + '_ {
        self.places.keys().copied()
    }

    /// The values with their places.
    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = (u32, &mut V)> {
        self.values.iter_mut()
    }

    /// The places in use.
    pub(crate) fn places(&self) -> impl Iterator<Item = u32> + use<K, V, S> {
        self.values.places()
    }
}

impl<K, V, S> Index<u32> for Table<K, V, S> {
    type Output = V;

    #[inline]
    fn index(&self, place: u32) -> &V {
        &self.values[place]
    }
}

impl<K, V, S> IndexMut<u32> for Table<K, V, S> {
    #[inline]
    fn index_mut(&mut self, place: u32) -> &mut V {
        &mut self.values[place]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_last_is_forgotten_with_its_value() {
        let mut table: Table<_, _> = Table::default();
        let first = table.insert("a", 1);
        table.insert("b", 2);
        assert_eq!(table.find("a"), Some(first));
        assert_eq!(table.remove("a"), Some(1));
        assert_eq!(table.find("a"), None);
        assert_eq!(table.get("a"), None);
        assert_eq!(table.insert("c", 3), first, "places are used again");
        assert_eq!(table.find("a"), None);
        assert_eq!(table.get("c"), Some(&3));
    }

    #[test]
    fn a_value_replaces_that_of_the_same_key() {
        let mut table: Table<_, _> = Table::default();
        table.insert("a", 1);
        let place = table.insert("a", 2);
        assert_eq!(table.len(), 1);
        assert_eq!(table[place], 2);
        assert_eq!(table.get_mut("a"), Some(&mut 2));
        assert_eq!(table.places().collect::<Vec<_>>(), [place]);
    }
}
