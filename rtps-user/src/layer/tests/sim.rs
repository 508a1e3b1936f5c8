//! Hosts, each with a layer, on a network in virtual time.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use rtps_ebpf::SlotSet;

use super::kernel::{Kernel, News};
use crate::layer::protocol::{Endpoint, FromLayer, Hello, LAYER_PROTOCOL_VERSION, Resume, ToLayer};
use crate::layer::{KernelChange, Layer, LayerConfig, LayerOutput, StoreChange, StoreKey};
use crate::qos::{Qos, Reliability};
use crate::wire::{EntityId, EntityKind, Guid, GuidPrefix, Submessage, Submessages};

pub(super) const GROUP: SocketAddr = SocketAddr::V4(std::net::SocketAddrV4::new(
    std::net::Ipv4Addr::new(239, 255, 0, 1),
    7400,
));
const LATENCY: Duration = Duration::from_millis(1);

/// A host: its layer, and what that has asked for.
pub(super) struct Host {
    pub(super) layer: Layer,
    pub(super) address: SocketAddr,
    pub(super) replies: Vec<(u8, FromLayer)>,
    pub(super) routes: BTreeMap<Guid, SlotSet>,
    pub(super) peers: BTreeSet<GuidPrefix>,
    /// Channels that were to be made since a test last looked.
    pub(super) channels: Vec<[u8; 2]>,
    pub(super) store: BTreeMap<StoreKey, Vec<u8>>,
    /// Whether datagrams reach it and leave it.
    pub(super) is_connected: bool,
    /// A low-level layer that answers.
    pub(super) kernel: Option<Box<Kernel>>,
    /// Whether its layer does not run for the moment.
    pub(super) is_stopped: bool,
    /// How often its layer had something to do.
    pub(super) wakeups: usize,
}

#[derive(Clone)]
struct Datagram {
    from: SocketAddr,
    to: SocketAddr,
    bytes: Vec<u8>,
}

/// The network.
pub(super) struct Net {
    pub(super) now: Instant,
    pub(super) hosts: Vec<Host>,
    /// By time and order of arrival.
    flying: BTreeMap<(Instant, u64), Datagram>,
    sent_before: u64,
    /// So many of 100 datagrams are lost.
    pub(super) loss: u64,
    /// As many are late, and as many come twice.
    pub(super) is_disorderly: bool,
    dice: u64,
    pub(super) sent: usize,
    /// Samples of endpoints that were sent.
    pub(super) endpoint_samples: usize,
}

pub(super) fn prefix(number: usize) -> GuidPrefix {
    let mut prefix = [7; 12];
    prefix[..8].copy_from_slice(&(number as u64).to_be_bytes());
    GuidPrefix(prefix)
}

pub(super) fn config(number: usize) -> LayerConfig {
    let [.., high, low] = number.to_be_bytes();
    let ip = [10, 0, high, low];
    LayerConfig {
        name: format!("host {number}"),
        metatraffic: vec![(ip, 7410).into()],
        user: vec![(ip, 7411).into()],
        multicast: vec![GROUP],
        ..LayerConfig::new(prefix(number), 0, ([127, 0, 0, 1], 7411).into())
    }
}

pub(super) fn hello() -> Hello {
    Hello {
        version: LAYER_PROTOCOL_VERSION,
        domain: 0,
        name: "app".to_owned(),
        doorbell_port: 0,
        ring_bytes: 0,
        resume: None,
    }
}

pub(super) fn reliable() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        ..Qos::default()
    }
}

pub(super) fn endpoint(slot: u8, serial: u16, kind: EntityKind) -> Endpoint {
    Endpoint {
        entity: EntityId::of_app(slot, serial, kind),
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        type_objects: Vec::new(),
        content_filter: None,
        qos: reliable(),
    }
}

impl Net {
    pub(super) fn new(hosts: usize) -> Self {
        let now = Instant::now();
        let mut net = Self {
            now,
            hosts: Vec::new(),
            flying: BTreeMap::new(),
            sent_before: 0,
            loss: 0,
            is_disorderly: false,
            dice: 1,
            sent: 0,
            endpoint_samples: 0,
        };
        for number in 1..=hosts {
            net.add(config(number));
        }
        net
    }

    pub(super) fn add(&mut self, config: LayerConfig) {
        self.hosts.push(Host {
            address: config.metatraffic[0],
            layer: Layer::new(config, self.now),
            replies: Vec::new(),
            routes: BTreeMap::new(),
            peers: BTreeSet::new(),
            channels: Vec::new(),
            store: BTreeMap::new(),
            is_connected: true,
            kernel: None,
            is_stopped: false,
            wakeups: 0,
        });
    }

    /// Adds a host with a low-level layer that answers.
    pub(super) fn add_with_kernel(&mut self, mut config: LayerConfig) {
        config.kernel_discovery = true;
        let kernel = Kernel::new(config.prefix, self.now);
        self.add(config);
        let host = self.hosts.last_mut().expect("just added");
        host.kernel = Some(Box::new(kernel));
    }

    /// The low-level layer of a host.
    pub(super) fn kernel(&mut self, host: usize) -> &mut Kernel {
        let kernel = self.hosts[host].kernel.as_mut();
        kernel.expect("a host with a low-level layer")
    }

    /// Starts a host's layer anew with what it has stored.
    pub(super) fn restart(&mut self, host: usize, config: LayerConfig) {
        let host = &mut self.hosts[host];
        host.layer = Layer::new(config, self.now);
        let records: Vec<_> = host
            .store
            .iter()
            .map(|(key, value)| (*key, value.clone()))
            .collect();
        host.layer.restore(self.now, records);
    }

    pub(super) fn attach(&mut self, host: usize) -> u8 {
        let host = &mut self.hosts[host];
        host.layer
            .attach(
                self.now,
                &hello(),
                [host.address.port() as u8; 16],
                &SlotSet::EMPTY,
            )
            .unwrap()
            .slot
    }

    pub(super) fn resume(&mut self, host: usize, slot: u8) -> u8 {
        let host = &mut self.hosts[host];
        let token = [host.address.port() as u8; 16];
        let mut hello = hello();
        hello.resume = Some(Resume { slot, token });
        host.layer
            .attach(self.now, &hello, [99; 16], &SlotSet::EMPTY)
            .unwrap()
            .slot
    }

    pub(super) fn declare(&mut self, host: usize, endpoint: Endpoint) -> Guid {
        let guid = Guid::new(prefix(host + 1), endpoint.entity);
        let request = ToLayer::Declare(Box::new(endpoint));
        self.request(host, guid.entity.slot(), request);
        guid
    }

    pub(super) fn request(&mut self, host: usize, slot: u8, request: ToLayer) {
        let now = self.now;
        self.hosts[host].layer.handle_request(now, slot, request);
        self.drain(host);
    }

    /// What a host has told its apps since the last call.
    pub(super) fn replies(&mut self, host: usize) -> Vec<(u8, FromLayer)> {
        self.drain(host);
        std::mem::take(&mut self.hosts[host].replies)
    }

    /// Injects a datagram.
    pub(super) fn inject(&mut self, from: SocketAddr, to: SocketAddr, bytes: Vec<u8>) {
        self.fly(Duration::ZERO, Datagram { from, to, bytes });
    }

    /// Lets time pass.
    pub(super) fn run(&mut self, time: Duration) {
        let end = self.now + time;
        for host in 0..self.hosts.len() {
            self.drain(host);
        }
        loop {
            let running = self.hosts.iter().filter(|host| !host.is_stopped);
            let timers = running.filter_map(|host| host.layer.poll_timeout());
            let arrival = self.flying.first_key_value().map(|((at, _), _)| *at);
            let Some(next) = timers.chain(arrival).min().filter(|next| *next <= end) else {
                break;
            };
            assert!(
                next + Duration::from_secs(1) > self.now,
                "a timer stays due"
            );
            self.now = self.now.max(next);
            self.deliver();
            for host in 0..self.hosts.len() {
                self.handle_timeout(host);
            }
        }
        self.now = end;
    }

    /// Lets a layer do what is due, with the knowledge of its low-level layer.
    fn handle_timeout(&mut self, index: usize) {
        let host = &mut self.hosts[index];
        if host.is_stopped || host.layer.poll_timeout().is_none_or(|due| due > self.now) {
            return;
        }
        host.wakeups += 1;
        if let Some(kernel) = &host.kernel {
            for (prefix, at) in kernel.seen() {
                host.layer.seen(at, prefix);
            }
            for prefix in host.layer.unacknowledged() {
                for (reader, base) in kernel.acknowledged(prefix) {
                    host.layer.acknowledged(self.now, reader, base);
                }
            }
        }
        host.layer.handle_timeout(self.now);
        self.drain(index);
    }

    fn deliver(&mut self) {
        while let Some(first) = self.flying.first_entry()
            && first.key().0 <= self.now
        {
            let datagram = first.remove();
            for index in 0..self.hosts.len() {
                let host = &self.hosts[index];
                let is_for_it = datagram.to == GROUP || datagram.to == host.address;
                if is_for_it && host.is_connected {
                    self.arrive(index, &datagram);
                }
            }
        }
    }

    fn arrive(&mut self, index: usize, datagram: &Datagram) {
        let host = &mut self.hosts[index];
        let Some(kernel) = &mut host.kernel else {
            // Errors are the business of the tests that inject garbage.
            let layer = &mut host.layer;
            let _ = layer.handle_datagram(self.now, datagram.from, &datagram.bytes);
            self.drain(index);
            return;
        };
        for (to, answer) in kernel.receive(self.now, datagram.from, &datagram.bytes) {
            self.send(index, to, &answer);
        }
        self.hand_over(index);
    }

    /// Lets a stopped layer run again.
    pub(super) fn wake(&mut self, index: usize) {
        self.hosts[index].is_stopped = false;
        self.hand_over(index);
        self.handle_timeout(index);
    }

    /// Gives a layer what its low-level layer has for it.
    fn hand_over(&mut self, index: usize) {
        let host = &mut self.hosts[index];
        let Some(kernel) = host.kernel.as_mut().filter(|_| !host.is_stopped) else {
            return;
        };
        for news in std::mem::take(&mut kernel.news) {
            let News {
                source, message, ..
            } = news;
            let layer = &mut self.hosts[index].layer;
            // As above.
            let _ = if news.is_answered {
                layer.handle_answered(self.now, source, &message)
            } else {
                layer.handle_datagram(self.now, source, &message)
            };
            self.hosts[index].wakeups += 1;
            self.drain(index);
        }
    }

    fn send(&mut self, index: usize, to: SocketAddr, bytes: &[u8]) {
        self.sent += 1;
        let is_lost = self.roll(self.loss);
        if !self.hosts[index].is_connected || is_lost {
            return;
        }
        let datagram = Datagram {
            from: self.hosts[index].address,
            to,
            bytes: bytes.to_vec(),
        };
        let is_late = self.is_disorderly && self.roll(self.loss);
        let is_double = self.is_disorderly && self.roll(self.loss);
        let latency = if is_late { 20 * LATENCY } else { LATENCY };
        if is_double {
            self.fly(3 * latency, datagram.clone());
        }
        self.fly(latency, datagram);
    }

    fn fly(&mut self, latency: Duration, datagram: Datagram) {
        self.sent_before += 1;
        let key = (self.now + latency, self.sent_before);
        self.flying.insert(key, datagram);
    }

    /// Whether something happens that happens so many times in a hundred.
    fn roll(&mut self, percent: u64) -> bool {
        self.dice = self
            .dice
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.dice >> 33) % 100 < percent
    }

    fn drain(&mut self, index: usize) {
        let mut out = Vec::new();
        while let Some(output) = self.hosts[index].layer.poll_output(self.now, &mut out) {
            let host = &mut self.hosts[index];
            if let (Some(kernel), LayerOutput::Kernel(change)) = (&mut host.kernel, &output) {
                kernel.apply(change.clone());
            }
            match output {
                LayerOutput::Transmit(transmit) => {
                    self.endpoint_samples += endpoint_samples(&out);
                    for to in transmit.destinations.iter() {
                        self.send(index, *to, &out);
                    }
                }
                LayerOutput::Reply { slot, message } => {
                    check_route(&host.routes, slot, &message);
                    host.replies.push((slot, message));
                }
                LayerOutput::Channel(slots) => host.channels.push(slots),
                LayerOutput::Kernel(KernelChange::Route { writer, slots }) => {
                    if slots.is_empty() {
                        host.routes.remove(&writer);
                    } else {
                        host.routes.insert(writer, slots);
                    }
                }
                LayerOutput::Kernel(KernelChange::Peer { prefix, .. }) => {
                    host.peers.insert(prefix);
                }
                LayerOutput::Kernel(KernelChange::ForgetPeer(prefix)) => {
                    host.peers.remove(&prefix);
                }
                LayerOutput::Kernel(change) => {
                    assert!(host.kernel.is_some(), "{change:?} without kernel discovery");
                }
                LayerOutput::Store(StoreChange::Store { key, value }) => {
                    host.store.insert(key, value);
                }
                LayerOutput::Store(StoreChange::Forget(key)) => {
                    host.store.remove(&key);
                }
            }
        }
    }
}

/// The kernel must deliver what a writer sends before an app learns of the match.
fn check_route(routes: &BTreeMap<Guid, SlotSet>, slot: u8, message: &FromLayer) {
    if let FromLayer::Matched { local, remote } = message
        && local.is_reader()
    {
        assert!(routes[&remote.guid].contains(slot));
    }
}

fn endpoint_samples(datagram: &[u8]) -> usize {
    let (_, submessages) = Submessages::parse(datagram).unwrap();
    submessages
        .filter(|submessage| {
            matches!(submessage, Ok(Submessage::Data(data)) if data.writer != EntityId::SPDP_WRITER)
        })
        .count()
}
