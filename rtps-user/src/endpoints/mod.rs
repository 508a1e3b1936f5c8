//! All writers and readers of one app, driven as one.
//!
//! Methods are of four kinds: getters; commands (`add_*`, `match_remote`, ... and what `writer_mut` and
//! `reader_mut` lead to); inputs (`handle_*`); outputs (`poll_*`). After commands and inputs, call
//! [`poll_transmit`](Endpoints::poll_transmit) until it gives nothing, then take the events, and sleep until
//! [`poll_timeout`](Endpoints::poll_timeout).

mod dispatch;
mod endpoint;
mod event;
mod matched;
mod schedule;
#[cfg(test)]
mod tests;

pub use event::EndpointEvent;

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::time::Instant;

use endpoint::{Endpoint, Scheduled};
use matched::Match;
use schedule::{Mark, Schedule};

use crate::reader::{Reader, ReaderConfig};
use crate::wire::{EntityId, Guid, GuidPrefix};
use crate::writer::{Writer, WriterConfig};
use crate::{RemoteEndpoint, Transmit};

/// The endpoints of one app.
#[derive(Debug)]
pub struct Endpoints {
    prefix: GuidPrefix,
    endpoints: BTreeMap<EntityId, Scheduled>,
    /// Each matched remote endpoint.
    matched: HashMap<Guid, Match>,
    foreign: u64,
    schedule: Schedule,
    events: VecDeque<EndpointEvent>,
}

impl Endpoints {
    /// None yet; all will belong to the participant `prefix`.
    pub fn new(prefix: GuidPrefix) -> Self {
        Self {
            prefix,
            endpoints: BTreeMap::new(),
            matched: HashMap::new(),
            foreign: 0,
            schedule: Schedule::default(),
            events: VecDeque::new(),
        }
    }

    /// The participant that the endpoints belong to.
    pub fn prefix(&self) -> GuidPrefix {
        self.prefix
    }

    /// How many submessages were not taken because they came from an address that is not their sender's.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }

    /// Adds a writer; one with the same id is replaced.
    pub fn add_writer(&mut self, config: WriterConfig) {
        let id = config.guid.entity;
        self.add(id, Endpoint::Writer(Box::new(Writer::new(config))));
    }

    /// Adds a reader; one with the same id is replaced.
    pub fn add_reader(&mut self, config: ReaderConfig) {
        let id = config.guid.entity;
        self.add(id, Endpoint::Reader(Box::new(Reader::new(config))));
    }

    /// Removes a writer or reader.
    pub fn remove(&mut self, id: EntityId) {
        let Some(mut scheduled) = self.endpoints.remove(&id) else {
            return;
        };
        self.schedule.forget(id, &mut scheduled.mark);
        let remotes: Vec<Guid> = match &scheduled.endpoint {
            Endpoint::Writer(writer) => writer.matched_readers().collect(),
            Endpoint::Reader(reader) => reader.matched_writers().collect(),
        };
        for remote in remotes {
            self.forget_match(remote, id);
        }
    }

    /// A writer.
    pub fn writer(&self, id: EntityId) -> Option<&Writer> {
        self.endpoints.get(&id)?.endpoint.as_writer()
    }

    /// A writer, which is polled after that.
    pub fn writer_mut(&mut self, id: EntityId) -> Option<&mut Writer> {
        self.touched(id)?.as_writer_mut()
    }

    /// A reader.
    pub fn reader(&self, id: EntityId) -> Option<&Reader> {
        self.endpoints.get(&id)?.endpoint.as_reader()
    }

    /// A reader, which is polled after that.
    pub fn reader_mut(&mut self, id: EntityId) -> Option<&mut Reader> {
        self.touched(id)?.as_reader_mut()
    }

    /// Matches a local endpoint with a remote one, or updates what is known of a matched one.
    pub fn match_remote(&mut self, now: Instant, local: EntityId, remote: &RemoteEndpoint) {
        match self.touched(local) {
            Some(Endpoint::Writer(writer)) => writer.match_reader(now, remote),
            Some(Endpoint::Reader(reader)) => reader.match_writer(now, remote),
            None => return,
        }
        let matched = self.matched.entry(remote.guid).or_default();
        matched.insert(local, &remote.addresses);
    }

    /// Ends a match.
    pub fn unmatch(&mut self, now: Instant, local: EntityId, remote: Guid) {
        match self.touched(local) {
            Some(Endpoint::Writer(writer)) => writer.unmatch_reader(remote),
            Some(Endpoint::Reader(reader)) => reader.unmatch_writer(now, remote),
            None => return,
        }
        self.forget_match(remote, local);
    }

    /// A participant asserted the liveliness of its MANUAL_BY_PARTICIPANT or AUTOMATIC writers (RTPS 8.4.13).
    pub fn handle_liveliness(&mut self, now: Instant, participant: GuidPrefix, manual: bool) {
        for (id, scheduled) in &mut self.endpoints {
            if let Some(reader) = scheduled.endpoint.as_reader_mut() {
                reader.handle_liveliness(now, participant, manual);
                self.schedule.touch(*id, &mut scheduled.mark);
            }
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        for id in self.schedule.dirty().collect::<Vec<_>>() {
            self.rearm(id);
        }
        while let Some(id) = self.schedule.pop_due(now) {
            if let Some(scheduled) = self.endpoints.get_mut(&id) {
                Schedule::popped(&mut scheduled.mark);
                scheduled.endpoint.handle_timeout(now);
                self.schedule.touch(id, &mut scheduled.mark);
            }
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let dirty = self.schedule.dirty();
        dirty
            .filter_map(|id| self.endpoints.get(&id)?.endpoint.poll_timeout())
            .chain(self.schedule.deadline())
            .min()
    }

    /// Writes the next datagram to be sent into `out`, which it empties first.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        while let Some(id) = self.schedule.front() {
            let scheduled = self.endpoints.get_mut(&id);
            let transmit = scheduled.and_then(|s| s.endpoint.poll_transmit(now, out));
            if transmit.is_some() {
                self.schedule.rotate();
                return transmit;
            }
            self.collect_events(id);
            self.rearm(id);
            let mark = self.endpoints.get_mut(&id).map(|s| &mut s.mark);
            self.schedule.settle_front(mark);
        }
        None
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<EndpointEvent> {
        if self.events.is_empty() {
            for index in 0..self.schedule.dirty_len() {
                if let Some(id) = self.schedule.dirty_at(index) {
                    self.collect_events(id);
                }
            }
        }
        self.events.pop_front()
    }

    fn add(&mut self, id: EntityId, endpoint: Endpoint) {
        self.remove(id);
        let mark = Mark::default();
        self.endpoints.insert(id, Scheduled { endpoint, mark });
    }

    fn touched(&mut self, id: EntityId) -> Option<&mut Endpoint> {
        let scheduled = self.endpoints.get_mut(&id)?;
        self.schedule.touch(id, &mut scheduled.mark);
        Some(&mut scheduled.endpoint)
    }

    fn collect_events(&mut self, id: EntityId) {
        if let Some(scheduled) = self.endpoints.get_mut(&id) {
            while let Some(event) = scheduled.endpoint.poll_event(id) {
                self.events.push_back(event);
            }
        }
    }

    fn rearm(&mut self, id: EntityId) {
        if let Some(scheduled) = self.endpoints.get_mut(&id) {
            let deadline = scheduled.endpoint.poll_timeout();
            self.schedule.arm(id, &mut scheduled.mark, deadline);
        }
    }

    fn forget_match(&mut self, remote: Guid, local: EntityId) {
        if let Entry::Occupied(mut matched) = self.matched.entry(remote)
            && matched.get_mut().remove(local)
        {
            matched.remove();
        }
    }
}
