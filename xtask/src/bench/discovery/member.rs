//! A participant that exists in discovery only: our own protocol core, with an address and a socket of its own.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use rtps_user::layer::protocol::{Endpoint, Hello, LAYER_PROTOCOL_VERSION, ToLayer};
use rtps_user::layer::{Layer, LayerConfig, LayerOutput};
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityId, EntityKind, GuidPrefix};

/// The group and port of SPDP in domain 0 (RTPS 2.5, 9.6.2.4.1).
pub(super) const GROUP: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::new(239, 255, 0, 1)), 7400);
/// How long others believe in a member without a sign of life.
pub(super) const LEASE: Duration = Duration::from_secs(10);
/// Longer than any datagram of discovery.
const LONGEST: usize = 65_536;

/// See the module.
pub(super) struct Member {
    layer: Layer,
    socket: UdpSocket,
    /// The last sign of life.
    pub(super) last_sent: Instant,
    pub(super) prefix: GuidPrefix,
    out: Vec<u8>,
}

/// Who a member is.
pub(super) struct Identity {
    pub(super) prefix: GuidPrefix,
    /// Its address.
    pub(super) own: Ipv4Addr,
    /// Where its announcements go beside the group.
    pub(super) peers: Vec<SocketAddr>,
    pub(super) announce_period: Duration,
}

impl Member {
    /// Starts with so many writers and readers; the first announcement is due at once.
    pub(super) fn new(now: Instant, identity: Identity, endpoints: u16) -> Result<Self> {
        let socket = UdpSocket::bind((identity.own, 0))?;
        socket.set_nonblocking(true)?;
        socket.set_multicast_loop_v4(false)?;
        let address = socket.local_addr()?;
        let config = LayerConfig {
            metatraffic: vec![address],
            user: vec![address],
            peers: identity.peers,
            multicast: vec![GROUP],
            lease: LEASE,
            announce_period: identity.announce_period,
            ..LayerConfig::new(identity.prefix, 0, address)
        };
        let mut member = Self {
            layer: Layer::new(config, now),
            socket,
            last_sent: now,
            prefix: identity.prefix,
            out: Vec::new(),
        };
        member.declare(now, endpoints)?;
        Ok(member)
    }

    fn declare(&mut self, now: Instant, endpoints: u16) -> Result<()> {
        let hello = Hello {
            version: LAYER_PROTOCOL_VERSION,
            domain: 0,
            name: "member".to_owned(),
            doorbell_port: 0,
            ring_bytes: 0,
            resume: None,
        };
        let welcome = self
            .layer
            .attach(now, &hello, [0; 16], &Default::default())
            .map_err(|reason| anyhow!(reason))?;
        for serial in 0..endpoints {
            for (kind, direction) in [
                (EntityKind::WriterWithKey, "In"),
                (EntityKind::ReaderWithKey, "Out"),
            ] {
                let endpoint = Endpoint {
                    entity: EntityId::of_app(welcome.slot, serial, kind),
                    topic: format!("{direction}{serial}"),
                    type_name: "ShapeType".to_owned(),
                    type_information: Vec::new(),
                    type_objects: Vec::new(),
                    content_filter: None,
                    qos: Qos::default(),
                };
                let declare = ToLayer::Declare(Box::new(endpoint));
                self.layer.handle_request(now, welcome.slot, declare);
            }
        }
        Ok(())
    }

    /// Where it receives.
    pub(super) fn socket(&self) -> &UdpSocket {
        &self.socket
    }

    /// Takes in everything that has come, and sends what is to be said to it.
    pub(super) fn receive(&mut self, now: Instant) -> io::Result<()> {
        let mut buffer = [0; LONGEST];
        loop {
            match self.socket.recv_from(&mut buffer) {
                Ok((length, source)) => self.take(now, source, &buffer[..length]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                // What was sent before found nobody.
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(error),
            }
        }
        self.send(now)
    }

    /// Takes in a datagram that came to the group.
    pub(super) fn take(&mut self, now: Instant, source: SocketAddr, datagram: &[u8]) {
        // What is malformed is the measured host's fault, which shows as an endpoint that never gets known.
        let _ = self.layer.handle_datagram(now, source, datagram);
    }

    /// Does what is due.
    pub(super) fn act(&mut self, now: Instant) -> io::Result<()> {
        self.layer.handle_timeout(now);
        self.send(now)
    }

    /// When [`Member::act`] is to be called.
    pub(super) fn due(&self) -> Option<Instant> {
        self.layer.poll_timeout()
    }

    /// Sends everything that waits.
    pub(super) fn send(&mut self, now: Instant) -> io::Result<()> {
        while let Some(datagram) = self.next_datagram(now) {
            for destination in datagram {
                self.send_to(destination)?;
            }
        }
        Ok(())
    }

    /// The first announcement, which is not sent.
    pub(super) fn announcement(&mut self, now: Instant) -> Vec<u8> {
        self.layer.handle_timeout(now);
        self.next_datagram(now);
        self.out.clone()
    }

    /// The announcement that ends the participant, which is not sent.
    pub(super) fn farewell(&mut self, now: Instant) -> Vec<u8> {
        self.layer.shutdown(now);
        self.next_datagram(now);
        self.out.clone()
    }

    /// The destinations of the next datagram, which is in the buffer then.
    fn next_datagram(&mut self, now: Instant) -> Option<Vec<SocketAddr>> {
        loop {
            if let LayerOutput::Transmit(transmit) = self.layer.poll_output(now, &mut self.out)? {
                return Some(transmit.destinations.to_vec());
            }
        }
    }

    fn send_to(&mut self, destination: SocketAddr) -> io::Result<()> {
        match self.socket.send_to(&self.out, destination) {
            Ok(_) => self.last_sent = Instant::now(),
            // The error is about an earlier datagram, or the link is full: as if it had got lost.
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::ConnectionRefused | io::ErrorKind::WouldBlock
                ) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }
}
