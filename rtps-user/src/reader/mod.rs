//! The reader side of RTPS: stateful readers of both reliabilities with their cache (RTPS 2.5 section 8.4.11,
//! DDS 1.4 section 2.2.2.5).
//!
//! Submessages go in with the writer that they come from and the time; datagrams with ACKNACKs and NACK_FRAGs,
//! events and samples come out. The way of a sample: [`Reader::handle_data`] finds the writer's proxy
//! (`writer_proxy`), which lets it through in order, into the cache (`cache`), from where [`Reader::take`]
//! hands it out (`access`). What comes in fragments goes through `reassembly` first.

mod access;
mod acknack;
mod admission;
mod cache;
mod change;
mod coherent;
mod config;
mod entries;
mod event;
mod events;
mod groups;
mod heartbeat_filter;
mod held;
mod instance;
mod lifecycle;
mod liveliness;
mod ownership;
mod query;
mod ranges;
mod reassembly;
mod repair_time;
mod rules;
mod sample;
mod separation;
mod source_order;
mod staging;
#[cfg(test)]
mod tests;
mod timers;
mod walk;
mod writer_proxy;

pub use config::{InstanceOf, ReaderConfig, ReaderTiming};
pub use event::{ReaderEvent, RejectedReason};
pub use groups::GroupSet;
pub use sample::{
    InstanceState, Mask, Sample, SampleInfo, SampleState, Selection, State, ViewState,
};

use std::collections::BTreeSet;
use std::time::Instant;

use crate::filter::PayloadFilter;
use crate::qos::Qos;
use crate::table::Table;
use crate::wire::{
    Data, DataFrag, FilterSignature, Gap, Guid, GuidPrefix, Heartbeat, HeartbeatFrag,
    SequenceNumber, Timestamp,
};
use crate::{RemoteEndpoint, Transmit};
use cache::Cache;
use change::{Arrival, Payload};
use events::Events;
use liveliness::{Sign, Watch};
use reassembly::Progress;
use timers::Timers;
use writer_proxy::WriterProxy;

/// What is to be sent to a writer.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
enum Message {
    /// The ACKNACK that asks for its first HEARTBEAT.
    Greeting,
    /// What it is to know or to repeat.
    Answer,
}

/// A reader with its proxies of matched writers and its cache.
#[derive(Debug)]
pub struct Reader {
    config: ReaderConfig,
    proxies: Table<Guid, WriterProxy>,
    cache: Cache,
    events: Events,
    messages: Timers<(Guid, Message)>,
    watch: Watch,
    /// Writers for whose next change the cache had no room.
    blocked: BTreeSet<Guid>,
    /// The greatest count of an ACKNACK or NACK_FRAG to a writer that is matched no more. Those to new matches go on
    /// from there, so that a writer that comes back, or never noticed that it was gone, takes none for old.
    count: i32,
    /// When the last change came, for what happens without a clock at hand.
    now: Option<Instant>,
}

impl Reader {
    /// A reader without writers.
    pub fn new(config: ReaderConfig) -> Self {
        Self {
            cache: Cache::new(&config),
            config,
            proxies: Table::default(),
            events: Events::default(),
            messages: Timers::default(),
            watch: Watch::default(),
            blocked: BTreeSet::new(),
            count: 0,
            now: None,
        }
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.config.guid
    }

    /// Its policies.
    pub fn qos(&self) -> &Qos {
        &self.config.qos
    }

    /// Changes policies that may change (DDS 1.4 section 2.2.3), for what arrives from now on.
    pub fn set_qos(&mut self, qos: Qos) {
        self.cache.set_qos(&qos);
        self.config.qos = qos;
    }

    /// Sets or changes the content filter, for what arrives from now on, and the signature of the one that is announced, if it is
    /// the same.
    pub fn set_content_filter(
        &mut self,
        filter: Option<PayloadFilter>,
        signature: Option<FilterSignature>,
    ) {
        self.cache.is_filtered = filter.is_some();
        self.config.content_filter = filter;
        self.config.filter_signature = signature;
    }

    /// Matches a writer, or takes over the changed locators and policies of a matched one.
    pub fn match_writer(&mut self, now: Instant, remote: &RemoteEndpoint) {
        self.cache.writer_known(remote.guid, remote.qos.ownership);
        if let Some(proxy) = self.proxies.get_mut(remote.guid) {
            proxy.update(remote);
            self.watch.follow(remote.guid, &proxy.lease);
            return;
        }
        let mut proxy = WriterProxy::new(now, &self.config, remote);
        proxy.responder.resume(self.count);
        self.watch
            .begin(remote.guid, &proxy.lease, &mut self.events);
        if proxy.is_reliable() {
            self.messages.set((remote.guid, Message::Greeting), now);
        }
        self.proxies.insert(remote.guid, proxy);
    }

    /// Forgets a writer; what is held of it because something before it is missing, or because there was no
    /// room, is lost.
    pub fn unmatch_writer(&mut self, now: Instant, writer: Guid) {
        let Some(mut proxy) = self.proxies.remove(writer) else {
            return;
        };
        self.messages.cancel((writer, Message::Greeting));
        self.messages.cancel((writer, Message::Answer));
        self.blocked.remove(&writer);
        self.count = self.count.max(proxy.responder.count());
        self.events.lost(writer, proxy.held_count() as u64);
        if let Some(sets) = &mut proxy.sets {
            sets.drop_open(&mut self.cache, &mut self.events);
        }
        self.watch.end(writer, &proxy.lease, &mut self.events);
        self.cache.writer_unknown(now, writer, &mut self.events);
    }

    /// Whether a writer is matched.
    pub fn is_matched(&self, writer: Guid) -> bool {
        self.proxies.get(writer).is_some()
    }

    /// Whether samples wait for room, which taking others makes.
    pub fn is_blocked(&self) -> bool {
        !self.blocked.is_empty()
    }

    /// The matched writers, in no particular order.
    pub fn matched_writers(&self) -> impl Iterator<Item = Guid> + '_ {
        self.proxies.keys()
    }

    /// DATA of a writer, with the source timestamp that the message said before it.
    pub fn handle_data(
        &mut self,
        now: Instant,
        writer: Guid,
        timestamp: Option<Timestamp>,
        data: &Data<'_>,
    ) {
        let Some(place) = self.heard(now, writer, Sign::Writer) else {
            return;
        };
        let proxy = &mut self.proxies[place];
        if !proxy.wants(data.sequence, data.payload.len()) {
            return;
        }
        let arrival = Arrival {
            writer,
            sequence: data.sequence,
            timestamp,
            reception: now,
            inline_qos: &data.inline_qos,
            filters: data.filters,
            kind: data.kind,
        };
        self.receive(place, &arrival, Payload::Borrowed(data.payload), None);
    }

    /// DATA_FRAG of a writer, with the source timestamp that the message said before it.
    pub fn handle_data_frag(
        &mut self,
        now: Instant,
        writer: Guid,
        timestamp: Option<Timestamp>,
        data: &DataFrag<'_>,
    ) {
        let Some(place) = self.heard(now, writer, Sign::Writer) else {
            return;
        };
        let proxy = &mut self.proxies[place];
        if !proxy.wants(data.sequence, data.sample_size as usize) {
            return;
        }
        if data.sample_size as usize > self.config.max_sample_size {
            // Waiting for it would hold up all that follows.
            proxy.lose(data.sequence, &mut self.cache, &mut self.events);
            return;
        }
        proxy.note_size(data.sample_size as usize);
        let assembled = match proxy.reassembly.add(now, timestamp, data) {
            Progress::Complete(assembled) => assembled,
            Progress::Repaired(asked) => {
                proxy.responder.measured(now, asked);
                return self.answer(now, writer);
            }
            Progress::Incomplete => return,
        };
        let arrival = Arrival {
            writer,
            sequence: data.sequence,
            timestamp: assembled.timestamp,
            reception: now,
            inline_qos: &assembled.inline_qos,
            filters: None,
            kind: assembled.kind,
        };
        let payload = Payload::Owned(assembled.payload);
        self.receive(place, &arrival, payload, assembled.asked);
    }

    /// GAP of a writer.
    pub fn handle_gap(&mut self, now: Instant, writer: Guid, gap: &Gap) {
        let Some(place) = self.heard(now, writer, Sign::Protocol) else {
            return;
        };
        let proxy = &mut self.proxies[place];
        proxy.gap(gap, &mut self.cache, &mut self.events);
        if proxy.is_blocked() {
            self.blocked.insert(writer);
        }
        let next = proxy.next();
        if proxy.responder.completes_below(now, next) && proxy.lacks_something() {
            self.answer(now, writer);
        }
    }

    /// HEARTBEAT of a writer.
    pub fn handle_heartbeat(&mut self, now: Instant, writer: Guid, heartbeat: &Heartbeat) {
        let sign = if heartbeat.liveliness {
            Sign::Writer
        } else {
            Sign::Protocol
        };
        let Some(place) = self.heard(now, writer, sign) else {
            return;
        };
        let proxy = &mut self.proxies[place];
        let validity = self.config.timing.heartbeat_count_validity;
        if !proxy.is_reliable() || !proxy.filter.is_new(now, heartbeat.count, validity) {
            return;
        }
        if !proxy.has_heard() {
            self.messages.cancel((writer, Message::Greeting));
        }
        let is_answered = proxy.heartbeat(heartbeat, &mut self.cache, &mut self.events);
        if proxy.is_blocked() {
            self.blocked.insert(writer);
        }
        if is_answered {
            self.answer(now, writer);
        }
    }

    /// HEARTBEAT_FRAG of a writer.
    pub fn handle_heartbeat_frag(&mut self, now: Instant, writer: Guid, heartbeat: &HeartbeatFrag) {
        let Some(place) = self.heard(now, writer, Sign::Protocol) else {
            return;
        };
        let proxy = &mut self.proxies[place];
        let (sequence, last) = (heartbeat.sequence, heartbeat.last_fragment);
        if proxy.is_reliable() && proxy.reassembly.announce(sequence, last) {
            self.answer(now, writer);
        }
    }

    /// A participant asserts the liveliness of its AUTOMATIC writers, or (`manual`) of those that its
    /// application asserts by participant (RTPS 2.5 section 8.4.13.5).
    pub fn handle_liveliness(&mut self, now: Instant, participant: GuidPrefix, manual: bool) {
        let sign = if manual {
            Sign::Participant
        } else {
            Sign::Protocol
        };
        for (_, proxy) in self.proxies.iter_mut() {
            let writer = proxy.guid;
            if writer.prefix == participant {
                self.watch
                    .heard(now, writer, &mut proxy.lease, sign, &mut self.events);
            }
        }
    }

    /// All changes of a writer below `next` are dealt with, though they have not come here.
    pub fn skip_to(&mut self, writer: Guid, next: SequenceNumber) {
        if let Some(proxy) = self.proxies.get_mut(writer) {
            proxy.skip_to(next, &mut self.cache, &mut self.events);
        }
    }

    /// Does what is due but needs no datagram: leases, deadlines, and what becomes of samples as time passes. Samples
    /// are up to date after that, so it comes before they are read or taken.
    pub fn handle_timeout(&mut self, now: Instant) {
        while let Some(writer) = self.watch.pop(now) {
            let Some(proxy) = self.proxies.get_mut(writer) else {
                continue;
            };
            if self
                .watch
                .check(now, writer, &mut proxy.lease, &mut self.events)
            {
                self.cache.writer_gone(now, writer, &mut self.events);
            }
        }
        self.cache.handle_timeout(now, &mut self.events);
        if !self.blocked.is_empty() {
            self.now = Some(now);
            self.release();
        }
    }

    /// When to call [`handle_timeout`](Self::handle_timeout) and [`poll_transmit`](Self::poll_transmit) at the
    /// latest; may lie in the past.
    pub fn poll_timeout(&self) -> Option<Instant> {
        [
            self.messages.next(),
            self.watch.next(),
            self.cache.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Appends the next datagram that is due, if any, to `out`.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        let start = out.len();
        while let Some((writer, message)) = self.messages.pop(now) {
            let Some(proxy) = self.proxies.get_mut(writer) else {
                continue;
            };
            let (sent, again) = match message {
                Message::Greeting => (true, proxy.greet(now, &self.config, out)),
                Message::Answer => proxy.respond(now, &self.config, out),
            };
            if let Some(at) = again {
                self.messages.set((writer, message), at);
            }
            if sent && let Some(destinations) = proxy.destinations.clone() {
                return Some(Transmit {
                    destinations,
                    dscp: 0,
                });
            }
            out.truncate(start);
        }
        None
    }

    /// What has happened, oldest first but DATA_AVAILABLE before all.
    pub fn poll_event(&mut self) -> Option<ReaderEvent> {
        self.events.pop()
    }

    /// Goes on with a writer, matched just now, where an earlier run of this reader stopped: at change `next`,
    /// counting ACKNACKs and NACK_FRAGs on from `count`. With `next` at most 1 only the counts go on.
    pub fn resume_from(&mut self, writer: Guid, next: SequenceNumber, count: i32) {
        if let Some(proxy) = self.proxies.get_mut(writer) {
            proxy.resume(next, count);
        }
    }

    /// Greets a matched writer at that time, unless it has been heard until then.
    pub fn greet_at(&mut self, at: Instant, writer: Guid) {
        self.messages.set((writer, Message::Greeting), at);
    }

    /// The number below which all changes of a matched writer have been received, or will not come.
    pub fn progress(&self, writer: Guid) -> Option<SequenceNumber> {
        self.proxies.get(writer).map(WriterProxy::next)
    }

    /// Whether all has come that a matched writer had to repeat for this reader, as its first HEARTBEAT since the match
    /// says; so has what nobody keeps for those that come late.
    pub fn has_history_of(&self, writer: Guid) -> bool {
        let proxy = self.proxies.get(writer);
        proxy.is_some_and(WriterProxy::has_history)
    }

    /// Whether all history has come of all writers that are matched now (`wait_for_historical_data`).
    pub fn is_history_complete(&self) -> bool {
        self.proxies
            .keys()
            .all(|writer| self.has_history_of(writer))
    }

    /// Something has come from a writer; returns the place of its proxy.
    fn heard(&mut self, now: Instant, writer: Guid, sign: Sign) -> Option<u32> {
        let place = self.proxies.find(writer)?;
        let proxy = &mut self.proxies[place];
        self.now = Some(now);
        self.watch
            .heard(now, writer, &mut proxy.lease, sign, &mut self.events);
        proxy.responder.heard();
        Some(place)
    }

    /// Takes in a change that is wanted, of which fragments may have been asked for at that time.
    fn receive(
        &mut self,
        place: u32,
        arrival: &Arrival<'_>,
        payload: Payload<'_>,
        asked: Option<Instant>,
    ) {
        let (now, writer, sequence) = (arrival.reception, arrival.writer, arrival.sequence);
        let proxy = &mut self.proxies[place];
        proxy.receive(
            &self.config,
            arrival,
            payload,
            &mut self.cache,
            &mut self.events,
        );
        if proxy.is_blocked() {
            self.blocked.insert(writer);
        }
        if let Some(asked) = asked {
            proxy.responder.measured(now, asked);
        }
        let completes = proxy.responder.completes(now, sequence);
        if (completes || asked.is_some()) && proxy.lacks_something() {
            self.answer(now, writer);
        }
    }

    /// Answers a writer, together with what else there may be to answer until then.
    fn answer(&mut self, now: Instant, writer: Guid) {
        let at = now + self.config.timing.heartbeat_response_delay;
        self.messages.set_earlier((writer, Message::Answer), at);
    }

    /// Lets changes in that there was no room for, and tells their writers at once, because they may be waiting
    /// for it.
    fn release(&mut self) {
        let Some(now) = self.now else {
            return;
        };
        for writer in std::mem::take(&mut self.blocked) {
            let Some(proxy) = self.proxies.get_mut(writer) else {
                continue;
            };
            let moved = proxy.advance(&mut self.cache, &mut self.events);
            if proxy.is_blocked() {
                self.blocked.insert(writer);
            }
            if moved {
                proxy.responder.request();
                let delay = if proxy.is_blocked() {
                    self.config.timing.nack_suppression
                } else {
                    self.config.timing.heartbeat_response_delay
                };
                self.messages
                    .set_earlier((writer, Message::Answer), now + delay);
            }
        }
    }
}
