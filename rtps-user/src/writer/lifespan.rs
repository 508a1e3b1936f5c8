//! LIFESPAN: changes leave the history when they have expired (DDS 1.4 section 2.2.3.16).
//!
//! The time runs from the moment of writing, whatever source timestamp the app gives a change: the protocol core has no
//! time of day. A policy that is changed concerns what is written afterwards.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::history::HistoryCache;
use crate::wire::SequenceNumber;

/// When changes expire.
#[derive(Clone, Debug, Default)]
pub(super) struct Expiry {
    lifespan: Option<Duration>,
    /// In order of time. Changes may have left the history for another reason.
    due: VecDeque<(Instant, SequenceNumber)>,
}

impl Expiry {
    /// So many entries more than changes are not worth clearing away.
    const FEW: usize = 64;

    pub(super) fn new(lifespan: Option<Duration>) -> Self {
        Self {
            lifespan,
            due: VecDeque::new(),
        }
    }

    pub(super) fn set_lifespan(&mut self, lifespan: Option<Duration>) {
        self.lifespan = lifespan;
    }

    /// A change was taken into the history.
    pub(super) fn watch(&mut self, now: Instant, sequence: SequenceNumber, history: &HistoryCache) {
        let Some(at) = self.lifespan.and_then(|lifespan| now.checked_add(lifespan)) else {
            return;
        };
        // Behind all others, unless the lifespan has become shorter.
        let place = self.due.partition_point(|(due, _)| *due <= at);
        self.due.insert(place, (at, sequence));
        if self.due.len() > 2 * history.len() + Self::FEW {
            self.due
                .retain(|(_, watched)| history.get(*watched).is_some());
        }
    }

    /// When the next change expires.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.due.front().map(|(at, _)| *at)
    }

    /// Takes expired changes out of the history; gives whether there were any.
    pub(super) fn expire(&mut self, now: Instant, history: &mut HistoryCache) -> bool {
        let mut has_expired = false;
        while let Some((_, sequence)) = self.due.pop_front_if(|(at, _)| *at <= now) {
            has_expired |= history.remove(sequence).is_some();
        }
        has_expired
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.due.len()
    }
}
