//! What stays of a TRANSIENT or PERSISTENT writer's past for readers to come (DDS 1.4 section 2.2.3.5).
//!
//! There is no durability service but the writer itself, as long as it lives. DURABILITY_SERVICE says what it keeps of the
//! changes that all present readers have: where there are too many, the oldest go. The default of the policy leaves that to
//! HISTORY and RESOURCE_LIMITS, or else a KEEP_ALL writer of whom nobody asked otherwise would keep but one sample.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::Writer;
use crate::history::{ChangeKind, Instance};
use crate::qos::{Durability, DurabilityService, History, Qos};
use crate::wire::SequenceNumber;

/// The limits of the past, and what is about to leave it.
#[derive(Debug)]
pub(super) struct Service {
    depth: usize,
    max_samples: usize,
    max_instances: usize,
    /// `None` means never.
    cleanup_delay: Option<Duration>,
    /// The changes up to this one have been counted.
    counted: SequenceNumber,
    /// Unregistrations, and when their instances go.
    leaving: VecDeque<(Option<Instant>, SequenceNumber)>,
}

impl Service {
    /// The one that a writer with such policies has to be.
    pub(super) fn new(qos: &Qos) -> Option<Box<Self>> {
        let DurabilityService {
            cleanup_delay,
            history,
            resource_limits: limits,
        } = qos.durability_service;
        let is_needed = qos.durability >= Durability::Transient
            && qos.durability_service != DurabilityService::default();
        let number = |limit: Option<u32>| limit.map_or(usize::MAX, |limit| limit as usize);
        is_needed.then(|| {
            Box::new(Self {
                depth: match history {
                    History::KeepLast(depth) => depth.max(1) as usize,
                    History::KeepAll => number(limits.max_samples_per_instance),
                },
                max_samples: number(limits.max_samples),
                max_instances: number(limits.max_instances),
                cleanup_delay: cleanup_delay.to_std(),
                counted: SequenceNumber::ZERO,
                leaving: VecDeque::new(),
            })
        })
    }

    /// When the next instance goes.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.leaving.front()?.0
    }
}

impl Writer {
    /// Remembers that an instance's changes may go once its unregistration has been acknowledged and the cleanup delay has
    /// passed: nobody may rely on an instance without writers.
    pub(super) fn note_unregistration(
        &mut self,
        now: Instant,
        kind: ChangeKind,
        sequence: SequenceNumber,
    ) {
        if !kind.status_info().unregistered || !self.keeps_past() {
            return;
        }
        match &mut self.service {
            Some(service) => {
                let delay = service.cleanup_delay;
                let due = delay.and_then(|delay| now.checked_add(delay));
                service.leaving.push_back((due, sequence));
            }
            None => self.unregistered.push_back(sequence),
        }
    }

    /// Lets the instances go whose time has come; gives whether there were any.
    pub(super) fn clean_up(&mut self, now: Instant) -> bool {
        let Some(service) = &mut self.service else {
            return false;
        };
        let before = self.unregistered.len();
        while let Some((_, sequence)) = service
            .leaving
            .pop_front_if(|(due, _)| due.is_some_and(|due| due <= now))
        {
            self.unregistered.push_back(sequence);
        }
        self.unregistered.len() > before
    }

    /// Lets an instance go before its time that all readers know to be gone, because the writer has no room for another.
    pub(super) fn clean_up_early(&mut self, done: SequenceNumber) -> bool {
        let leaving = self.service.as_mut().map(|service| &mut service.leaving);
        let next = leaving.and_then(|leaving| leaving.pop_front_if(|(_, front)| *front <= done));
        self.unregistered.extend(next.map(|(_, sequence)| sequence));
        next.is_some()
    }

    /// Drops what is too much of the changes up to `done`.
    pub(super) fn limit_past(&mut self, done: SequenceNumber) {
        let Some(service) = &mut self.service else {
            return;
        };
        while let Some((sequence, change)) = self.history.next_from(service.counted.next())
            && sequence <= done
        {
            service.counted = sequence;
            let instance = change.instance;
            let is_sample = !change.ends_set();
            while let Some(Instance { len, oldest, .. }) = self.history.instance(instance)
                && is_sample
                && len > service.depth
                && oldest <= sequence
            {
                self.history.remove(oldest);
            }
        }
        let (samples, instances) = (service.max_samples, service.max_instances);
        while (self.history.samples() > samples || self.history.instances() > instances)
            && let Some(oldest) = self.oldest_sample().filter(|oldest| *oldest <= done)
        {
            self.history.remove(oldest);
        }
    }
}
