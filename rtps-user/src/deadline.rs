//! DEADLINE: when instances must have got their next sample (DDS 1.4 section 2.2.3.7).
//!
//! Each watched instance has one entry; samples do not move it. When an entry is due, its owner looks at when
//! the instance was updated and has it watched on from there.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use crate::wire::KeyHash;

/// A period of zero would have instances be due again at once, for ever.
const MIN_PERIOD: Duration = Duration::from_micros(1);

/// The entries of a reader or a writer.
#[derive(Debug, Default)]
pub(crate) struct Deadlines {
    period: Option<Duration>,
    due: BTreeSet<(Instant, KeyHash)>,
}

impl Deadlines {
    /// Sets the period; instances already watched keep their next deadline.
    pub(crate) fn set_period(&mut self, period: Option<Duration>) {
        self.period = period.map(|period| period.max(MIN_PERIOD));
        if period.is_none() {
            self.due.clear();
        }
    }

    /// Watches an instance that has waited since `since`; false when there is no deadline.
    pub(crate) fn watch(&mut self, instance: KeyHash, since: Instant) -> bool {
        let Some(at) = self.period.and_then(|period| since.checked_add(period)) else {
            return false;
        };
        self.due.insert((at, instance));
        true
    }

    /// Whether an instance that was updated at `updated` should have been updated again by now.
    pub(crate) fn is_missed(&self, updated: Instant, now: Instant) -> bool {
        self.period
            .and_then(|period| updated.checked_add(period))
            .is_some_and(|at| at <= now)
    }

    /// When the next entry is due.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.due.first().map(|(at, _)| *at)
    }

    /// Takes an instance whose entry is due.
    pub(crate) fn pop(&mut self, now: Instant) -> Option<KeyHash> {
        let first = *self.due.first()?;
        (first.0 <= now).then(|| {
            self.due.remove(&first);
            first.1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instance_is_not_due_again_at_once() {
        let (instance, now) = (KeyHash::default(), Instant::now());
        let mut deadlines = Deadlines::default();
        deadlines.set_period(Some(Duration::ZERO));
        assert!(deadlines.watch(instance, now));
        assert_eq!(deadlines.pop(now), None);
        let later = now + MIN_PERIOD;
        assert!(deadlines.is_missed(now, later));
        assert_eq!(deadlines.pop(later), Some(instance));
        assert!(deadlines.watch(instance, later));
        assert_eq!(deadlines.pop(later), None);
    }
}
