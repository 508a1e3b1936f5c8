//! What a reader knows of one instance: its state, its writers, and how often it has come back to life
//! (DDS 1.4 section 2.2.2.5.1 and figure 2.11).

use std::time::Instant;

use super::entries::List;
use super::rules::Precedents;
use super::{InstanceState, ViewState};
use crate::wire::{Guid, KeyHash};

#[derive(Debug)]
pub(super) struct Instance {
    pub(super) key: KeyHash,
    pub(super) state: InstanceState,
    pub(super) view: ViewState,
    pub(super) disposed_generation: u32,
    pub(super) no_writers_generation: u32,
    /// Its samples, oldest first.
    pub(super) samples: List,
    /// How many of them have data.
    pub(super) valid_count: usize,
    /// When data arrived last.
    pub(super) updated: Instant,
    /// Whether it has a deadline.
    pub(super) watched: bool,
    /// Whether it waits in the cache's list of instances that may go when room is needed.
    pub(super) listed_idle: bool,
    /// How many of its samples a collection in the making has so far, and the generation of the newest.
    pub(super) collected: (u32, u32),
    /// What the reader's rules, if it has any, have to know of it.
    pub(super) precedents: Option<Box<Precedents>>,
    writers: Vec<Guid>,
}

impl Instance {
    pub(super) fn new(key: KeyHash, now: Instant) -> Self {
        Self {
            key,
            state: InstanceState::Alive,
            view: ViewState::New,
            disposed_generation: 0,
            no_writers_generation: 0,
            samples: List::default(),
            valid_count: 0,
            updated: now,
            watched: false,
            listed_idle: false,
            collected: (0, 0),
            precedents: None,
            writers: Vec::new(),
        }
    }

    /// Data came from `writer`: the instance is alive, perhaps again.
    pub(super) fn written(&mut self, writer: Guid, now: Instant) {
        self.updated = now;
        self.register(writer);
        match self.state {
            InstanceState::Alive => return,
            InstanceState::NotAliveDisposed => {
                self.disposed_generation = self.disposed_generation.saturating_add(1);
            }
            InstanceState::NotAliveNoWriters => {
                self.no_writers_generation = self.no_writers_generation.saturating_add(1);
            }
        }
        self.state = InstanceState::Alive;
        self.view = ViewState::New;
    }

    /// `writer` disposed the instance; returns whether that is news.
    pub(super) fn dispose(&mut self, writer: Guid) -> bool {
        self.register(writer);
        let was_alive = self.state != InstanceState::NotAliveDisposed;
        self.state = InstanceState::NotAliveDisposed;
        was_alive
    }

    /// `writer` does not write the instance any more; returns whether that makes it not alive.
    pub(super) fn unregister(&mut self, writer: Guid) -> bool {
        let Some(position) = self.position(writer) else {
            return false;
        };
        self.writers.swap_remove(position);
        let orphaned = self.writers.is_empty() && self.state == InstanceState::Alive;
        if orphaned {
            self.state = InstanceState::NotAliveNoWriters;
        }
        orphaned
    }

    /// Whether nothing would be lost by forgetting it.
    pub(super) fn is_over(&self) -> bool {
        self.samples.is_empty() && self.writers.is_empty() && self.state != InstanceState::Alive
    }

    /// Whether little would be lost by forgetting it: only its generation counts.
    pub(super) fn is_idle(&self) -> bool {
        self.samples.is_empty() && self.state != InstanceState::Alive
    }

    pub(super) fn generation(&self) -> u32 {
        self.disposed_generation
            .wrapping_add(self.no_writers_generation)
    }

    fn position(&self, writer: Guid) -> Option<usize> {
        self.writers.iter().position(|known| *known == writer)
    }

    /// Who writes it.
    pub(super) fn writers(&self) -> &[Guid] {
        &self.writers
    }

    /// `writer` writes it. Writers take turns rarely, so the last one is looked at first.
    pub(super) fn register(&mut self, writer: Guid) {
        match self.position(writer) {
            Some(0) => {}
            Some(position) => self.writers.swap(0, position),
            None => {
                self.writers.push(writer);
                let last = self.writers.len() - 1;
                self.writers.swap(0, last);
            }
        }
    }
}
