//! The in-process layer's link: plain UDP sockets, and the layer itself, with this app as its only one.
//!
//! No privileges, no daemon. Samples take the user socket and go to the app's endpoints; everything else is for the
//! layer's discovery, which runs whenever the driver does.

mod interfaces;
mod sockets;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rtps_ebpf::SlotSet;
use rtps_user::Transmit;
use rtps_user::layer::protocol::{FromLayer, Hello, LAYER_PROTOCOL_VERSION, ToLayer};
use rtps_user::layer::{Layer, LayerConfig, LayerOutput};
use rtps_user::wire::GuidPrefix;
use thiserror::Error;

use self::interfaces::Interface;
use self::sockets::Sockets;
use super::{FIRST, Identity, LayerKind, Link, Settings, Sink, log_send_error};
use crate::sys::{Epoll, Wakeups, random_bytes, udp};

const USER: u8 = FIRST;
const METATRAFFIC: u8 = FIRST + 1;
const MULTICAST: u8 = FIRST + 2;

/// The group of SPDP (RTPS 2.5 section 9.6.2.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// The largest UDP datagram.
const DATAGRAM_MAX: usize = 65_536;
/// A participant's traffic is reported to the layer at most this often.
const SEEN_PERIOD: Duration = Duration::from_millis(500);

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
    sockets: Sockets,
    interfaces: Vec<Interface>,
    inbox: VecDeque<FromLayer>,
    incoming: Vec<u8>,
    outgoing: Vec<u8>,
    seen: (GuidPrefix, Instant),
}

impl InProcessLink {
    /// Opens sockets on the ports of the first free participant id and starts the layer.
    pub(super) fn open(settings: &Settings, epoll: &Arc<Epoll>) -> Result<Self, InProcessError> {
        let now = Instant::now();
        let interfaces = interfaces::chosen()?;
        let sockets = Sockets::open(settings.domain, &interfaces)?;
        sockets.register(epoll, [USER, METATRAFFIC, MULTICAST])?;
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
            sockets,
            interfaces,
            inbox: VecDeque::new(),
            incoming: vec![0; DATAGRAM_MAX],
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
                LayerOutput::Kernel(_) | LayerOutput::Store(_) => {}
            }
        }
    }

    fn send_metatraffic(&self, transmit: &Transmit) {
        for destination in transmit.destinations.iter() {
            match destination {
                SocketAddr::V4(group) if group.ip().is_multicast() => self.send_to_group(*group),
                SocketAddr::V4(_) => {
                    let socket = &self.sockets.metatraffic;
                    if let Err(error) = socket.send_to(&self.outgoing, destination) {
                        log_send_error(*destination, self.outgoing.len(), &error);
                    }
                }
                // The sockets are IPv4 ones.
                SocketAddr::V6(_) => {}
            }
        }
    }

    /// Sends to a group on every interface: which of them leads to others nobody knows.
    fn send_to_group(&self, group: SocketAddrV4) {
        let socket = &self.sockets.metatraffic;
        for interface in &self.interfaces {
            let Some(source) = interface.addresses.first() else {
                continue;
            };
            let from = (interface.index, *source);
            if let Err(error) = udp::send_multicast(socket, from, group, &self.outgoing) {
                log_send_error(group.into(), self.outgoing.len(), &error);
            }
        }
    }

    fn receive_user(&mut self, now: Instant, sink: &mut Sink<'_>) {
        match udp::receive_now(&self.sockets.user, &mut self.incoming) {
            Ok((len, source)) => {
                let datagram = self.incoming.get(..len).unwrap_or_default();
                self.note_traffic(now, source_prefix(datagram));
                let datagram = self.incoming.get(..len).unwrap_or_default();
                sink(source, datagram);
            }
            Err(error) => log_receive_error(&error),
        }
    }

    /// Samples are a sign of life, too.
    fn note_traffic(&mut self, now: Instant, participant: Option<GuidPrefix>) {
        let Some(participant) = participant else {
            return;
        };
        if self.seen.0 != participant || now.saturating_duration_since(self.seen.1) > SEEN_PERIOD {
            self.seen = (participant, now);
            self.layer.seen(now, participant);
        }
    }

    fn receive_metatraffic(&mut self, now: Instant, number: u8) {
        let socket = match number {
            METATRAFFIC => &self.sockets.metatraffic,
            _ => &self.sockets.multicast,
        };
        match udp::receive_now(socket, &mut self.incoming) {
            Ok((len, source)) => {
                let datagram = self.incoming.get(..len).unwrap_or_default();
                if let Err(error) = self.layer.handle_datagram(now, source, datagram) {
                    tracing::debug!(%source, len, %error, "discovery datagram refused");
                }
                self.pump(now);
            }
            Err(error) => log_receive_error(&error),
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

    fn send(&mut self, transmit: &Transmit, datagram: &[u8]) {
        for destination in transmit.destinations.iter().filter(|to| to.is_ipv4()) {
            if let Err(error) = self.sockets.user.send_to(datagram, destination) {
                log_send_error(*destination, datagram.len(), &error);
            }
        }
    }

    /// One datagram of each readable socket: reading until there is none would cost one more system call a sample.
    fn receive(&mut self, now: Instant, wakeups: Wakeups, sink: &mut Sink<'_>) {
        if wakeups.contains(USER) {
            self.receive_user(now, sink);
        }
        for number in [METATRAFFIC, MULTICAST] {
            if wakeups.contains(number) {
                self.receive_metatraffic(now, number);
            }
        }
    }

    fn prepare_sleep(&mut self) -> bool {
        true
    }

    fn awake(&mut self) {}

    fn poll_timeout(&self) -> Option<Instant> {
        self.layer.poll_timeout()
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
    // Only where there is nothing else, others of this host are told to use the loopback interface.
    let is_alone = interfaces.iter().all(|interface| interface.is_loopback);
    let addresses = || {
        let announced = interfaces
            .iter()
            .filter(|interface| is_alone || !interface.is_loopback);
        announced.flat_map(|interface| &interface.addresses)
    };
    let at = |port| {
        addresses()
            .map(|ip| SocketAddr::from((*ip, port)))
            .collect()
    };
    let mtu = interfaces.iter().map(|interface| interface.mtu).min();
    let mut config = LayerConfig::new(
        GuidPrefix(guid_prefix()?),
        settings.domain,
        (Ipv4Addr::LOCALHOST, user).into(),
    );
    config.name.clone_from(&settings.name);
    config.metatraffic = at(metatraffic);
    config.user = at(user);
    config.peers.clone_from(&settings.peers);
    config.multicast = Some((GROUP, sockets::multicast_port(settings.domain)).into());
    config.datagram_size = interfaces::datagram_size(mtu);
    Ok(config)
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
