//! Room in the cache for coherent sets, and their way into it.

use std::collections::{HashMap, HashSet};

use super::RejectedReason;
use super::cache::Cache;
use super::change::Change;
use super::events::Events;
use crate::wire::KeyHash;

impl Cache {
    /// Whether max_samples leaves room for one more change that waits with its set.
    pub(super) fn has_room_for_staged(&self) -> Result<(), RejectedReason> {
        self.admit_sample()
    }

    /// Whether nothing that the application could take would make room.
    pub(super) fn is_drained(&self) -> bool {
        self.valid_count == 0
    }

    /// Whether there is room for all changes of a set, for each of which max_samples has been kept free.
    pub(super) fn fits(&mut self, changes: &[Change]) -> Result<(), RejectedReason> {
        if !self.limits.bounds_instances() {
            return Ok(());
        }
        let (mut counts, mut new) = (HashMap::<KeyHash, usize>::new(), HashSet::new());
        for change in changes.iter().filter(|change| change.valid_data) {
            let key = change.instance;
            let present = self.instances.get(key).map(|instance| instance.valid_count);
            if present.is_none() {
                new.insert(key);
            }
            let count = counts.entry(key).or_insert_with(|| present.unwrap_or(0));
            *count += 1;
            if self.limits.depth.is_none() && *count > self.limits.samples_per_instance {
                return Err(RejectedReason::SamplesPerInstance);
            }
        }
        let busy = self.instances.len().saturating_sub(self.idle.len());
        if busy + new.len() > self.limits.instances {
            return Err(RejectedReason::Instances);
        }
        Ok(())
    }

    /// Makes the changes of a set visible.
    pub(super) fn publish(&mut self, changes: Vec<Change>, events: &mut Events) {
        for change in changes {
            self.staged -= 1;
            match self.admit(&change) {
                Ok(place) => self.store(place, change, events),
                Err(reason) => events.rejected(change.writer, change.instance, reason),
            }
        }
    }
}
