//! The in-process layer's link: plain UDP sockets, and the layer itself, with this app as its only one.
//!
//! No privileges, no daemon. Samples take the user socket and go to the app's endpoints; everything else is for the
//! layer's discovery, which runs whenever the driver does.

mod interfaces;
mod lookahead;
mod sockets;
mod static_peers;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rtps_ebpf::SlotSet;
use rtps_net::{AddressWatch, Interface};
use rtps_user::discovery::for_interface;
use rtps_user::layer::protocol::{FromLayer, Hello, LAYER_PROTOCOL_VERSION, ToLayer};
use rtps_user::layer::{Layer, LayerConfig, LayerOutput};
use rtps_user::wire::GuidPrefix;
use rtps_user::{Transmit, ipv6};
use thiserror::Error;

use self::lookahead::Lookahead;
use self::sockets::{Kind, Sockets};
use super::{Arrivals, Burst, FIRST, Identity, LayerKind, Link, Settings, Sink, log_send_error};
use crate::link::sender::Sender;
use crate::sys::receive::{ReceiveBuffer, Received};
use crate::sys::{Epoll, Interest, Wakeups, random_bytes, udp};

/// Three sockets for each family.
const SOCKETS: u8 = FIRST;
const ADDRESSES: u8 = SOCKETS + 6;

/// Datagrams after which a socket has had its turn; those that came together are taken together.
const DATAGRAMS_AT_ONCE: usize = 64;
/// A participant's traffic is reported to the layer at most this often.
const SEEN_PERIOD: Duration = Duration::from_millis(500);
/// Announcements of which one has to arrive for others to keep the participant.
const ANNOUNCEMENTS_IN_LEASE: u32 = 4;

/// Why the in-process layer could not be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum InProcessError {
    /// Each participant of a host has two ports of its own.
    #[error(
        "all ports for participants of domain {0} are taken on this host: close some, or use the kernel layer, where all apps share one participant"
    )]
    NoFreePorts(u32),
    /// The layer does not take its only app.
    #[error("the layer refuses: {0}")]
    Refused(String),
    /// The system refuses a socket.
    #[error("no UDP socket can be opened: {0}")]
    System(#[from] io::Error),
}

/// A layer of the app's own.
pub(crate) struct InProcessLink {
    identity: Identity,
    layer: Layer,
    /// When the layer has something to do, at the latest: asking it costs more than a sample should.
    due: Option<Instant>,
    sockets: Sockets,
    sender: Sender,
    interfaces: Vec<Interface>,
    /// `None` where the system does not allow to watch.
    watch: Option<AddressWatch>,
    inbox: VecDeque<FromLayer>,
    /// For what comes next; `None` while it is read.
    buffer: Option<ReceiveBuffer>,
    lookaheads: [Lookahead; (ADDRESSES - SOCKETS) as usize],
    /// The socket that samples have come through last.
    likely: Wakeups,
    outgoing: Vec<u8>,
    seen: (GuidPrefix, Instant),
}

impl InProcessLink {
    /// Opens sockets on the ports of the first free participant id and starts the layer.
    pub(super) fn open(settings: &Settings, epoll: &Arc<Epoll>) -> Result<Self, InProcessError> {
        let now = Instant::now();
        // Before the first look, so that no change is missed.
        let watch = watch_addresses(epoll);
        let interfaces = interfaces::chosen()?;
        let sockets = Sockets::open(settings.domain, &interfaces)?;
        sockets.register(epoll, SOCKETS)?;
        let config = layer_config(settings, &sockets, &interfaces)?;
        let mut layer = Layer::new(config, now);
        let hello = Hello {
            version: LAYER_PROTOCOL_VERSION,
            domain: settings.domain,
            name: settings.name.clone(),
            doorbell_port: 0,
            ring_bytes: 0,
            resume: None,
        };
        let welcome = layer
            .attach(now, &hello, random_bytes()?, &SlotSet::EMPTY)
            .map_err(InProcessError::Refused)?;
        let mut link = Self {
            identity: Identity {
                slot: welcome.slot,
                prefix: welcome.prefix,
                datagram_size: welcome.datagram_size,
            },
            layer,
            due: None,
            sockets,
            sender: Sender::default(),
            interfaces,
            watch,
            inbox: VecDeque::new(),
            buffer: None,
            lookaheads: Default::default(),
            likely: Wakeups::default(),
            outgoing: Vec::new(),
            seen: (GuidPrefix::UNKNOWN, now),
        };
        link.pump(now);
        Ok(link)
    }

    /// Does what the layer wants done.
    fn pump(&mut self, now: Instant) {
        while let Some(output) = self.layer.poll_output(now, &mut self.outgoing) {
            match output {
                LayerOutput::Transmit(transmit) => self.send_metatraffic(&transmit),
                LayerOutput::Reply { message, .. } => self.inbox.push_back(message),
                // There is no kernel layer, and a restart of this process is a new participant.
                LayerOutput::Kernel(_) | LayerOutput::Store(_) | LayerOutput::Channel(_) => {}
            }
        }
        self.due = self.layer.poll_timeout();
    }

    fn send_metatraffic(&self, transmit: &Transmit) {
        for destination in transmit.destinations.iter() {
            let Some(sockets) = self.sockets.of(*destination) else {
                continue;
            };
            let socket = &sockets.metatraffic;
            if destination.ip().is_multicast() {
                self.send_to_group(socket, *destination);
            } else {
                self.send_to_one(socket, *destination);
            }
        }
    }

    /// Sends to an address; an announcement names the addresses first of the interface that leads there.
    fn send_to_one(&self, socket: &UdpSocket, to: SocketAddr) {
        let addresses = || rtps_net::addresses_towards(&self.interfaces, to);
        let datagram = for_interface(&self.outgoing, addresses);
        if let Err(error) = socket.send_to(&datagram, ipv6::to_socket(to)) {
            log_send_error(to, datagram.len(), &error);
        }
    }

    /// Sends to a group on every interface, announcements with that interface's addresses first: which of them leads
    /// to others nobody knows.
    fn send_to_group(&self, socket: &UdpSocket, group: SocketAddr) {
        for interface in &self.interfaces {
            let Some(source) = interface.source(group.ip()) else {
                continue;
            };
            let from = (interface.index, ipv6::without_interface(source));
            let datagram = for_interface(&self.outgoing, || Some(&interface.addresses));
            if let Err(error) = udp::send_multicast(socket, from, group, &datagram) {
                log_send_error(group, datagram.len(), &error);
            }
        }
    }

    /// Addresses or interfaces of this network namespace changed.
    fn refresh_interfaces(&mut self, now: Instant) {
        if let Some(watch) = &self.watch {
            watch.drain();
        }
        match interfaces::chosen() {
            Ok(interfaces) if interfaces != self.interfaces => {
                self.sockets.join(&interfaces);
                let metatraffic = locators(&interfaces, self.sockets.metatraffic_port);
                let user = locators(&interfaces, self.sockets.user_port);
                self.interfaces = interfaces;
                self.layer.set_addresses(now, metatraffic, user);
                self.pump(now);
            }
            Ok(_) => {}
            Err(error) => tracing::warn!(%error, "the interfaces cannot be listed"),
        }
    }

    /// Takes datagrams of a socket, by its place in the order in which they are watched; a bounded number, so that no
    /// socket keeps the others waiting.
    fn receive_from(&mut self, now: Instant, place: usize, sink: &mut Sink<'_>) {
        let looks_again = self.lookaheads[place].is_due();
        let mut count = self.receive_once(now, place, sink);
        while looks_again && (1..DATAGRAMS_AT_ONCE).contains(&count) {
            let more = self.receive_once(now, place, sink);
            self.lookaheads[place].looked(more > 0);
            if more == 0 {
                return;
            }
            count += more;
        }
    }

    /// Takes what comes together; how many datagrams that were.
    fn receive_once(&mut self, now: Instant, place: usize, sink: &mut Sink<'_>) -> usize {
        let Some((kind, socket)) = self.sockets.all().nth(place) else {
            return 0;
        };
        let mut buffer = self.buffer.take().unwrap_or_else(ReceiveBuffer::new);
        let count = match buffer.receive(socket) {
            Ok(received) => {
                if kind == Kind::User {
                    self.likely = Wakeups::of(SOCKETS + place as u8);
                }
                self.take(now, kind, &received, sink);
                received.datagrams().len().max(1)
            }
            Err(error) => {
                log_receive_error(&error);
                0
            }
        };
        self.buffer = Some(buffer);
        count
    }

    fn take(&mut self, now: Instant, kind: Kind, received: &Received<'_>, sink: &mut Sink<'_>) {
        let source = ipv6::from_socket(received.source);
        match kind {
            Kind::User => {
                // What comes together comes from one socket.
                self.note_traffic(now, received.datagrams().next().and_then(source_prefix));
                received
                    .datagrams()
                    .for_each(|datagram| sink(source, datagram));
            }
            Kind::Metatraffic => {
                for datagram in received.datagrams() {
                    if let Err(error) = self.layer.handle_datagram(now, source, datagram) {
                        let len = datagram.len();
                        tracing::debug!(%source, len, %error, "discovery datagram refused");
                    }
                }
                self.pump(now);
            }
        }
    }

    /// Samples are a sign of life, too; they put what is due off, which therefore comes too early at worst.
    fn note_traffic(&mut self, now: Instant, participant: Option<GuidPrefix>) {
        let Some(participant) = participant else {
            return;
        };
        if self.seen.0 != participant || now.saturating_duration_since(self.seen.1) > SEEN_PERIOD {
            self.seen = (participant, now);
            self.layer.seen(now, participant);
        }
    }
}

impl Link for InProcessLink {
    fn kind(&self) -> LayerKind {
        LayerKind::InProcess
    }

    fn identity(&self) -> Identity {
        self.identity
    }

    fn request(&mut self, now: Instant, request: ToLayer) {
        self.layer.handle_request(now, self.identity.slot, request);
        self.pump(now);
    }

    fn poll_message(&mut self) -> Option<FromLayer> {
        self.inbox.pop_front()
    }

    fn send(&mut self, now: Instant, burst: &Burst<'_>) {
        for destination in burst.destinations {
            if let Some(sockets) = self.sockets.of(*destination)
                && let Err(error) = self.sender.send(now, &sockets.user, *destination, burst)
            {
                log_send_error(*destination, burst.bytes.len(), &error);
            }
        }
    }

    fn receive(&mut self, now: Instant, wakeups: Wakeups, sink: &mut Sink<'_>) {
        for (number, place) in (SOCKETS..ADDRESSES).zip(0..) {
            if wakeups.contains(number) {
                self.receive_from(now, place, sink);
            }
        }
        if wakeups.contains(ADDRESSES) {
            self.refresh_interfaces(now);
        }
    }

    fn arrivals(&self) -> Option<Arc<dyn Arrivals>> {
        None
    }

    fn likely(&self) -> Wakeups {
        self.likely
    }

    fn prepare_sleep(&mut self) -> bool {
        true
    }

    fn awake(&mut self) {}

    fn has_news(&self, now: Instant) -> bool {
        !self.inbox.is_empty() || self.due.is_some_and(|due| due <= now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.layer.handle_timeout(now);
        self.pump(now);
    }

    fn is_lost(&self) -> bool {
        false
    }

    fn shutdown(&mut self, now: Instant) {
        self.layer.shutdown(now);
        self.pump(now);
    }
}

fn layer_config(
    settings: &Settings,
    sockets: &Sockets,
    interfaces: &[Interface],
) -> io::Result<LayerConfig> {
    let (metatraffic, user) = (sockets.metatraffic_port, sockets.user_port);
    let mut config = LayerConfig::new(
        GuidPrefix(guid_prefix()?),
        settings.domain,
        (Ipv4Addr::LOCALHOST, user).into(),
    );
    config.name.clone_from(&settings.name);
    config.metatraffic = locators(interfaces, metatraffic);
    config.user = locators(interfaces, user);
    config.peers.clone_from(&settings.peers);
    config
        .peers
        .extend(static_peers::from_environment(settings.domain));
    config.multicast = sockets.groups();
    if let Some(period) = settings.announce_period {
        config.announce_period = period;
        config.lease = config
            .lease
            .max(period.saturating_mul(ANNOUNCEMENTS_IN_LEASE));
    }
    config.datagram_size = rtps_net::datagram_size(interfaces);
    Ok(config)
}

/// Where a port is reached by others.
fn locators(interfaces: &[Interface], port: u16) -> Vec<SocketAddr> {
    // Only where there is nothing else, others of this host are told to use the loopback interface.
    let is_alone = interfaces.iter().all(|interface| interface.is_loopback);
    let announced = interfaces
        .iter()
        .filter(|interface| is_alone || !interface.is_loopback);
    rtps_net::locators(announced, port)
}

/// Without it, addresses stay as they are now.
fn watch_addresses(epoll: &Epoll) -> Option<AddressWatch> {
    let watch = AddressWatch::new().and_then(|watch| {
        epoll.add(watch.as_fd(), ADDRESSES, Interest::Level)?;
        Ok(watch)
    });
    let log = |error: &io::Error| tracing::info!(%error, "changed addresses go unnoticed");
    watch.inspect_err(log).ok()
}

/// Begins with the vendor's number as RTPS 2.5 section 9.3.1.5 wants it; the rest is random.
fn guid_prefix() -> io::Result<[u8; 12]> {
    let mut prefix = random_bytes::<12>()?;
    prefix[..2].copy_from_slice(&rtps_user::wire::VendorId::UNKNOWN.0);
    Ok(prefix)
}

/// The sender's prefix in the header of a message.
fn source_prefix(datagram: &[u8]) -> Option<GuidPrefix> {
    datagram.get(8..)?.first_chunk().copied().map(GuidPrefix)
}

fn log_receive_error(error: &io::Error) {
    if error.kind() != io::ErrorKind::WouldBlock {
        tracing::debug!(%error, "datagram not received");
    }
}

#[cfg(test)]
mod tests;
