//! Whether there is room for a change, and where: HISTORY, RESOURCE_LIMITS and the reader's rules
//! (DDS 1.4 sections 2.2.3.18 and 2.2.3.19).

use super::RejectedReason;
use super::cache::Cache;
use super::change::Change;
use super::instance::Instance;
use super::rules::{Rules, Verdict};
use crate::qos::{History, Qos};

/// Instances that a reader without max_instances keeps.
const MAX_INSTANCES: usize = 1 << 20;

/// Where the cache will put a change that it has room for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Place {
    /// With an instance that is there.
    Instance(u32),
    /// With an instance yet to be made.
    NewInstance,
    /// With an instance, before what was written after it.
    Late(u32),
    /// With an instance, unless a later one comes soon.
    Withheld(u32),
    /// With the other changes of its coherent set.
    Set,
    /// Nowhere: of the instance only its writer counts.
    Overlooked(u32),
    /// Nowhere: it changes nothing.
    Nowhere,
}

/// HISTORY and RESOURCE_LIMITS as numbers.
#[derive(Debug)]
pub(super) struct Limits {
    pub(super) depth: Option<usize>,
    samples: usize,
    pub(super) instances: usize,
    pub(super) samples_per_instance: usize,
}

impl Limits {
    pub(super) fn new(qos: &Qos) -> Self {
        let number = |limit: Option<u32>| limit.map_or(usize::MAX, |limit| limit as usize);
        let samples_per_instance = number(qos.resource_limits.max_samples_per_instance);
        Self {
            depth: match qos.history {
                History::KeepLast(depth) => Some((depth as usize).min(samples_per_instance).max(1)),
                History::KeepAll => None,
            },
            samples: number(qos.resource_limits.max_samples),
            instances: number(qos.resource_limits.max_instances).min(MAX_INSTANCES),
            samples_per_instance,
        }
    }

    /// Whether there are limits beside max_samples.
    pub(super) fn bounds_instances(&self) -> bool {
        let is_bounded = self.samples_per_instance != usize::MAX && self.depth.is_none();
        is_bounded || self.instances != MAX_INSTANCES
    }
}

impl Cache {
    /// Looks for room for a change.
    pub(super) fn admit(&mut self, change: &Change) -> Result<Place, RejectedReason> {
        let Some(instance) = self.instances.find(change.instance) else {
            return self.admit_instance(change);
        };
        let place = match self.verdict(instance, change) {
            Verdict::Counts => Place::Instance(instance),
            Verdict::Late => Place::Late(instance),
            Verdict::TooSoon => return Ok(Place::Withheld(instance)),
            Verdict::Overlooked => return Ok(Place::Overlooked(instance)),
        };
        if change.valid_data {
            self.has_room(instance)?;
        }
        Ok(place)
    }

    fn verdict(&self, place: u32, change: &Change) -> Verdict {
        let Some(rules) = &self.rules else {
            return Verdict::Counts;
        };
        let instance = &self.instances[place];
        match rules.judge(instance, change) {
            Verdict::Late if self.is_outlived(rules, instance, change) => Verdict::Overlooked,
            verdict => verdict,
        }
    }

    /// Whether HISTORY has only room for samples that were written later.
    fn is_outlived(&self, rules: &Rules, instance: &Instance, change: &Change) -> bool {
        let is_full = self
            .limits
            .depth
            .is_some_and(|depth| instance.valid_count >= depth);
        let stamp = rules.stamp(change.timestamp, change.writer);
        let mut samples = self.entries.siblings(instance.samples);
        is_full
            && samples
                .find(|oldest| oldest.valid_data)
                .is_some_and(|oldest| stamp < rules.stamp(oldest.timestamp, oldest.writer))
    }

    /// Whether there is room for one more sample of an instance.
    pub(super) fn has_room(&self, instance: u32) -> Result<(), RejectedReason> {
        let count = self.instances[instance].valid_count;
        match self.limits.depth {
            Some(depth) if count >= depth => Ok(()),
            None if count >= self.limits.samples_per_instance => {
                Err(RejectedReason::SamplesPerInstance)
            }
            _ => self.admit_sample(),
        }
    }

    pub(super) fn admit_sample(&self) -> Result<(), RejectedReason> {
        if self.valid_count + self.staged >= self.limits.samples {
            return Err(RejectedReason::Samples);
        }
        Ok(())
    }

    fn admit_instance(&mut self, change: &Change) -> Result<Place, RejectedReason> {
        let only_unregisters = !change.valid_data && !change.status.disposed;
        if only_unregisters || (self.is_filtered && !change.valid_data) {
            return Ok(Place::Nowhere);
        }
        if change.valid_data {
            self.admit_sample()?;
        }
        if self.instances.len() >= self.limits.instances && !self.forget_idle() {
            return Err(RejectedReason::Instances);
        }
        Ok(Place::NewInstance)
    }

    /// Forgets the instance that has been idle for longest; false when there is none.
    fn forget_idle(&mut self) -> bool {
        while let Some(key) = self.idle.pop_front() {
            let Some(place) = self.instances.find(key) else {
                continue;
            };
            self.instances[place].listed_idle = false;
            if self.instances[place].is_idle() {
                self.forget(key);
                return true;
            }
        }
        false
    }
}
