//! The readers that a writer serves.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::time::Instant;

use super::{Layout, ReaderProxy, Writer, WriterConfig};
use crate::RemoteEndpoint;
use crate::qos::Durability;
use crate::qos::parameters::write_inline_qos;
use crate::wire::{Guid, ParameterWriter, SequenceNumber};

impl Writer {
    /// Begins to serve a reader, or takes in new locators of a reader that is served already.
    pub fn match_reader(&mut self, now: Instant, remote: &RemoteEndpoint) {
        match self.readers.get_mut(&remote.guid) {
            Some(proxy) => proxy.update(remote),
            None => self.add_reader(now, remote),
        }
        self.refresh_readers();
    }

    /// Forgets a reader; what only that one has not acknowledged need not be kept any more.
    pub fn unmatch_reader(&mut self, reader: Guid) {
        if self.readers.remove(&reader).is_some() {
            self.queue.retain(|queued| *queued != reader);
            self.refresh_readers();
            self.handle_progress();
        }
    }

    /// The matched readers.
    pub fn matched_readers(&self) -> impl Iterator<Item = Guid> + '_ {
        self.readers.keys().copied()
    }

    fn add_reader(&mut self, now: Instant, remote: &RemoteEndpoint) {
        let is_reliable =
            self.config.qos.reliability.is_reliable() && remote.qos.reliability.is_reliable();
        let wants_past = self.keeps_past() && remote.qos.durability != Durability::Volatile;
        let next = self.live.untouched();
        let start = if wants_past { SequenceNumber(1) } else { next };
        let mut proxy =
            ReaderProxy::new(now, remote, is_reliable, start, next, &self.config.timing);
        proxy.skips_past = self.keeps_past() && !wants_past;
        if is_reliable {
            proxy.outbox.greet(start);
        } else {
            proxy.outbox.replay(start, next);
        }
        proxy.outbox.refill(self.repair_budget());
        if proxy.lags_behind(self.live.end()) {
            self.heartbeats.arm(proxy.next_heartbeat());
        }
        self.readers.insert(remote.guid, proxy);
        self.enqueue(now, remote.guid);
    }

    fn refresh_readers(&mut self) {
        let addresses: BTreeSet<SocketAddr> = self
            .readers
            .values()
            .flat_map(ReaderProxy::addresses)
            .collect();
        self.destinations = addresses.into_iter().collect();
        self.refresh_layout();
        self.refresh_selection();
        self.refresh_acknowledged();
    }

    /// All readers get inline QoS as soon as one of them expects it, because they share datagrams.
    pub(super) fn refresh_layout(&mut self) {
        let topic = self.readers.values().find_map(ReaderProxy::inline_topic);
        if topic.is_none() && !self.layout.has_parameters() {
            return;
        }
        let WriterConfig { guid, qos, .. } = &self.config;
        let layout = Layout::new(*guid, self.config.datagram_size, qos);
        let mut parameters = Vec::new();
        if let Some(topic) = topic {
            write_inline_qos(qos, topic, &mut ParameterWriter::new(&mut parameters));
        }
        self.layout = layout.with_parameters(&parameters);
    }
}
