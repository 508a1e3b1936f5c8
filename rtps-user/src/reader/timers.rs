//! What a reader has to do at some time, each thing once.

use std::collections::{BTreeSet, HashMap};
use std::hash::Hash;
use std::time::Instant;

/// A queue of things by the time when they are due. Only a change of a time costs anything.
#[derive(Debug)]
pub(super) struct Timers<K> {
    due: HashMap<K, Instant>,
    queue: BTreeSet<(Instant, K)>,
}

impl<K> Default for Timers<K> {
    fn default() -> Self {
        Self {
            due: HashMap::new(),
            queue: BTreeSet::new(),
        }
    }
}

impl<K: Copy + Eq + Hash + Ord> Timers<K> {
    /// Sets a timer anew.
    pub(super) fn set(&mut self, key: K, at: Instant) {
        self.cancel(key);
        self.due.insert(key, at);
        self.queue.insert((at, key));
    }

    /// Sets a timer unless it is due sooner.
    pub(super) fn set_earlier(&mut self, key: K, at: Instant) {
        if self.due.get(&key).is_none_or(|present| at < *present) {
            self.set(key, at);
        }
    }

    pub(super) fn cancel(&mut self, key: K) {
        if let Some(at) = self.due.remove(&key) {
            self.queue.remove(&(at, key));
        }
    }

    pub(super) fn next(&self) -> Option<Instant> {
        self.queue.first().map(|(at, _)| *at)
    }

    /// Takes the oldest that is due.
    pub(super) fn pop(&mut self, now: Instant) -> Option<K> {
        let (at, key) = *self.queue.first()?;
        if at > now {
            return None;
        }
        self.cancel(key);
        Some(key)
    }
}
