//! All writers and readers of one app, driven as one.
//!
//! Methods are of four kinds: getters; commands (`add_*`, `match_remote`, ... and what `writer_mut` and
//! `reader_mut` lead to); inputs (`handle_*`); outputs (`poll_*`). After commands and inputs, call
//! [`poll_transmit`](Endpoints::poll_transmit) until it gives nothing, then take the events, and sleep until
//! [`poll_timeout`](Endpoints::poll_timeout).

mod dispatch;
mod endpoint;
mod event;
mod liveliness;
mod matched;
mod schedule;
#[cfg(test)]
mod tests;

pub use event::EndpointEvent;

use std::collections::VecDeque;
use std::time::Instant;

use endpoint::{Endpoint, Scheduled};
use matched::{Local, Match};
use schedule::{Mark, Schedule};

use crate::reader::{Reader, ReaderConfig, Sample, Selection};
use crate::table::Table;
use crate::wire::{EntityId, Guid, GuidPrefix};
use crate::writer::{Writer, WriterConfig};
use crate::{OwnKeys, RemoteEndpoint, Transmit};

/// The endpoints of one app.
#[derive(Debug)]
pub struct Endpoints {
    prefix: GuidPrefix,
    endpoints: Table<EntityId, Scheduled, OwnKeys>,
    /// Each matched remote endpoint.
    matched: Table<Guid, Match>,
    foreign: u64,
    schedule: Schedule,
    events: VecDeque<EndpointEvent>,
    /// When the readers of MANUAL_BY_PARTICIPANT writers were told last that these are alive.
    shared: Option<Instant>,
}

impl Endpoints {
    /// None yet; all will belong to the participant `prefix`.
    pub fn new(prefix: GuidPrefix) -> Self {
        Self {
            prefix,
            endpoints: Table::default(),
            matched: Table::default(),
            foreign: 0,
            schedule: Schedule::default(),
            events: VecDeque::new(),
            shared: None,
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
        let Some(place) = self.endpoints.find(id) else {
            return;
        };
        let Some(mut scheduled) = self.endpoints.remove(id) else {
            return;
        };
        self.schedule.forget(place, &mut scheduled.mark);
        let remotes: Vec<Guid> = match &scheduled.endpoint {
            Endpoint::Writer(writer) => writer.matched_readers().collect(),
            Endpoint::Reader(reader) => reader.matched_writers().collect(),
        };
        for remote in remotes {
            self.forget_match(remote, id);
        }
        if shares_liveliness(&scheduled.endpoint) {
            self.refresh_sharing();
        }
    }

    /// A writer.
    pub fn writer(&self, id: EntityId) -> Option<&Writer> {
        self.endpoints.get(id)?.endpoint.as_writer()
    }

    /// A writer, which is polled after that.
    pub fn writer_mut(&mut self, id: EntityId) -> Option<&mut Writer> {
        self.touched(id)?.as_writer_mut()
    }

    /// A reader.
    pub fn reader(&self, id: EntityId) -> Option<&Reader> {
        self.endpoints.get(id)?.endpoint.as_reader()
    }

    /// A reader, which is polled after that.
    pub fn reader_mut(&mut self, id: EntityId) -> Option<&mut Reader> {
        self.touched(id)?.as_reader_mut()
    }

    /// Takes the next sample out of a reader. Only where there had been no room in the reader is it polled after that.
    pub fn take_next(&mut self, reader: EntityId, selection: &Selection) -> Option<Sample> {
        let place = self.endpoints.find(reader)?;
        let scheduled = self.endpoints.at_mut(place)?;
        let reader = scheduled.endpoint.as_reader_mut()?;
        if reader.is_blocked() {
            self.schedule.touch(place, &mut scheduled.mark);
        }
        reader.take_next(selection)
    }

    /// Matches a local endpoint with a remote one, or updates what is known of a matched one.
    pub fn match_remote(&mut self, now: Instant, local: EntityId, remote: &RemoteEndpoint) {
        match self.touched(local) {
            Some(Endpoint::Writer(writer)) => writer.match_reader(now, remote),
            Some(Endpoint::Reader(reader)) => reader.match_writer(now, remote),
            None => return,
        }
        let Some(place) = self.endpoints.find(local) else {
            return;
        };
        if self.matched.find(remote.guid).is_none() {
            self.matched.insert(remote.guid, Match::default());
        }
        if let Some(matched) = self.matched.get_mut(remote.guid) {
            matched.insert(Local { id: local, place }, &remote.addresses);
        }
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
        for (place, scheduled) in self.endpoints.iter_mut() {
            if let Some(reader) = scheduled.endpoint.as_reader_mut() {
                reader.handle_liveliness(now, participant, manual);
                self.schedule.touch(place, &mut scheduled.mark);
            }
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        for index in 0..self.schedule.dirty_len() {
            if let Some(place) = self.schedule.dirty_at(index) {
                self.rearm(place);
            }
        }
        while let Some(place) = self.schedule.pop_due(now) {
            self.share_liveliness(now, place);
            if let Some(scheduled) = self.endpoints.at_mut(place) {
                Schedule::popped(&mut scheduled.mark);
                scheduled.endpoint.handle_timeout(now);
                self.schedule.touch(place, &mut scheduled.mark);
            }
        }
    }

    /// Whether nothing is to be sent, told or done at `now`: the `poll_*` methods have given all that there was.
    #[inline]
    pub fn is_settled(&self, now: Instant) -> bool {
        self.schedule.dirty_len() == 0
            && self.events.is_empty()
            && self.schedule.deadline().is_none_or(|due| due > now)
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        if self.schedule.dirty_len() == 0 {
            return self.schedule.deadline();
        }
        let dirty = self.schedule.dirty();
        dirty
            .filter_map(|place| self.endpoints[place].endpoint.poll_timeout())
            .chain(self.schedule.deadline())
            .min()
    }

    /// Appends the next datagram to be sent to `out`; `None`, and `out` as before, where there is none.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        let start = out.len();
        while let Some(place) = self.schedule.front() {
            let scheduled = &mut self.endpoints[place];
            let transmit = scheduled.endpoint.poll_transmit(now, out);
            if transmit.is_some() {
                self.schedule.rotate();
                return transmit;
            }
            out.truncate(start);
            scheduled.collect_events(&mut self.events);
            let deadline = scheduled.endpoint.poll_timeout();
            self.schedule.arm(place, &mut scheduled.mark, deadline);
            self.schedule.settle_front(&mut scheduled.mark);
        }
        None
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<EndpointEvent> {
        if self.events.is_empty() {
            for index in 0..self.schedule.dirty_len() {
                if let Some(place) = self.schedule.dirty_at(index) {
                    self.endpoints[place].collect_events(&mut self.events);
                }
            }
        }
        let event = self.events.pop_front()?;
        match event {
            // Several may have been due at once.
            EndpointEvent::Asserted { at } if !self.note_shared(at) => self.poll_event(),
            event => Some(event),
        }
    }

    fn add(&mut self, id: EntityId, endpoint: Endpoint) {
        self.remove(id);
        let mark = Mark::default();
        let shares = shares_liveliness(&endpoint);
        let scheduled = Scheduled { id, endpoint, mark };
        self.endpoints.insert(id, scheduled);
        if shares {
            self.refresh_sharing();
        }
    }

    fn touched(&mut self, id: EntityId) -> Option<&mut Endpoint> {
        let place = self.endpoints.find(id)?;
        let scheduled = self.endpoints.at_mut(place)?;
        self.schedule.touch(place, &mut scheduled.mark);
        Some(&mut scheduled.endpoint)
    }

    fn rearm(&mut self, place: u32) {
        let scheduled = &mut self.endpoints[place];
        let deadline = scheduled.endpoint.poll_timeout();
        self.schedule.arm(place, &mut scheduled.mark, deadline);
    }

    fn forget_match(&mut self, remote: Guid, local: EntityId) {
        if let Some(matched) = self.matched.get_mut(remote)
            && matched.remove(local)
        {
            self.matched.remove(remote);
        }
    }
}

fn shares_liveliness(endpoint: &Endpoint) -> bool {
    let writer = endpoint.as_writer();
    writer.is_some_and(Writer::is_asserted_by_others)
}
