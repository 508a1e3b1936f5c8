//! Walking over the instances, one after the other (DDS 1.4 section 2.2.2.5.3.16), and what is visible meanwhile.

use std::ops::Bound;

use super::cache::Cache;
use super::{Reader, Selection};
use crate::wire::KeyHash;

impl Reader {
    /// The instance after `previous` that has a sample of a selection, whatever instance that names; the first one for
    /// `None`. Instances are in the order of their keys, which is the same in all readers; `previous` need not be
    /// there any more.
    pub fn next_instance(
        &mut self,
        previous: Option<KeyHash>,
        selection: &Selection,
    ) -> Option<KeyHash> {
        self.cache.next_instance(previous, selection)
    }

    /// Whether an instance is known.
    pub fn lookup_instance(&self, instance: KeyHash) -> bool {
        self.cache.instances.get(instance).is_some()
    }

    /// From now on only what is there already can be read and taken (`begin_access`). That samples disappear, because
    /// newer ones push them out or they expire, goes on.
    pub fn freeze(&mut self) {
        self.cache.horizon = self.cache.entries.count();
    }

    /// All can be read and taken again (`end_access`).
    pub fn thaw(&mut self) {
        self.cache.horizon = u64::MAX;
    }
}

impl Cache {
    fn next_instance(
        &mut self,
        previous: Option<KeyHash>,
        selection: &Selection,
    ) -> Option<KeyHash> {
        let with_samples = self.instances.keys().filter(|key| {
            let instance = self.instances.get(*key);
            instance.is_some_and(|instance| !instance.samples.is_empty())
        });
        let walked = self.walked.take().unwrap_or_else(|| with_samples.collect());
        let start = previous.map_or(Bound::Unbounded, Bound::Excluded);
        let next = walked
            .range((start, Bound::Unbounded))
            .copied()
            .find(|key| {
                self.has_matching(&Selection {
                    instance: Some(*key),
                    ..*selection
                })
            });
        self.walked = Some(walked);
        next
    }
}
