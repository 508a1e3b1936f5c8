//! Which changes the history takes and keeps: HISTORY, RESOURCE_LIMITS and DURABILITY (DDS 1.4 sections 2.2.3.18,
//! 2.2.3.19 and 2.2.3.4).

use super::heartbeat::Sent;
use super::{WriteError, Writer};
use crate::history::{CacheChange, Instance, NewChange};
use crate::qos::{Durability, History, Qos};
use crate::wire::SequenceNumber;

impl Writer {
    /// Makes room for a change, or says why there is none.
    pub(super) fn make_room(&mut self, change: &NewChange) -> Result<(), WriteError> {
        if u32::try_from(change.payload.len()).is_err() {
            return Err(WriteError::TooLarge(change.payload.len()));
        }
        let limits = self.config.qos.resource_limits;
        let registry = self.registry.as_ref();
        if registry.is_some_and(|known| known.is_full_for(change.instance, limits.max_instances)) {
            return Err(WriteError::OutOfResources);
        }
        let instance = self.history.instance(change.instance);
        if instance.is_none() && is_reached(self.history.instances(), limits.max_instances) {
            // Others have been unregistered, which readers have not acknowledged yet.
            self.make_room_for_instance(limits.max_instances)?;
        }
        match (self.config.qos.history, instance) {
            (History::KeepLast(depth), Some(instance)) => {
                let depth = self.depth(depth) as usize;
                self.history.replace_in(instance, depth);
            }
            (History::KeepLast(_), None) => {}
            (History::KeepAll, _) if !self.has_window() => return Err(WriteError::HistoryFull),
            (History::KeepAll, Some(Instance { len, oldest, .. }))
                if is_reached(len, limits.max_samples_per_instance) =>
            {
                self.give_up(Some(oldest))?;
            }
            (History::KeepAll, _) => {}
        }
        if is_reached(self.history.samples(), limits.max_samples) {
            self.give_up(self.oldest_sample())?;
        }
        Ok(())
    }

    /// How many changes KEEP_LAST keeps of an instance: what DURABILITY_SERVICE asks for where that is more.
    fn depth(&self, depth: u32) -> u32 {
        let Qos {
            durability,
            durability_service: service,
            ..
        } = &self.config.qos;
        let of_service = match service.history {
            _ if *durability < Durability::Transient => 0,
            History::KeepLast(depth) => depth,
            History::KeepAll => {
                let limit = service.resource_limits.max_samples_per_instance;
                limit.unwrap_or(u32::MAX)
            }
        };
        depth.max(of_service).max(1)
    }

    /// Whether changes stay for late joiners once everybody has them.
    pub(super) fn keeps_past(&self) -> bool {
        self.config.qos.durability != Durability::Volatile
    }

    /// Drops what nobody needs any more.
    pub(super) fn release(&mut self) {
        let done = self.done();
        if self.keeps_past() {
            self.release_unregistered(done);
            self.limit_past(done);
            self.drop_set_ends(done);
        } else {
            while self.history.pop_through(done).is_some() {}
        }
    }

    /// What a HEARTBEAT may wait for: less than fits, or else a history with a limit would fill up before its readers
    /// are asked for acknowledgements.
    pub(super) fn sent_per_heartbeat(&self) -> Sent {
        const PER_WINDOW: usize = 4;
        let limits = self.config.qos.resource_limits;
        let changes = match self.config.qos.history {
            History::KeepLast(_) => u32::MAX,
            History::KeepAll => [limits.max_samples, limits.max_samples_per_instance]
                .into_iter()
                .flatten()
                .fold(u32::MAX, |changes, limit| changes.min(limit / 4)),
        };
        Sent {
            changes,
            weight: (self.window.size() / PER_WINDOW) as u64,
            flushes: self.config.timing.heartbeat_samples,
        }
    }

    /// The last change that has been sent and that all reliable readers have acknowledged.
    fn done(&self) -> SequenceNumber {
        let live = self.live.end();
        let unsent = self.selection.unsent_from();
        let unsent = unsent.map_or(live, |unsent| unsent.min(live));
        self.acknowledged().min(unsent.previous())
    }

    /// Drops instances that nobody writes any more and all readers know to be gone.
    fn make_room_for_instance(&mut self, max: Option<u32>) -> Result<(), WriteError> {
        while is_reached(self.history.instances(), max) {
            if !self.clean_up_early(self.done()) {
                return Err(WriteError::HistoryFull);
            }
            self.release();
        }
        Ok(())
    }

    /// The oldest change that counts.
    pub(super) fn oldest_sample(&self) -> Option<SequenceNumber> {
        let mut oldest = self.history.first();
        while let Some(sequence) = oldest
            && self
                .history
                .get(sequence)
                .is_some_and(CacheChange::ends_set)
        {
            let next = self.history.next_from(sequence.next());
            oldest = next.map(|(next, _)| next);
        }
        oldest
    }

    /// Drops a change that all have, though late joiners might still want it.
    fn give_up(&mut self, oldest: Option<SequenceNumber>) -> Result<(), WriteError> {
        match oldest {
            Some(oldest) if oldest <= self.done() => {
                self.history.remove(oldest);
                Ok(())
            }
            _ => Err(WriteError::HistoryFull),
        }
    }

    /// Whether the readers are near enough to take more.
    fn has_window(&mut self) -> bool {
        let Some(base) = self.window_base else {
            return true;
        };
        self.window.admits(self.history.weight_from(base))
    }

    /// Whether the next change has to wait until there is room in the window.
    pub(super) fn fills_window(&self) -> bool {
        let weight = self.window_base.map(|base| self.history.weight_from(base));
        let is_full = weight.is_some_and(|weight| weight >= self.window.size() as u64);
        is_full && self.config.qos.history == History::KeepAll
    }

    fn release_unregistered(&mut self, done: SequenceNumber) {
        while let Some(sequence) = self.unregistered.pop_front_if(|front| *front <= done) {
            let Some(instance) = self.history.get(sequence).map(|change| change.instance) else {
                continue;
            };
            let list = self.history.instance(instance);
            if list.is_some_and(|list| list.newest == sequence) {
                while let Some(Instance { oldest, .. }) = self.history.instance(instance) {
                    self.history.remove(oldest);
                }
            }
        }
    }
}

fn is_reached(len: usize, limit: Option<u32>) -> bool {
    limit.is_some_and(|limit| len >= limit as usize)
}
