//! A host with the tc program on its end of a veth pair, and a remote participant with a plain socket.

use std::{
    io::ErrorKind,
    net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket},
    os::fd::AsRawFd as _,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context as _, Result, ensure};
use nix::{
    ifaddrs::getifaddrs,
    net::if_::if_nametoindex,
    sys::socket::{
        AddressFamily, LinkAddr, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket,
        sockopt::ReuseAddr,
    },
};
use rtps_ebpf::{
    ABI_VERSION,
    abi::{
        Announcement, AnnouncementKey, BuiltinWriter, Config, DISCOVERY_KERNEL, DOORBELL_RING,
        INTERFACE_ANSWERS, Interface, PEER_PROVEN, Peer, SUBMESSAGE_BYTES, Sample, SampleKey, name,
    },
    entity::GuidPrefix,
    frame::mapped,
};
use rtps_tests::{
    link::Veth,
    netns::Netns,
    packet::{BUILTIN_TOPICS, Message},
};

use crate::layer::{
    ADDRESS_V4, Counts, DOMAIN, Layer, METATRAFFIC_PORT, MULTICAST_PORT, OWN, REMOTE, Record,
};

pub(crate) const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
pub(crate) const REMOTE_V4: Ipv4Addr = Ipv4Addr::new(192, 0, 2, 1);
/// Of the remote's socket.
pub(crate) const REPLY_PORT: u16 = 5_555;
/// rtpsd will live for as long as a test.
pub(crate) const FOR_EVER: u64 = u64::MAX;
/// On a busy machine.
const PATIENCE: Duration = Duration::from_secs(5);
/// Within this the answers to a message that has been dealt with have come.
const SILENCE: Duration = Duration::from_millis(50);
/// One of these is counted for each message that the layer deals with.
const CONCLUSIONS: [&str; 8] = [
    "discovery_quiet",
    "discovery_news",
    "discovery_unknown",
    "lost_news_full",
    "budget_new",
    "drop_foreign_source",
    "drop_malformed",
    "drop_unroutable",
];

/// What came of a message.
#[derive(Debug)]
pub(crate) struct Heard {
    /// Datagrams that the remote got, and where from.
    pub(crate) answers: Vec<(SocketAddr, Vec<u8>)>,
    pub(crate) news: Vec<Record>,
    pub(crate) counts: Counts,
}

pub(crate) struct Stage {
    pub(crate) host: Netns,
    pub(crate) remote: Netns,
    pub(crate) veth: Veth,
    pub(crate) layer: Layer,
    /// The host's end of the pair.
    ifindex: u32,
}

impl Stage {
    pub(crate) fn new() -> Result<Self> {
        let (host, remote) = (Netns::new("host")?, Netns::new("remote")?);
        let veth = Veth::between(&host, &remote, ADDRESS_V4.into(), REMOTE_V4, 1_500)?;
        remote.ip(&format!("route add 224.0.0.0/4 dev {}", veth.b.name))?;
        let mut layer = Layer::new(DOORBELL_RING)?;
        layer.own_address(veth.a.v6.octets())?;
        let interface = &veth.a;
        let ifindex = host.enter(|| if_nametoindex(interface.name.as_str()))?;
        layer.reset_counters_of(ifindex)?;
        let who = Interface {
            mac: hardware_address(&host, &interface.name)?
                .addr()
                .context("no hardware address")?,
            tasks: INTERFACE_ANSWERS,
            ipv4: interface.v4.octets(),
            ipv6: interface.v6.octets(),
            ..Interface::default()
        };
        layer.insert(name::INTERFACES, ifindex, who)?;
        host.enter(|| layer.attach_ingress(&interface.name))?;
        let mut stage = Self {
            host,
            remote,
            veth,
            layer,
            ifindex,
        };
        stage.set_life_of_rtpsd(FOR_EVER)?;
        stage.announce()?;
        Ok(stage)
    }

    /// Until when the kernel may answer.
    pub(crate) fn set_life_of_rtpsd(&mut self, answer_until_ns: u64) -> Result<()> {
        self.layer.configure(Config {
            abi_version: ABI_VERSION,
            doorbell: DOORBELL_RING,
            discovery: DISCOVERY_KERNEL,
            any_source: 0,
            answer_until_ns,
        })
    }

    /// Publishes the host's participant, and that its built-in writers have nothing.
    fn announce(&mut self) -> Result<()> {
        let (bytes, len) = padded(own_announcement().bytes());
        let announcement = Announcement {
            bytes,
            len,
            reserved: 0,
        };
        let key = AnnouncementKey {
            domain_index: DOMAIN,
            ifindex: self.ifindex,
        };
        self.layer.insert(name::ANNOUNCEMENTS, key, announcement)?;
        (0..3).try_for_each(|number| self.publish(number, 1, 0))
    }

    /// The range of a built-in writer.
    pub(crate) fn publish(&mut self, number: u32, first: u64, last: u64) -> Result<()> {
        let writer = BuiltinWriter {
            first,
            last,
            ..BuiltinWriter::default()
        };
        self.layer.set(name::WRITERS, DOMAIN * 3 + number, writer)
    }

    /// A sample of a built-in writer with a payload of `len` bytes.
    pub(crate) fn store(&mut self, number: u32, sequence: u64, len: usize) -> Result<()> {
        let (_, writer) = BUILTIN_TOPICS[number as usize];
        let message = Message::from(OWN).sample(writer, sequence as i64, &vec![7; len]);
        let (bytes, len) = padded(message.bytes());
        let sample = Sample {
            bytes,
            len,
            reserved: 0,
            timestamp: [1; 8],
        };
        let key = SampleKey {
            domain_index: DOMAIN,
            writer: number,
            sequence,
        };
        self.layer.insert(name::SAMPLES, key, sample)
    }

    /// The remote, discovered, at its address.
    pub(crate) fn know_remote(&mut self) -> Result<()> {
        let mut peer = Peer {
            reply_port: REPLY_PORT.into(),
            flags: PEER_PROVEN,
            ..Peer::default()
        };
        peer.addresses[0] = mapped(REMOTE_V4.octets());
        self.layer.insert(name::PEERS, REMOTE, peer)
    }

    pub(crate) fn peer(&mut self) -> Result<Peer> {
        let peer = self.layer.get(name::PEERS, REMOTE)?;
        peer.context("the remote is no peer")
    }

    pub(crate) fn stranger(&mut self, prefix: GuidPrefix) -> Result<Option<Peer>> {
        self.layer.get(name::STRANGERS, prefix)
    }

    /// A socket of the remote.
    pub(crate) fn socket(&self, address: impl Into<IpAddr> + Send) -> Result<UdpSocket> {
        let address = SocketAddr::new(address.into(), REPLY_PORT);
        let socket = self.remote.enter(|| UdpSocket::bind(address))?;
        socket.set_read_timeout(Some(SILENCE))?;
        Ok(socket)
    }

    /// A socket of the host that has joined the group, like another DDS stack's.
    pub(crate) fn member(&self) -> Result<UdpSocket> {
        let member = self.host.enter(|| -> Result<UdpSocket> {
            let member = socket(
                AddressFamily::Inet,
                SockType::Datagram,
                SockFlag::empty(),
                None,
            )?;
            setsockopt(&member, ReuseAddr, &true)?;
            bind(
                member.as_raw_fd(),
                &SockaddrIn::new(0, 0, 0, 0, MULTICAST_PORT),
            )?;
            Ok(UdpSocket::from(member))
        })?;
        member.join_multicast_v4(&GROUP, &self.veth.a.v4)?;
        member.set_read_timeout(Some(SILENCE))?;
        Ok(member)
    }

    /// Sends a message to the host's port for discovery, and waits until it has been dealt with.
    pub(crate) fn tell(&mut self, socket: &UdpSocket, message: &Message) -> Result<Heard> {
        let host = SocketAddr::new(self.veth.a.v4.into(), METATRAFFIC_PORT);
        self.tell_at(socket, host, message)
    }

    pub(crate) fn tell_at(
        &mut self,
        socket: &UdpSocket,
        to: SocketAddr,
        message: &Message,
    ) -> Result<Heard> {
        self.layer.reset_counters_of(self.ifindex)?;
        socket.send_to(message.bytes(), to)?;
        self.hear(socket)
    }

    /// What comes of a message that has been sent.
    pub(crate) fn hear(&mut self, socket: &UdpSocket) -> Result<Heard> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let counts = self.layer.counts_of(self.ifindex)?;
            if CONCLUSIONS.iter().any(|name| counts.contains_key(name)) {
                break;
            }
            ensure!(Instant::now() < deadline, "nothing happens: {counts:?}");
            thread::sleep(Duration::from_millis(1));
        }
        Ok(Heard {
            answers: receive(socket)?,
            news: self.layer.news(),
            counts: self.layer.counts_of(self.ifindex)?,
        })
    }

    pub(crate) fn reset_counters(&mut self) -> Result<()> {
        self.layer.reset_counters_of(self.ifindex)
    }
}

/// Everything that a socket gets until nothing more comes.
pub(crate) fn receive(socket: &UdpSocket) -> Result<Vec<(SocketAddr, Vec<u8>)>> {
    let mut buffer = [0; 2_048];
    let mut received = Vec::new();
    loop {
        match socket.recv_from(&mut buffer) {
            Ok((len, from)) => received.push((from, buffer[..len].to_vec())),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(received),
            Err(error) => return Err(error.into()),
        }
    }
}

/// What the host says of itself.
pub(crate) fn own_announcement() -> Message {
    let locator = SocketAddr::new(Ipv4Addr::from(ADDRESS_V4).into(), METATRAFFIC_PORT);
    Message::from(OWN)
        .submessage(0x09, 0, &[&[1; 8]])
        .announcement(OWN, locator, &[9; 100])
}

/// What the remote says of itself.
pub(crate) fn announcement(prefix: GuidPrefix, more: &[u8]) -> Message {
    let locator = SocketAddr::new(REMOTE_V4.into(), REPLY_PORT);
    Message::from(prefix).announcement(prefix, locator, more)
}

/// The link-layer address of an interface.
pub(crate) fn hardware_address(netns: &Netns, interface: &str) -> Result<LinkAddr> {
    netns.enter(|| {
        getifaddrs()?
            .filter(|found| found.interface_name == interface)
            .find_map(|found| found.address?.as_link_addr().copied())
            .context("an interface without a link-layer address")
    })
}

/// The submessages of a message in a field of the ABI, and how many bytes they are.
fn padded(message: &[u8]) -> ([u8; SUBMESSAGE_BYTES], u32) {
    let submessages = &message[20..];
    let mut bytes = [0; SUBMESSAGE_BYTES];
    bytes[..submessages.len()].copy_from_slice(submessages);
    (bytes, submessages.len() as u32)
}
