//! A low-level layer that answers discovery messages: the kernel's own exchange, on plain tables.

use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use rtps_ebpf::abi::{
    Announcement, BuiltinWriter, PEER_ANY_ADDRESS, PEER_PROVEN, PEER_SUPERVISED, Peer,
    SUBMESSAGE_BYTES, Sample, WRITER_FRAGMENTED,
};
use rtps_ebpf::discovery::{Exchange, FILL_TURNS, MAX_DATAGRAMS, Setting, TURNS, World, budget};
use rtps_ebpf::entity;
use rtps_ebpf::walk::MAX_STEPS;
use rtps_ebpf::{Routes, SlotSet, Step, Walk};

use crate::layer::KernelChange;
use crate::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};

const WRITERS: [EntityId; 3] = [
    EntityId::SEDP_PUBLICATIONS_WRITER,
    EntityId::SEDP_SUBSCRIPTIONS_WRITER,
    EntityId::PARTICIPANT_MESSAGE_WRITER,
];
const READERS: [EntityId; 3] = [
    EntityId::SEDP_PUBLICATIONS_READER,
    EntityId::SEDP_SUBSCRIPTIONS_READER,
    EntityId::PARTICIPANT_MESSAGE_READER,
];

/// A message for the layer.
pub(super) struct News {
    pub(super) source: SocketAddr,
    pub(super) message: Vec<u8>,
    pub(super) is_answered: bool,
}

/// What the low-level layer knows; what the layer says of it comes as [`KernelChange`].
pub(super) struct Kernel {
    own: GuidPrefix,
    start: Instant,
    own_samples: OwnSamples,
    pub(super) peers: BTreeMap<GuidPrefix, Peer>,
    pub(super) strangers: BTreeMap<GuidPrefix, Peer>,
    pub(super) news: VecDeque<News>,
    /// Messages that there is room for.
    pub(super) capacity: usize,
    /// Messages that there was no room for.
    pub(super) refused: usize,
    /// False: as at the hook of a socket.
    pub(super) may_answer: bool,
    new_until: u64,
}

/// What our built-in writers say.
#[derive(Default)]
struct OwnSamples {
    announcement: Option<Announcement>,
    writers: [BuiltinWriter; 3],
    samples: BTreeMap<(u32, u64), Sample>,
}

impl World for OwnSamples {
    fn writer(&self, writer: u32) -> Option<&BuiltinWriter> {
        self.writers.get(writer as usize)
    }

    fn sample(&self, writer: u32, sequence: u64) -> Option<&Sample> {
        self.samples.get(&(writer, sequence))
    }

    fn announcement(&self) -> Option<&Announcement> {
        self.announcement.as_ref()
    }
}

struct NoApps;

impl Routes for NoApps {
    fn add_readers(&self, _writer: &entity::Guid, _slots: &mut SlotSet) {}
}

impl Kernel {
    pub(super) fn new(own: GuidPrefix, start: Instant) -> Self {
        Self {
            own,
            start,
            own_samples: OwnSamples::default(),
            peers: BTreeMap::new(),
            strangers: BTreeMap::new(),
            news: VecDeque::new(),
            capacity: 10_000,
            refused: 0,
            may_answer: true,
            new_until: 0,
        }
    }

    /// How old counts are.
    pub(super) fn count_age(&self, now: Instant) -> Duration {
        now - self.start
    }

    /// Does what the layer wants.
    pub(super) fn apply(&mut self, change: KernelChange) {
        match change {
            KernelChange::Route { .. } | KernelChange::FanOut { .. } => {}
            KernelChange::Peer {
                prefix,
                addresses,
                supervised,
            } => self.set_peer(prefix, &addresses, supervised),
            KernelChange::ForgetPeer(prefix) => {
                self.peers.remove(&prefix);
                self.strangers.remove(&prefix);
            }
            KernelChange::Announcement(submessages) => {
                let (bytes, len) = padded(&submessages);
                self.own_samples.announcement = (len > 0).then_some(Announcement {
                    bytes,
                    len,
                    reserved: 0,
                });
            }
            KernelChange::Sample {
                writer,
                sequence,
                timestamp,
                submessage,
            } => {
                let (bytes, len) = padded(&submessage);
                let sample = Sample {
                    bytes,
                    len,
                    reserved: 0,
                    timestamp,
                };
                let key = (number_of(writer), sequence.0 as u64);
                self.own_samples.samples.insert(key, sample);
            }
            KernelChange::ForgetSample { writer, sequence } => {
                let key = (number_of(writer), sequence.0 as u64);
                self.own_samples.samples.remove(&key);
            }
            KernelChange::Available {
                writer,
                first,
                last,
            } => self.set_available(number_of(writer), first.0 as u64, last.0 as u64),
            KernelChange::Progress {
                writer,
                next,
                exact,
            } => self.set_progress(writer, next.0 as u64, exact),
        }
    }

    fn set_peer(&mut self, prefix: GuidPrefix, addresses: &[IpAddr], supervised: bool) {
        let known = self.peers.get(&prefix).copied();
        let mut peer = known
            .or_else(|| self.strangers.remove(&prefix))
            .unwrap_or_default();
        peer.addresses = [[0; 16]; 8];
        peer.flags = PEER_PROVEN;
        if supervised {
            peer.flags |= PEER_SUPERVISED;
        }
        if addresses.is_empty() || addresses.len() > peer.addresses.len() {
            peer.flags |= PEER_ANY_ADDRESS;
        }
        for (slot, address) in peer.addresses.iter_mut().zip(addresses) {
            *slot = mapped(*address);
        }
        self.peers.insert(prefix, peer);
    }

    /// Samples come before the range that they are in, and leave after it.
    fn set_available(&mut self, writer: u32, first: u64, last: u64) {
        let samples = &self.own_samples.samples;
        let mut numbers = samples.range((writer, 0)..(writer + 1, 0));
        assert_eq!(
            numbers.next().map_or(last + 1, |((_, number), _)| *number),
            first
        );
        assert!(numbers.all(|((_, number), _)| *number <= last));
        self.own_samples.writers[writer as usize] = BuiltinWriter {
            first,
            last,
            ..BuiltinWriter::default()
        };
    }

    fn set_progress(&mut self, writer: Guid, next: u64, exact: bool) {
        let peer = match self.peers.get_mut(&writer.prefix) {
            Some(peer) => Some(peer),
            None => self.strangers.get_mut(&writer.prefix),
        };
        if let Some(peer) = peer {
            let writer = &mut peer.writers[number_of(writer.entity) as usize];
            if next > writer.next {
                writer.flags &= !WRITER_FRAGMENTED;
            }
            writer.next = if exact { next } else { next.max(writer.next) };
        }
    }

    /// Takes in what comes from the network; gives the answers.
    pub(super) fn receive(
        &mut self,
        now: Instant,
        source: SocketAddr,
        message: &[u8],
    ) -> Vec<(SocketAddr, Vec<u8>)> {
        let mut walk = Walk::new(self.own.0);
        (0..MAX_STEPS).find(|_| walk.step(message, &NoApps) != Step::Continue);
        let sender = GuidPrefix(*walk.sender());
        if !walk.findings(None).built_in || sender == self.own {
            return Vec::new();
        }
        let known = self.peers.get(&sender);
        let known = known.or_else(|| self.strangers.get(&sender)).copied();
        if known.is_some_and(|peer| !may_send_from(&peer, source.ip())) {
            return Vec::new();
        }
        let mut exchange = Box::new(Exchange::new());
        let setting = self.setting(now, source.ip(), &walk);
        exchange.begin(&setting, known.as_ref());
        (0..TURNS).find(|_| exchange.step(message, &self.own_samples).is_break());
        let outcome = exchange.outcome();
        if outcome.unknown || outcome.new && !self.has_budget(setting.now_ns) {
            return Vec::new();
        }
        if outcome.news {
            if self.news.len() >= self.capacity {
                self.refused += 1;
                return Vec::new();
            }
            self.news.push_back(News {
                source,
                message: message.to_vec(),
                is_answered: outcome.answered,
            });
        }
        let answers = if outcome.speaks {
            let to = SocketAddr::new(source.ip(), exchange.peer.reply_port as u16);
            let answers = self.speak(&mut exchange).into_iter();
            answers.map(|answer| (to, answer)).collect()
        } else {
            Vec::new()
        };
        let is_peer = self.peers.contains_key(&sender);
        let table = if is_peer {
            &mut self.peers
        } else {
            &mut self.strangers
        };
        table.insert(sender, exchange.peer);
        answers
    }

    fn setting(&self, now: Instant, source: IpAddr, walk: &Walk) -> Setting {
        let age_ns = self.count_age(now).as_nanos() as u64;
        Setting {
            now_ns: 1_000_000_000_000 + age_ns,
            age_ns,
            source: mapped(source),
            own: self.own.0,
            sender: *walk.sender(),
            domain_id: 0,
            datagram_size: 1472,
            end: walk.end(),
            may_answer: self.may_answer,
            is_local: false,
        }
    }

    fn has_budget(&mut self, now_ns: u64) -> bool {
        let until = budget::NEW.spend(self.new_until, now_ns, 1);
        self.new_until = until.unwrap_or(self.new_until);
        until.is_some()
    }

    fn speak(&self, exchange: &mut Exchange) -> Vec<Vec<u8>> {
        let mut datagrams = Vec::new();
        for _ in 0..MAX_DATAGRAMS {
            exchange.open();
            (0..FILL_TURNS).find(|_| exchange.fill(&self.own_samples).is_break());
            if exchange.has_datagram() {
                let answer = &exchange.answer;
                datagrams.push(answer.bytes[..answer.len as usize].to_vec());
            }
            if !exchange.has_more() {
                break;
            }
        }
        datagrams
    }

    /// Which participants have been seen when.
    pub(super) fn seen(&self) -> Vec<(GuidPrefix, Instant)> {
        let seen = |peer: &Peer| {
            let age_ns = peer.last_seen_ns.checked_sub(1_000_000_000_000)?;
            Some(self.start + Duration::from_nanos(age_ns))
        };
        let peers = self.peers.iter();
        peers
            .filter_map(|(prefix, peer)| Some((*prefix, seen(peer)?)))
            .collect()
    }

    /// What the built-in readers of a participant have acknowledged.
    pub(super) fn acknowledged(&self, prefix: GuidPrefix) -> Vec<(Guid, SequenceNumber)> {
        let Some(peer) = self.peers.get(&prefix) else {
            return Vec::new();
        };
        READERS
            .iter()
            .zip(&peer.readers)
            .map(|(entity, reader)| {
                let base = SequenceNumber(reader.acknowledged as i64);
                (Guid::new(prefix, *entity), base)
            })
            .collect()
    }
}

fn may_send_from(peer: &Peer, source: IpAddr) -> bool {
    peer.flags & PEER_ANY_ADDRESS != 0 || peer.addresses.contains(&mapped(source))
}

fn mapped(ip: IpAddr) -> [u8; 16] {
    match ip {
        IpAddr::V4(ip) => ip.to_ipv6_mapped().octets(),
        IpAddr::V6(ip) => ip.octets(),
    }
}

fn number_of(writer: EntityId) -> u32 {
    let number = WRITERS.iter().position(|known| *known == writer);
    number.expect("a built-in writer") as u32
}

fn padded(submessages: &[u8]) -> ([u8; SUBMESSAGE_BYTES], u32) {
    let mut bytes = [0; SUBMESSAGE_BYTES];
    bytes[..submessages.len()].copy_from_slice(submessages);
    (bytes, submessages.len() as u32)
}
