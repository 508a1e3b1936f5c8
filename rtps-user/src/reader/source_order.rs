//! DESTINATION_ORDER BY_SOURCE_TIMESTAMP: the order of writing, in which every reader ends with the same value
//! (DDS 1.4 section 2.2.3.17).
//!
//! A sample that was written before one that the application has seen is dropped; one that was written before others
//! that still wait takes its place before them.

use super::change::Change;
use super::entries::{Entries, Entry, List};
use super::rules::{Precedents, Verdict};
use crate::qos::{PresentationScope, Qos};
use crate::wire::{Guid, Timestamp};

/// When and by whom something was written: what was written at the same time is in the order of its writers.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(super) struct Stamp {
    timestamp: Timestamp,
    writer: Guid,
}

impl Stamp {
    /// `None` for what says not when it was written: it counts as the newest.
    pub(super) fn new(timestamp: Option<Timestamp>, writer: Guid) -> Option<Self> {
        timestamp.map(|timestamp| Self { timestamp, writer })
    }
}

/// The order of a reader's samples.
#[derive(Debug)]
pub(super) struct SourceOrder {
    /// Whether it holds between instances, too (PRESENTATION).
    spans_instances: bool,
}

impl SourceOrder {
    pub(super) fn new(qos: &Qos) -> Self {
        let presentation = qos.presentation;
        Self {
            spans_instances: presentation.ordered
                && presentation.scope != PresentationScope::Instance,
        }
    }

    /// What becomes of a change of that stamp. The state of an instance is what its newest change says.
    pub(super) fn judge(precedents: &Precedents, stamp: Stamp, change: &Change) -> Verdict {
        if precedents.newest.is_none_or(|newest| newest <= stamp) {
            Verdict::Counts
        } else if change.valid_data && precedents.seen.is_none_or(|seen| seen < stamp) {
            Verdict::Late
        } else {
            Verdict::Overlooked
        }
    }

    /// Adds a sample before what was written after it; returns its place.
    pub(super) fn insert(&self, entries: &mut Entries, siblings: &mut List, entry: Entry) -> u32 {
        let Some(stamp) = Stamp::new(entry.timestamp, entry.writer) else {
            return entries.push(siblings, entry);
        };
        let (sibling, arrival) = self.successors(entries, *siblings, stamp);
        entries.insert(siblings, entry, sibling, arrival)
    }

    fn successors(
        &self,
        entries: &Entries,
        siblings: List,
        stamp: Stamp,
    ) -> (Option<u32>, Option<u32>) {
        let is_newer = |place: &u32| {
            let entry = entries.get(*place);
            Stamp::new(entry.timestamp, entry.writer).is_some_and(|other| other > stamp)
        };
        let sibling = entries.siblings_back(siblings).take_while(is_newer).last();
        let arrival = if self.spans_instances {
            entries.arrivals_back().take_while(is_newer).last()
        } else {
            sibling
        };
        (sibling, arrival)
    }
}
