//! TIME_BASED_FILTER: at most one sample of each instance in a period (DDS 1.4 section 2.2.3.12).
//!
//! The period counts from the reception, because it is this reader that is to be spared. When a writer falls silent,
//! a RELIABLE reader gets the last sample all the same, at the end of the period; that and all that ends an instance's
//! life are never filtered.

use std::time::{Duration, Instant};

use super::cache::Cache;
use super::change::Change;
use super::events::Events;
use super::timers::Timers;
use crate::qos::Qos;
use crate::wire::KeyHash;

#[derive(Debug)]
pub(super) struct Separation {
    minimum: Duration,
    keeps_last: bool,
    /// When what is withheld of an instance is to be given out.
    pub(super) due: Timers<KeyHash>,
}

impl Separation {
    /// `None` for a reader that wants all samples.
    pub(super) fn new(qos: &Qos) -> Option<Self> {
        let minimum = Self::minimum(qos);
        (minimum > Duration::ZERO).then(|| Self {
            minimum,
            keeps_last: qos.reliability.is_reliable(),
            due: Timers::default(),
        })
    }

    /// Takes over a changed period; what is withheld stays so until it is due.
    pub(super) fn set_qos(&mut self, qos: &Qos) {
        self.minimum = Self::minimum(qos);
    }

    fn minimum(qos: &Qos) -> Duration {
        let minimum = qos.time_based_filter.0.to_std();
        minimum.unwrap_or(Duration::MAX)
    }

    /// Whether a sample comes too soon after the last that passed.
    pub(super) fn is_too_soon(&self, passed: Option<Instant>, now: Instant) -> bool {
        passed.is_some_and(|passed| now.saturating_duration_since(passed) < self.minimum)
    }
}

impl Cache {
    /// Keeps a sample back that came too soon, in place of one before it.
    pub(super) fn withhold(&mut self, place: u32, change: Change) {
        let instance = &mut self.instances[place];
        instance.register(change.writer);
        instance.updated = change.reception;
        let Some(rules) = self.rules.as_mut() else {
            return;
        };
        rules.note(instance, &change);
        let Some(separation) = rules.separation.as_mut().filter(|rule| rule.keeps_last) else {
            return;
        };
        let precedents = instance.precedents.get_or_insert_default();
        let passed = precedents.passed.unwrap_or(change.reception);
        let is_first = precedents.withheld.replace(change).is_none();
        if is_first && let Some(at) = passed.checked_add(separation.minimum) {
            separation.due.set(instance.key, at);
        }
    }

    /// Takes what is withheld of an instance.
    pub(super) fn take_withheld(&mut self, place: u32) -> Option<Change> {
        let separation = self.rules.as_mut()?.separation.as_mut()?;
        let instance = &mut self.instances[place];
        let withheld = instance.precedents.as_mut()?.withheld.take()?;
        separation.due.cancel(instance.key);
        Some(withheld)
    }

    /// Gives out the last samples of the instances whose writers have fallen silent.
    pub(super) fn give_out_due(&mut self, now: Instant, events: &mut Events) {
        while let Some(key) = self.pop_due(now) {
            if let Some(place) = self.instances.find(key) {
                self.give_out(now, place, events);
            }
        }
    }

    fn pop_due(&mut self, now: Instant) -> Option<KeyHash> {
        let separation = self.rules.as_mut()?.separation.as_mut()?;
        separation.due.pop(now)
    }

    /// Gives out what is withheld of an instance, if anything; where there is no room, after one more period.
    pub(super) fn give_out(&mut self, now: Instant, place: u32, events: &mut Events) {
        let Some(change) = self.take_withheld(place) else {
            return;
        };
        if change.expiry().is_some_and(|at| at <= now) {
            return;
        }
        let precedents = self.instances[place].precedents.get_or_insert_default();
        precedents.passed = Some(now);
        if self.has_room(place).is_ok() {
            self.store_sample(place, change);
            events.data_available();
        } else {
            self.withhold(place, change);
        }
    }

    /// When [`give_out_due`](Self::give_out_due) has something to do.
    pub(super) fn next_due(&self) -> Option<Instant> {
        self.rules.as_ref()?.separation.as_ref()?.due.next()
    }
}
