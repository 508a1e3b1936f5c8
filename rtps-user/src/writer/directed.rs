//! What goes to one reader alone: answers to its requests, and reminders.

use std::time::Instant;

use super::outbox::Source;
use super::{Packet, ReaderProxy, Writer};
use crate::Transmit;
use crate::wire::{EntityId, Guid, Heartbeat, SequenceNumber};

impl Writer {
    /// Puts a reader into the queue of those to be sent something, or sets the timer that will do it.
    pub(super) fn enqueue(&mut self, now: Instant, reader: Guid) {
        let Some(proxy) = self.readers.get_mut(&reader) else {
            return;
        };
        if proxy.is_queued || proxy.outbox.is_empty() {
            return;
        }
        match proxy.outbox.not_before().filter(|due| *due > now) {
            Some(due) => {
                self.next_answer = Some(self.next_answer.map_or(due, |next| next.min(due)));
            }
            None => {
                proxy.is_queued = true;
                self.queue.push_back(reader);
            }
        }
    }

    /// Enqueues the readers whose answers have waited long enough.
    pub(super) fn enqueue_due(&mut self, now: Instant) {
        if self.next_answer.take_if(|due| *due <= now).is_none() {
            return;
        }
        let waiting = |proxy: &&ReaderProxy| proxy.outbox.not_before().is_some();
        let readers = self.readers.values().filter(waiting);
        let readers: Vec<Guid> = readers.map(ReaderProxy::guid).collect();
        self.look_for_shared();
        for reader in readers {
            let proxy = self.readers.get(&reader);
            if proxy.is_some_and(|proxy| proxy.outbox.not_before() <= Some(now)) {
                self.refill(reader);
            }
            self.enqueue(now, reader);
        }
    }

    /// A reader has answered or waited long enough to be sent more.
    pub(super) fn refill(&mut self, reader: Guid) {
        let budget = self.repair_budget();
        if let Some(proxy) = self.readers.get_mut(&reader) {
            proxy.outbox.refill(budget);
        }
    }

    /// Bytes that one reader alone may be sent at once: with what all are sent, they shall fit its inbox.
    pub(super) fn repair_budget(&self) -> usize {
        (self.window.size() / 2).max(1)
    }

    /// The next datagram for a single reader.
    pub(super) fn poll_directed(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        while let Some(reader) = self.queue.front().copied() {
            if let Some(transmit) = self.fill_directed(now, reader, out) {
                return Some(transmit);
            }
            self.queue.pop_front();
            if let Some(proxy) = self.readers.get_mut(&reader) {
                proxy.is_queued = false;
                if proxy.outbox.is_paused() {
                    self.enqueue(now, reader);
                }
            }
        }
        self.handle_selected_sent();
        None
    }

    /// What the writer has that concerns a reader for which changes from `start` on do; ids and count are filled in
    /// elsewhere.
    pub(super) fn heartbeat(&self, start: SequenceNumber) -> Heartbeat {
        let end = self.live.end();
        let first = self.history.first().map_or(end, |first| first.min(end));
        let first = first.max(start).min(end);
        Heartbeat {
            reader: EntityId::UNKNOWN,
            writer: EntityId::UNKNOWN,
            first,
            last: end.previous(),
            count: 0,
            is_final: false,
            liveliness: false,
            group: self.heartbeat_group(first),
        }
    }

    /// The HEARTBEAT that greets a reader, for one who puts it into a datagram with other things; the writer does not
    /// send it then.
    pub fn greeting(&mut self, now: Instant, reader: Guid) -> Heartbeat {
        let count = match self.readers.get_mut(&reader) {
            Some(proxy) => {
                proxy.outbox.announced();
                self.heartbeats
                    .next_count_to(now, &mut proxy.heartbeat_count)
            }
            None => self.heartbeats.next_count(now),
        };
        Heartbeat {
            reader: reader.entity,
            writer: self.config.guid.entity,
            count,
            ..self.heartbeat(SequenceNumber(1))
        }
    }

    fn fill_directed(&mut self, now: Instant, reader: Guid, out: &mut Vec<u8>) -> Option<Transmit> {
        let proxy = self.readers.get_mut(&reader)?;
        if proxy.outbox.is_empty() {
            return None;
        }
        let source = Source {
            history: &self.history,
            start: proxy.start(),
            end: self.live.end(),
            interest: &proxy.interest,
        };
        let layout = self.layout.clone();
        let filter_info = proxy.interest.filter_info();
        let mut packet =
            Packet::directed(out, &layout, reader).with_bare_key(proxy.interest.bare_key());
        if let Some(info) = &filter_info {
            packet.set_filter_info(info);
        }
        let timing = &self.config.timing;
        let is_filled = proxy.outbox.fill(now, &source, timing, &mut packet);
        if is_filled && proxy.outbox.wants_heartbeat() && packet.has_room_for_heartbeat() {
            let is_empty = proxy.outbox.announced();
            let is_final = is_empty || !proxy.lags_behind(self.live.end());
            let start = proxy.start();
            let count = self
                .heartbeats
                .next_count_to(now, &mut proxy.heartbeat_count);
            let mut heartbeat = self.heartbeat(start);
            if is_empty {
                (heartbeat.first, heartbeat.last) = (start, start.previous());
            }
            packet.heartbeat(Heartbeat {
                is_final,
                count,
                ..heartbeat
            });
        }
        if !packet.finish() {
            return None;
        }
        let destinations = self.readers.get(&reader)?.address().clone();
        Some(Transmit {
            destinations,
            dscp: self.dscp,
        })
    }
}
