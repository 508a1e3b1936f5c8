//! The RTPS Writer (RTPS 2.5 sections 8.4.2, 8.4.7 and 8.4.9), stateful for both reliabilities.
//!
//! Two streams of datagrams leave a writer. New changes go to all matched readers at once, to each address once
//! and to no reader in particular (`live.rs`). What only one reader needs, repairs above all, goes to that reader
//! alone (`directed.rs`), unless others wait for the same (`shared.rs`). HEARTBEATs travel with all of them.

mod coherent;
mod config;
mod count;
mod directed;
mod durability_service;
mod fragment_window;
mod group;
mod heartbeat;
mod interest;
mod lifespan;
mod live;
mod liveliness;
mod matching;
mod outbox;
mod packet;
mod position;
mod publication;
mod reader_proxy;
mod registry;
mod requests;
mod retention;
mod selection;
mod shared;
mod suppression;
#[cfg(test)]
mod tests;
mod window;

use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

pub use config::{Refused, WriteError, WriterConfig, WriterEvent, WriterTiming};
pub use group::Group;
pub use interest::BareKey;
pub use packet::FRAGMENT_OVERHEAD;
pub use publication::Publication;

use coherent::CoherentSets;
use durability_service::Service;
use fragment_window::FragmentWindow;
use heartbeat::Heartbeats;
use lifespan::Expiry;
use live::Live;
use liveliness::{Lease, Sign};
use packet::{Layout, Packet};
use position::Position;
use publication::Publisher;
use reader_proxy::{Base, ReaderProxy};
use registry::Registry;
use selection::Selection;
use window::Window;

use crate::Transmit;
use crate::history::{HistoryCache, NewChange};
use crate::qos::{LivelinessKind, Qos};
use crate::wire::{AckNack, Guid, KeyHash, NackFrag, SequenceNumber};

/// A writer, its history and its proxies of matched readers.
#[derive(Debug)]
pub struct Writer {
    config: WriterConfig,
    layout: Layout,
    history: HistoryCache,
    last: SequenceNumber,
    live: Live,
    readers: BTreeMap<Guid, ReaderProxy>,
    /// What its datagrams are marked with.
    dscp: u8,
    /// The addresses of all readers, each once.
    destinations: Arc<[SocketAddr]>,
    /// What all reliable readers have acknowledged; `None` without any.
    lowest_acknowledged: Option<SequenceNumber>,
    window: Window,
    fragment_window: FragmentWindow,
    /// Changes from here on count in the window; `None` without reliable readers.
    window_base: Option<SequenceNumber>,
    heartbeats: Heartbeats,
    sets: CoherentSets,
    selection: Selection,
    expiry: Expiry,
    registry: Option<Box<Registry>>,
    /// What it keeps for readers to come, where DURABILITY_SERVICE says so.
    service: Option<Box<Service>>,
    lease: Lease,
    /// Readers that are to be sent something of their own.
    queue: VecDeque<Guid>,
    /// Whether several of them may wait for the same change.
    may_share: bool,
    /// When the next answer that waits is due.
    next_answer: Option<Instant>,
    /// Unregistrations whose instances are still in the history.
    unregistered: VecDeque<SequenceNumber>,
    events: Events,
    /// Instances of which a deadline has passed.
    missed: VecDeque<KeyHash>,
    /// Where another answers readers as well.
    publisher: Option<Publisher>,
}

/// What [`Writer::poll_event`] has still to tell.
#[derive(Clone, Copy, Debug, Default)]
struct Events {
    acknowledged: bool,
    liveliness_lost: bool,
    asserted: Option<Instant>,
}

impl Writer {
    /// A writer without readers.
    pub fn new(config: WriterConfig) -> Self {
        Self {
            layout: Layout::new(config.guid, config.datagram_size, &config.qos),
            heartbeats: Heartbeats::new(config.timing.count_clock),
            window: Window::new(&config.timing),
            fragment_window: FragmentWindow::new(),
            window_base: None,
            history: HistoryCache::default(),
            last: SequenceNumber::ZERO,
            live: Live::new(),
            readers: BTreeMap::new(),
            dscp: dscp(config.qos.transport_priority),
            destinations: Arc::new([]),
            lowest_acknowledged: None,
            sets: CoherentSets::default(),
            selection: Selection::default(),
            expiry: Expiry::new(config.qos.lifespan.0.to_std()),
            registry: Registry::new(&config.qos),
            service: Service::new(&config.qos),
            lease: Lease::default(),
            queue: VecDeque::new(),
            may_share: false,
            next_answer: None,
            unregistered: VecDeque::new(),
            events: Events::default(),
            missed: VecDeque::new(),
            publisher: None,
            config,
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

    /// Replaces its policies; those that DDS calls unchangeable must stay the same. LIFESPAN and TRANSPORT_PRIORITY apply to
    /// what is written and sent from now on.
    pub fn set_qos(&mut self, qos: Qos) {
        self.expiry.set_lifespan(qos.lifespan.0.to_std());
        match &mut self.registry {
            Some(registry) => registry.set_period(qos.deadline.0.to_std()),
            None => self.registry = Registry::new(&qos),
        }
        self.dscp = dscp(qos.transport_priority);
        self.config.qos = qos;
        self.refresh_layout();
    }

    /// Goes on where an earlier run of the same writer stopped: with the sequence number `next`, and HEARTBEAT
    /// counts above `count`. Only without readers; between writes it leaves numbers out, so that a history can be
    /// filled again with the changes that it had.
    pub fn resume_from(&mut self, next: SequenceNumber, count: i32) {
        self.last = next.previous();
        self.live.skip_to(next);
        self.heartbeats.resume_from(count);
    }

    /// Takes a change into the history; [`poll_transmit`](Self::poll_transmit) sends it at once.
    ///
    /// # Errors
    /// Where the history has no room for it.
    pub fn write(&mut self, now: Instant, change: NewChange) -> Result<SequenceNumber, WriteError> {
        let written = self.write_or_return(now, change, None);
        written.map_err(|refused| refused.error)
    }

    /// As [`write`](Self::write), for a writer of the publisher whose `group` it is, and for one who wants the change back
    /// where it is not taken.
    ///
    /// # Errors
    /// Where the history has no room for it; the group stays as it was.
    pub fn write_or_return(
        &mut self,
        now: Instant,
        change: NewChange,
        group: Option<&mut Group>,
    ) -> Result<SequenceNumber, Refused> {
        if let Err(error) = self.make_room(&change) {
            return Err(Refused { error, change });
        }
        let membership = self.next_membership(group);
        self.last = self.last.next();
        self.note_unregistration(now, change.kind, self.last);
        if let Some(registry) = &mut self.registry {
            registry.note(now, change.instance, change.kind);
        }
        if self.keeps_past() || !self.readers.is_empty() {
            self.history.insert_member(self.last, change, membership);
            self.expiry.watch(now, self.last, &self.history);
        }
        self.skip_without_readers();
        let liveliness = self.config.qos.liveliness;
        self.lease.renew(now, liveliness, Sign::Change);
        Ok(self.last)
    }

    /// Takes a change out of the history; reliable readers that lack it are told that it will not come.
    pub fn remove(&mut self, sequence: SequenceNumber) {
        self.history.remove(sequence);
    }

    /// The number of the newest change; 0 before the first.
    pub fn last_sequence(&self) -> SequenceNumber {
        self.last
    }

    /// Whether every matched reliable reader has acknowledged every change.
    pub fn all_acknowledged(&self) -> bool {
        self.acknowledged_by_all(self.last)
    }

    /// Whether every matched reliable reader has acknowledged the changes up to this one.
    pub fn acknowledged_by_all(&self, sequence: SequenceNumber) -> bool {
        self.acknowledged() >= sequence
    }

    /// Whether a matched reader has acknowledged the changes up to this one; best-effort readers need not.
    pub fn is_acknowledged_by(&self, reader: Guid, sequence: SequenceNumber) -> bool {
        let proxy = self.readers.get(&reader);
        proxy.is_some_and(|proxy| !proxy.is_reliable() || proxy.base().acknowledged >= sequence)
    }

    /// The app asserts that the writer is alive.
    pub fn assert_liveliness(&mut self, now: Instant) {
        let liveliness = self.config.qos.liveliness;
        self.lease.renew(now, liveliness, Sign::Assertion);
        if liveliness.kind == LivelinessKind::ManualByTopic {
            self.live.assert_liveliness();
        }
    }

    /// A reader says what it has and lacks.
    pub fn handle_acknack(&mut self, now: Instant, reader: Guid, acknack: &AckNack) {
        let Some(proxy) = self.readers.get_mut(&reader) else {
            return;
        };
        let before = proxy.base();
        let timing = &self.config.timing;
        if !proxy.handle_acknack(now, acknack, self.live.end(), timing) {
            return;
        }
        if let Some(lost) = proxy.newest_lost(acknack, self.live.end()) {
            self.window.handle_loss(lost, self.live.untouched());
        }
        if !acknack.state.is_empty() {
            self.look_for_shared();
        }
        self.refill(reader);
        self.settle_progress(reader, before);
        self.enqueue(now, reader);
    }

    /// A reader has all changes below `base`, and what it may want has been sent to it by another.
    pub fn acknowledge(&mut self, now: Instant, reader: Guid, base: SequenceNumber) {
        if let Some(proxy) = self.readers.get_mut(&reader) {
            let before = proxy.base();
            proxy.acknowledge(now, base, self.live.end(), &self.config.timing);
            self.settle_progress(reader, before);
        }
    }

    /// The reliable readers that have not acknowledged what they were sent.
    pub fn lagging_readers(&self) -> impl Iterator<Item = Guid> + '_ {
        let lagging = |proxy: &&ReaderProxy| proxy.lags_behind(self.live.end());
        self.readers.values().filter(lagging).map(ReaderProxy::guid)
    }

    /// A reader says which fragments of a change it lacks.
    pub fn handle_nack_frag(&mut self, now: Instant, reader: Guid, nack: &NackFrag) {
        let Some(proxy) = self.readers.get_mut(&reader) else {
            return;
        };
        let Some(last) = nack.missing.iter().last() else {
            proxy.handle_progress(nack.sequence, nack.missing.base);
            return self.advance_fragments(nack.sequence);
        };
        if !self.live.has_sent(nack.sequence, last) {
            return self.go_on(nack.sequence);
        }
        if proxy.handle_nack_frag(now, nack, &self.config.timing) {
            self.window
                .handle_loss(nack.sequence, self.live.untouched());
            self.refill(reader);
            self.enqueue(now, reader);
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.enqueue_due(now);
        self.expire_fragment_window(now);
        if self.heartbeats.expire(now) {
            self.remind_readers(now);
        }
        if self.clean_up(now) {
            self.release();
        }
        if self.expiry.expire(now, &mut self.history) {
            // There is room again.
            self.events.acknowledged = true;
        }
        while let Some(instance) = self.next_missed(now) {
            self.missed.push_back(instance);
        }
        self.events.liveliness_lost |= self.lease.expire(now);
        if self.lease.expire_sharing(now) {
            self.events.asserted = Some(now);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let timers = [
            self.next_answer,
            self.fragment_window.deadline(),
            self.heartbeats.deadline(),
            self.expiry.deadline(),
            self.registry
                .as_ref()
                .and_then(|registry| registry.deadline()),
            self.lease.deadline(),
            self.service.as_ref().and_then(|service| service.deadline()),
        ];
        timers.into_iter().flatten().min()
    }

    /// All that is written is to be sent now, as there will be no time for it later.
    pub fn hurry(&mut self) {
        self.fragment_window.open();
    }

    /// Appends the next datagram to `out`, which stays as it is where there is none. To be called until it gives `None`.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        self.poll_shared(now, out)
            .or_else(|| self.poll_directed(now, out))
            .or_else(|| self.poll_live(now, out))
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<WriterEvent> {
        if std::mem::take(&mut self.events.acknowledged) {
            return Some(WriterEvent::Acknowledged);
        }
        if let Some(instance) = self.missed.pop_front() {
            return Some(WriterEvent::DeadlineMissed { instance });
        }
        if let Some(at) = self.events.asserted.take() {
            return Some(WriterEvent::Asserted { at });
        }
        std::mem::take(&mut self.events.liveliness_lost).then_some(WriterEvent::LivelinessLost)
    }

    fn next_missed(&mut self, now: Instant) -> Option<KeyHash> {
        self.registry.as_mut()?.poll_missed(now)
    }

    /// Without readers, what has been written counts as sent.
    fn skip_without_readers(&mut self) {
        if self.readers.is_empty() {
            self.live.skip_to(self.last.next());
            self.release();
        }
    }

    /// HEARTBEATs for those that have not acknowledged what they were sent.
    fn remind_readers(&mut self, now: Instant) {
        let end = self.live.end();
        let mut due = Vec::new();
        for proxy in self.readers.values_mut().filter(|p| p.lags_behind(end)) {
            if proxy.next_heartbeat() <= now {
                proxy.remind(now, &self.config.timing);
                due.push(proxy.guid());
            }
            self.heartbeats.arm(proxy.next_heartbeat());
        }
        for reader in due {
            self.enqueue(now, reader);
        }
    }

    /// A reader may have got further than `before`.
    fn settle_progress(&mut self, reader: Guid, before: Base) {
        let Some(now) = self.readers.get(&reader).map(ReaderProxy::base) else {
            return;
        };
        let was_last = Some(before.acknowledged) == self.lowest_acknowledged
            || Some(before.window) == self.window_base;
        if now != before && was_last {
            self.refresh_acknowledged();
            self.handle_progress();
        }
    }

    /// What all reliable readers have acknowledged; everything without any.
    fn acknowledged(&self) -> SequenceNumber {
        self.lowest_acknowledged.unwrap_or(self.last)
    }

    fn has_reliable_readers(&self) -> bool {
        self.lowest_acknowledged.is_some()
    }

    fn refresh_acknowledged(&mut self) {
        let reliable = self.readers.values().filter(|proxy| proxy.is_reliable());
        let bases = reliable.map(ReaderProxy::base);
        let lowest = bases.reduce(|one, other| one.min(other));
        self.lowest_acknowledged = lowest.map(|base| base.acknowledged);
        self.window_base = lowest.map(|base| base.window);
    }

    /// The readers need less than before.
    fn handle_progress(&mut self) {
        if self.acknowledged() >= self.live.end().previous() {
            self.heartbeats.disarm();
        }
        if let Some(base) = self.window_base {
            self.window.handle_acknowledged(base, self.live.untouched());
        }
        self.release();
        self.events.acknowledged = true;
    }
}

/// The DSCP of a TRANSPORT_PRIORITY (DDS 1.4 section 2.2.3.15): the same number, as far as there is one.
fn dscp(priority: i32) -> u8 {
    const MAX: i32 = 63;
    priority.clamp(0, MAX) as u8
}
