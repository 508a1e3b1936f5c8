//! Which changes of an instance count for a reader that is not interested in all: OWNERSHIP, TIME_BASED_FILTER and
//! DESTINATION_ORDER (DDS 1.4 sections 2.2.3.9, 2.2.3.12 and 2.2.3.17). Readers with the defaults have no rules.
//!
//! A change that does not count is acknowledged like any other, and not lost. The order of the rules: an instance's
//! owner alone is heard; what is older than what the application knows is of no use; what comes too soon waits.

use std::time::Instant;

use super::InstanceState;
use super::change::Change;
use super::entries::Entry;
use super::instance::Instance;
use super::ownership::Strengths;
use super::separation::Separation;
use super::source_order::{SourceOrder, Stamp};
use crate::qos::{DestinationOrder, Ownership, Qos};
use crate::wire::{Guid, Timestamp};

/// What becomes of a change of an instance that is there.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Verdict {
    /// It counts.
    Counts,
    /// It counts, but was written before others that are there already.
    Late,
    /// It comes too soon after the last one.
    TooSoon,
    /// It does not count. Only that its writer writes the instance, or does not any more, does.
    Overlooked,
}

/// The rules of a reader.
#[derive(Debug)]
pub(super) struct Rules {
    pub(super) strengths: Option<Strengths>,
    pub(super) separation: Option<Separation>,
    pub(super) source_order: Option<SourceOrder>,
}

/// What the rules have to know of an instance.
#[derive(Debug, Default)]
pub(super) struct Precedents {
    /// Who owns it.
    pub(super) owner: Option<Guid>,
    /// When the last sample that counted came.
    pub(super) passed: Option<Instant>,
    /// The newest sample that came too soon after that.
    pub(super) withheld: Option<Change>,
    /// The newest change that counted.
    pub(super) newest: Option<Stamp>,
    /// The newest sample that the application has seen, or cannot see any more.
    pub(super) seen: Option<Stamp>,
}

impl Rules {
    /// Those that a reader has, if any.
    pub(super) fn new(qos: &Qos) -> Option<Box<Self>> {
        let rules = Self {
            strengths: matches!(qos.ownership, Ownership::Exclusive { .. })
                .then(Strengths::default),
            separation: Separation::new(qos),
            source_order: (qos.destination_order == DestinationOrder::BySourceTimestamp)
                .then(|| SourceOrder::new(qos)),
        };
        let has_any =
            rules.strengths.is_some() || rules.separation.is_some() || rules.source_order.is_some();
        has_any.then(|| Box::new(rules))
    }

    /// Takes over changed policies, of which only TIME_BASED_FILTER may change.
    pub(super) fn set_qos(&mut self, qos: &Qos) {
        match &mut self.separation {
            Some(separation) => separation.set_qos(qos),
            None => self.separation = Separation::new(qos),
        }
    }

    /// What becomes of a change.
    pub(super) fn judge(&self, instance: &Instance, change: &Change) -> Verdict {
        let Some(precedents) = instance.precedents.as_deref() else {
            return Verdict::Counts;
        };
        if let Some(strengths) = &self.strengths
            && !strengths.admits(change.writer, precedents.owner)
        {
            return Verdict::Overlooked;
        }
        let verdict = match self.stamp(change.timestamp, change.writer) {
            Some(stamp) => SourceOrder::judge(precedents, stamp, change),
            None => Verdict::Counts,
        };
        let is_ordinary =
            change.valid_data && !change.status.disposed && instance.state == InstanceState::Alive;
        match (&self.separation, verdict) {
            (Some(separation), Verdict::Counts | Verdict::Late)
                if is_ordinary && separation.is_too_soon(precedents.passed, change.reception) =>
            {
                // What is older than what is withheld will never be wanted.
                match verdict {
                    Verdict::Counts => Verdict::TooSoon,
                    _ => Verdict::Overlooked,
                }
            }
            _ => verdict,
        }
    }

    /// Notes a change that counts, now or later.
    pub(super) fn note(&self, instance: &mut Instance, change: &Change) {
        let precedents = instance.precedents.get_or_insert_default();
        let only_unregisters = !change.valid_data && !change.status.disposed;
        if self.strengths.is_some() && !only_unregisters {
            precedents.owner = Some(change.writer);
        }
        if let Some(stamp) = self.stamp(change.timestamp, change.writer) {
            precedents.newest = precedents.newest.max(Some(stamp));
        }
    }

    /// The application has seen a sample, or cannot see it any more.
    pub(super) fn note_seen(&self, instance: &mut Instance, entry: &Entry) {
        if let Some(stamp) = self.stamp(entry.timestamp, entry.writer) {
            let precedents = instance.precedents.get_or_insert_default();
            precedents.seen = precedents.seen.max(Some(stamp));
        }
    }

    /// A writer does not write an instance any more.
    pub(super) fn give_up(&self, instance: &mut Instance, writer: Guid) {
        let Some(strengths) = &self.strengths else {
            return;
        };
        let heir = strengths.strongest(instance.writers());
        if let Some(precedents) = instance.precedents.as_deref_mut()
            && precedents.owner == Some(writer)
        {
            precedents.owner = heir;
        }
    }

    /// When something was written, where that counts.
    pub(super) fn stamp(&self, timestamp: Option<Timestamp>, writer: Guid) -> Option<Stamp> {
        self.source_order.as_ref()?;
        Stamp::new(timestamp, writer)
    }
}
