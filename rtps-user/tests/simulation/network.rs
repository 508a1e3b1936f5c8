//! A network of nodes in virtual time.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use rtps_user::endpoints::{EndpointEvent, Endpoints};
use rtps_user::history::NewChange;
use rtps_user::qos::Qos;
use rtps_user::reader::{Reader, ReaderConfig, Sample, Selection};
use rtps_user::wire::{EntityId, EntityKind, Guid, GuidPrefix, SequenceNumber};
use rtps_user::writer::{WriteError, Writer, WriterConfig, WriterTiming};
use rtps_user::{RemoteEndpoint, Transmit};

use crate::random::Random;

/// What the network does to datagrams.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Conditions {
    pub(crate) latency: Duration,
    /// Up to so much is added to the latency, which reorders datagrams.
    pub(crate) jitter: Duration,
    /// Per cent of the datagrams that get lost.
    pub(crate) loss: u64,
    /// Per cent of the datagrams that arrive twice.
    pub(crate) duplication: u64,
    /// Bytes of the largest IP packet; sending a larger one is an error.
    pub(crate) mtu: usize,
    /// Bytes that may be on their way to one node at a time; more get lost.
    pub(crate) inbox: usize,
}

impl Conditions {
    /// Nothing goes wrong.
    pub(crate) const PERFECT: Self = Self {
        latency: Duration::from_micros(100),
        jitter: Duration::ZERO,
        loss: 0,
        duplication: 0,
        mtu: 1500,
        inbox: usize::MAX,
    };

    /// Everything goes wrong.
    pub(crate) const AWFUL: Self = Self {
        latency: Duration::from_micros(100),
        jitter: Duration::from_millis(2),
        loss: 30,
        duplication: 10,
        mtu: 1500,
        inbox: usize::MAX,
    };

    fn datagram_size(&self) -> usize {
        self.mtu - 28
    }
}

/// A participant with its endpoints.
#[derive(Debug)]
struct Node {
    endpoints: Endpoints,
    address: SocketAddr,
    /// Bytes on their way to it.
    inbox: usize,
}

#[derive(Clone, Debug)]
struct Datagram {
    from: SocketAddr,
    to: SocketAddr,
    bytes: Vec<u8>,
}

/// The nodes, and the datagrams that are on their way.
#[derive(Debug)]
pub(crate) struct Network {
    pub(crate) now: Instant,
    pub(crate) conditions: Conditions,
    pub(crate) random: Random,
    /// Nodes that were lied to may say things that others refuse.
    pub(crate) is_hostile: bool,
    /// Datagrams sent so far.
    pub(crate) datagrams: usize,
    /// Datagrams that inboxes had no room for.
    pub(crate) overflown: usize,
    /// What happened to endpoints that was not asked for yet.
    pub(crate) events: Vec<(Guid, EndpointEvent)>,
    nodes: Vec<Node>,
    copies: usize,
    /// By time of arrival, and in the order of sending where that is the same.
    in_flight: BTreeMap<(Instant, usize), Datagram>,
}

impl Network {
    /// More steps than this without progress of time mean that the nodes talk in circles.
    const MAX_STEPS_AT_ONCE: usize = 100_000;

    pub(crate) fn new(conditions: Conditions, seed: u64) -> Self {
        println!("seed {seed}");
        Self {
            now: Instant::now(),
            conditions,
            random: Random::new(seed),
            is_hostile: false,
            datagrams: 0,
            overflown: 0,
            events: Vec::new(),
            nodes: Vec::new(),
            copies: 0,
            in_flight: BTreeMap::new(),
        }
    }

    /// Adds a node, and a writer on it.
    pub(crate) fn add_writer(&mut self, kind: EntityKind, qos: Qos) -> Guid {
        self.add_writer_with(kind, qos, WriterTiming::default())
    }

    pub(crate) fn add_writer_with(
        &mut self,
        kind: EntityKind,
        qos: Qos,
        timing: WriterTiming,
    ) -> Guid {
        let guid = self.add_node(EntityId::of_app(1, 1, kind));
        let datagram_size = self.conditions.datagram_size();
        self.endpoints(guid).add_writer(WriterConfig {
            guid,
            qos,
            datagram_size,
            timing,
        });
        guid
    }

    /// The writer's process dies, and a new one goes on in its name with the sequence number `next`.
    pub(crate) fn restart_writer(&mut self, guid: Guid, next: SequenceNumber) {
        let qos = self.writer(guid).qos().clone();
        let datagram_size = self.conditions.datagram_size();
        self.endpoints(guid).add_writer(WriterConfig {
            guid,
            qos,
            datagram_size,
            timing: WriterTiming::default(),
        });
        self.writer(guid).resume_from(next, 1 << 20);
    }

    /// Adds a node, and a reader on it.
    pub(crate) fn add_reader(&mut self, kind: EntityKind, qos: Qos) -> Guid {
        let guid = self.add_node(EntityId::of_app(1, 2, kind));
        self.start_reader(guid, qos);
        guid
    }

    /// The reader's process dies, with what was on its way to it, and a new one begins with nothing.
    pub(crate) fn restart_reader(&mut self, guid: Guid) {
        let qos = self.reader(guid).qos().clone();
        let node = &mut self.nodes[usize::from(guid.prefix.0[11])];
        let address = node.address;
        node.inbox = 0;
        self.in_flight.retain(|_, datagram| datagram.to != address);
        self.start_reader(guid, qos);
    }

    fn start_reader(&mut self, guid: Guid, qos: Qos) {
        let config = ReaderConfig {
            datagram_size: self.conditions.datagram_size(),
            ..ReaderConfig::new(guid, qos)
        };
        self.endpoints(guid).add_reader(config);
    }

    /// Both sides match, one after the other.
    pub(crate) fn connect(&mut self, writer: Guid, reader: Guid) {
        self.match_writer_side(writer, reader);
        self.match_reader_side(writer, reader);
    }

    /// The writer learns of the reader.
    pub(crate) fn match_writer_side(&mut self, writer: Guid, reader: Guid) {
        let (now, remote) = (self.now, self.remote(reader));
        self.endpoints(writer)
            .match_remote(now, writer.entity, &remote);
    }

    /// The reader learns of the writer.
    pub(crate) fn match_reader_side(&mut self, writer: Guid, reader: Guid) {
        let (now, remote) = (self.now, self.remote(writer));
        self.endpoints(reader)
            .match_remote(now, reader.entity, &remote);
    }

    /// Both sides forget each other.
    pub(crate) fn disconnect(&mut self, writer: Guid, reader: Guid) {
        let now = self.now;
        self.endpoints(writer).unmatch(now, writer.entity, reader);
        self.endpoints(reader).unmatch(now, reader.entity, writer);
    }

    pub(crate) fn endpoints(&mut self, guid: Guid) -> &mut Endpoints {
        let index = usize::from(guid.prefix.0[11]);
        &mut self.nodes[index].endpoints
    }

    pub(crate) fn writer(&mut self, guid: Guid) -> &mut Writer {
        self.endpoints(guid).writer_mut(guid.entity).unwrap()
    }

    pub(crate) fn reader(&mut self, guid: Guid) -> &mut Reader {
        self.endpoints(guid).reader_mut(guid.entity).unwrap()
    }

    pub(crate) fn write(
        &mut self,
        writer: Guid,
        change: NewChange,
    ) -> Result<SequenceNumber, WriteError> {
        let now = self.now;
        let result = self.writer(writer).write(now, change);
        self.exchange();
        result
    }

    /// Writes several changes at once, as an app does that waits for room.
    pub(crate) fn write_burst(
        &mut self,
        writer: Guid,
        changes: impl IntoIterator<Item = NewChange>,
    ) {
        for change in changes {
            let now = self.now;
            let written = self.writer(writer).write_or_return(now, change, None);
            if let Err(refused) = written {
                self.write_blocking(writer, refused.change);
            }
        }
        self.exchange();
    }

    /// Writes as an app does that waits for room.
    pub(crate) fn write_blocking(&mut self, writer: Guid, change: NewChange) -> SequenceNumber {
        for _ in 0..60_000 {
            match self.write(writer, change.clone()) {
                Ok(sequence) => return sequence,
                Err(WriteError::HistoryFull) => self.run_for(Duration::from_millis(1)),
                Err(error) => panic!("{error}"),
            }
        }
        panic!("no room in a minute");
    }

    pub(crate) fn take(&mut self, reader: Guid) -> Vec<Sample> {
        self.reader(reader).take(usize::MAX, &Selection::default())
    }

    /// Lets time pass.
    pub(crate) fn run_for(&mut self, time: Duration) {
        let end = self.now + time;
        self.run_until(end, |_| false);
    }

    /// Lets time pass until the writer's samples are acknowledged; panics after a minute.
    pub(crate) fn run_until_acknowledged(&mut self, writer: Guid) {
        let end = self.now + Duration::from_secs(60);
        self.run_until(end, |network| network.writer(writer).all_acknowledged());
        assert!(self.writer(writer).all_acknowledged(), "no end in sight");
    }

    /// Gives a node a datagram that another pretends to have sent.
    pub(crate) fn inject(&mut self, to: Guid, bytes: &[u8]) {
        let now = self.now;
        let from = SocketAddr::from((Ipv4Addr::new(10, 9, 9, 9), 9999));
        let _malformed = self.endpoints(to).handle_datagram(now, from, bytes);
        self.exchange();
    }

    /// Datagrams that are on their way now.
    pub(crate) fn sniff(&self) -> impl Iterator<Item = &[u8]> {
        self.in_flight
            .values()
            .map(|datagram| datagram.bytes.as_slice())
    }

    fn run_until(&mut self, end: Instant, mut is_done: impl FnMut(&mut Self) -> bool) {
        let mut steps = 0;
        self.exchange();
        while !is_done(self) {
            let next = self.next_event().filter(|next| *next <= end);
            let Some(next) = next else {
                self.now = end;
                return;
            };
            steps = if next > self.now { 0 } else { steps + 1 };
            assert!(steps < Self::MAX_STEPS_AT_ONCE, "time stands still");
            self.now = self.now.max(next);
            self.deliver();
            let now = self.now;
            for node in &mut self.nodes {
                node.endpoints.handle_timeout(now);
            }
            self.exchange();
        }
    }

    fn next_event(&self) -> Option<Instant> {
        let timers = self
            .nodes
            .iter()
            .filter_map(|node| node.endpoints.poll_timeout());
        let arrivals = self.in_flight.keys().map(|(at, _)| *at).take(1);
        timers.chain(arrivals).min()
    }

    fn deliver(&mut self) {
        while let Some(entry) = self.in_flight.first_entry() {
            if entry.key().0 > self.now {
                return;
            }
            let datagram = entry.remove();
            let now = self.now;
            if let Some(node) = self.node_at(datagram.to) {
                node.inbox -= datagram.bytes.len();
                let result = node
                    .endpoints
                    .handle_datagram(now, datagram.from, &datagram.bytes);
                assert!(result.is_ok() || self.is_hostile, "{result:?}");
            }
        }
    }

    /// Takes from the nodes what they have to say.
    fn exchange(&mut self) {
        let mut bytes = Vec::new();
        for index in 0..self.nodes.len() {
            let now = self.now;
            let endpoints = &mut self.nodes[index].endpoints;
            let prefix = endpoints.prefix();
            while let Some(event) = endpoints.poll_event() {
                let guid = Guid::new(prefix, EntityId::UNKNOWN);
                self.events.push((guid, event));
            }
            while let Some(transmit) = self.nodes[index].endpoints.poll_transmit(now, &mut bytes) {
                self.send(index, &transmit, &bytes);
                bytes.clear();
            }
        }
    }

    fn send(&mut self, from: usize, transmit: &Transmit, bytes: &[u8]) {
        assert!(
            bytes.len() <= self.conditions.datagram_size(),
            "a datagram of {} bytes does not fit",
            bytes.len()
        );
        for to in transmit.destinations.iter() {
            self.datagrams += 1;
            if self.random.percent(self.conditions.loss) {
                continue;
            }
            if !self.has_room(*to, bytes.len()) {
                self.overflown += 1;
                continue;
            }
            let copies = 1 + usize::from(self.random.percent(self.conditions.duplication));
            for _ in 0..copies {
                let jitter = self.random.up_to(self.conditions.jitter);
                let at = self.now + self.conditions.latency + jitter;
                let datagram = Datagram {
                    from: self.nodes[from].address,
                    to: *to,
                    bytes: bytes.to_vec(),
                };
                self.copies += 1;
                if let Some(node) = self.node_at(*to) {
                    node.inbox += bytes.len();
                }
                self.in_flight.insert((at, self.copies), datagram);
            }
        }
    }

    fn node_at(&mut self, address: SocketAddr) -> Option<&mut Node> {
        self.nodes.iter_mut().find(|node| node.address == address)
    }

    fn has_room(&mut self, address: SocketAddr, bytes: usize) -> bool {
        let inbox = self.conditions.inbox;
        self.node_at(address)
            .is_none_or(|node| node.inbox.saturating_add(bytes) <= inbox)
    }

    fn add_node(&mut self, entity: EntityId) -> Guid {
        let index = self.nodes.len();
        let mut prefix = [7; 12];
        prefix[11] = u8::try_from(index).expect("at most 256 nodes");
        let prefix = GuidPrefix(prefix);
        self.nodes.push(Node {
            endpoints: Endpoints::new(prefix),
            address: SocketAddr::from((Ipv4Addr::new(10, 0, 0, index as u8), 7411)),
            inbox: 0,
        });
        Guid::new(prefix, entity)
    }

    fn remote(&mut self, guid: Guid) -> RemoteEndpoint {
        let address = self.nodes[usize::from(guid.prefix.0[11])].address;
        let qos = if guid.entity.is_writer() {
            self.writer(guid).qos().clone()
        } else {
            self.reader(guid).qos().clone()
        };
        RemoteEndpoint {
            guid,
            unicast: vec![address],
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            takes_bare_keys: false,
            qos,
            topic: "Square".into(),
            type_name: "ShapeType".into(),
            type_information: Vec::new(),
            content_filter: None,
        }
    }
}
