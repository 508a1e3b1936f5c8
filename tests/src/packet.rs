//! Packets for the kernel verdict tables: RTPS messages, and the frames that carry them.
//!
//! Built by hand, little endian, so that a test can lie about any length or number. Lengths and
//! offsets are in bytes, ports and IP fields in host order until they are written.

use std::net::{IpAddr, SocketAddr};

/// A GUID prefix.
pub type Prefix = [u8; 12];
/// An entity id.
pub type Entity = [u8; 4];

/// No entity in particular.
pub const ANYBODY: Entity = [0; 4];
/// The SPDP writer.
pub const SPDP_WRITER: Entity = [0, 1, 0, 0xc2];
/// The SPDP reader.
pub const SPDP_READER: Entity = [0, 1, 0, 0xc7];

/// Reader and writer of the built-in topics with reliable endpoints: publications, subscriptions,
/// participant messages.
pub const BUILTIN_TOPICS: [(Entity, Entity); 3] = [
    ([0, 0, 3, 0xc7], [0, 0, 3, 0xc2]),
    ([0, 0, 4, 0xc7], [0, 0, 4, 0xc2]),
    ([0, 2, 0, 0xc7], [0, 2, 0, 0xc2]),
];

const ETHERNET: usize = 14;
const LOCAL_EXPERIMENTAL: u16 = 0x88b5;

/// An app's reader.
#[must_use]
pub fn reader_of(slot: u8) -> Entity {
    [slot, 0, 1, 0x04]
}

/// An app's writer.
#[must_use]
pub fn writer_of(slot: u8) -> Entity {
    [slot, 0, 2, 0x03]
}

/// An RTPS message under construction.
#[derive(Clone, Debug)]
pub struct Message(Vec<u8>);

impl Message {
    /// A header only.
    #[must_use]
    pub fn from(prefix: Prefix) -> Self {
        let mut bytes = b"RTPS\x02\x05\x01\x10".to_vec();
        bytes.extend_from_slice(&prefix);
        Self(bytes)
    }

    /// A submessage with the length that its body has.
    #[must_use]
    pub fn submessage(self, id: u8, flags: u8, fields: &[&[u8]]) -> Self {
        let len = fields.concat().len();
        self.lying(id, flags, u16::try_from(len).unwrap_or(0), fields)
    }

    /// A submessage with any length in its header.
    #[must_use]
    pub fn lying(mut self, id: u8, flags: u8, len: u16, fields: &[&[u8]]) -> Self {
        self.0.extend_from_slice(&[id, flags | 1]);
        self.0.extend_from_slice(&len.to_le_bytes());
        self.0.extend_from_slice(&fields.concat());
        self
    }

    /// INFO_DST.
    #[must_use]
    pub fn destination(self, prefix: Prefix) -> Self {
        self.submessage(0x0e, 0, &[&prefix])
    }

    /// INFO_SRC.
    #[must_use]
    pub fn source(self, prefix: Prefix) -> Self {
        self.submessage(0x0c, 0, &[&[0, 0, 0, 0, 2, 5, 1, 16], &prefix])
    }

    /// DATA with sequence number 1 and a payload of `len` bytes.
    #[must_use]
    pub fn data(self, reader: Entity, writer: Entity, len: usize) -> Self {
        let payload: Vec<u8> = (0..len).map(|i| i as u8).collect();
        let fields: [&[u8]; 5] = [&[0, 0, 16, 0], &reader, &writer, &number(1), &payload];
        // Longer than its header can say: the rest of the message.
        self.submessage(0x15, 4, &fields)
    }

    /// DATA_FRAG of sequence number 1: fragments `start..start + count` of `size` bytes.
    #[must_use]
    pub fn data_frag(self, reader: Entity, fragments: [u32; 4], payload: usize) -> Self {
        let [start, count, size, sample] = fragments;
        self.submessage(
            0x16,
            0,
            &[
                &[0, 0, 28, 0],
                &reader,
                &writer_of(0),
                &number(1),
                &start.to_le_bytes(),
                &(count as u16).to_le_bytes(),
                &(size as u16).to_le_bytes(),
                &sample.to_le_bytes(),
                &vec![0; payload],
            ],
        )
    }

    /// HEARTBEAT.
    #[must_use]
    pub fn heartbeat(self, reader: Entity, writer: Entity, first: i64, last: i64) -> Self {
        self.submessage(
            0x07,
            0,
            &[
                &reader,
                &writer,
                &number(first),
                &number(last),
                &[1, 0, 0, 0],
            ],
        )
    }

    /// ACKNACK with `words` words of bitmap, whatever `bits` says.
    #[must_use]
    pub fn acknack(self, writer: Entity, base: i64, bits: u32, words: usize) -> Self {
        self.submessage(
            0x06,
            0,
            &[
                &reader_of(0),
                &writer,
                &number(base),
                &bits.to_le_bytes(),
                &vec![0xff; words * 4],
                &[1, 0, 0, 0],
            ],
        )
    }

    /// GAP with an empty bitmap, whatever `bits` says.
    #[must_use]
    pub fn gap(self, reader: Entity, start: i64, base: i64, bits: u32) -> Self {
        self.submessage(
            0x08,
            0,
            &[
                &reader,
                &writer_of(0),
                &number(start),
                &number(base),
                &bits.to_le_bytes(),
            ],
        )
    }

    /// The announcement of a participant that receives discovery traffic at `locator`, and says `more`
    /// bytes of something.
    #[must_use]
    pub fn announcement(self, prefix: Prefix, locator: SocketAddr, more: &[u8]) -> Self {
        let (kind, address): (u8, _) = match locator.ip() {
            IpAddr::V4(address) => (1, [&[0; 12][..], &address.octets()].concat()),
            IpAddr::V6(address) => (2, address.octets().to_vec()),
        };
        let port = u32::from(locator.port()).to_le_bytes();
        let locator = [&[kind, 0, 0, 0][..], &port, &address].concat();
        let guid = [&prefix[..], &[0, 0, 1, 0xc1]].concat();
        let payload = [
            &[0, 3, 0, 0][..],
            &parameter(0x50, &guid),
            &parameter(0x32, &locator),
            &parameter(0x2c, more),
            &parameter(1, &[]),
        ];
        self.sample(SPDP_WRITER, 1, &payload.concat())
    }

    /// DATA to all readers of a writer.
    #[must_use]
    pub fn sample(self, writer: Entity, sequence: i64, payload: &[u8]) -> Self {
        let fields: [&[u8]; 5] = [
            &[0, 0, 16, 0],
            &ANYBODY,
            &writer,
            &number(sequence),
            payload,
        ];
        self.submessage(0x15, 4, &fields)
    }

    /// ACKNACK from a reader that has all below `base`, and asks for as many numbers as `bits`, at most
    /// 32.
    #[must_use]
    pub fn request(self, (reader, writer): (Entity, Entity), base: i64, bits: u32) -> Self {
        let mask = u32::MAX.checked_shl(32 - bits).unwrap_or(0);
        let fields: [&[u8]; 6] = [
            &reader,
            &writer,
            &number(base),
            &bits.to_le_bytes(),
            &mask.to_le_bytes(),
            &[1, 0, 0, 0],
        ];
        self.submessage(0x06, 0, &fields)
    }

    /// Bytes of no submessage.
    #[must_use]
    pub fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    /// The first `len` bytes.
    #[must_use]
    pub fn truncated(&self, len: usize) -> Self {
        Self(self.0.iter().copied().take(len).collect())
    }

    /// With one byte overwritten.
    #[must_use]
    pub fn with(mut self, index: usize, value: u8) -> Self {
        if let Some(byte) = self.0.get_mut(index) {
            *byte = value;
        }
        self
    }

    /// What goes into the datagram.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// One submessage of a message: submessageId, and what follows its header.
pub type Submessage<'a> = (u8, &'a [u8]);

/// The submessages of a valid message in little endian.
#[must_use]
pub fn submessages(message: &[u8]) -> Vec<Submessage<'_>> {
    let mut rest = message.get(20..).unwrap_or_default();
    let mut found = Vec::new();
    while let [id, _, a, b, body @ ..] = rest {
        let len = usize::from(u16::from_le_bytes([*a, *b])).min(body.len());
        let (body, behind) = body.split_at(len);
        found.push((*id, body));
        rest = behind;
    }
    found
}

fn parameter(id: u16, value: &[u8]) -> Vec<u8> {
    let len = value.len() as u16;
    [&id.to_le_bytes()[..], &len.to_le_bytes(), value].concat()
}

/// A SequenceNumber_t in little endian: high word first.
#[must_use]
pub fn number(value: i64) -> [u8; 8] {
    let [high, low] = [(value >> 32) as u32, value as u32].map(u32::to_le_bytes);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&high);
    bytes[4..].copy_from_slice(&low);
    bytes
}

/// An Ethernet frame with a UDP datagram, to be varied by its setters.
#[derive(Clone, Debug)]
pub struct Frame {
    vlan_tags: usize,
    version: IpVersion,
    ip_options: usize,
    fragment: u16,
    protocol: u8,
    destination_port: u16,
    /// Added to the length in the UDP header.
    udp_surplus: i32,
}

#[derive(Clone, Debug)]
enum IpVersion {
    V4 { destination: [u8; 4] },
    V6 { destination: [u8; 16] },
    Other { ethertype: u16 },
}

impl Frame {
    /// The address that all IPv4 frames come from.
    pub const SOURCE_V4: [u8; 4] = [192, 0, 2, 1];
    /// The address that all IPv6 frames come from: 2001:db8::1.
    pub const SOURCE_V6: [u8; 16] = [0x20, 1, 0xd, 0xb8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
    /// The port that all frames come from.
    pub const SOURCE_PORT: u16 = 0x4567;

    /// Over IPv4.
    #[must_use]
    pub fn v4(destination: [u8; 4], destination_port: u16) -> Self {
        Self {
            vlan_tags: 0,
            version: IpVersion::V4 { destination },
            ip_options: 0,
            fragment: 0,
            protocol: 17,
            destination_port,
            udp_surplus: 0,
        }
    }

    /// Over IPv6.
    #[must_use]
    pub fn v6(destination: [u8; 16], destination_port: u16) -> Self {
        Self {
            version: IpVersion::V6 { destination },
            ..Self::v4([0; 4], destination_port)
        }
    }

    /// With another ethertype than IP's.
    #[must_use]
    pub fn ethertype(ethertype: u16) -> Self {
        Self {
            version: IpVersion::Other { ethertype },
            ..Self::v4([0; 4], 0)
        }
    }

    /// Below this many VLAN tags.
    #[must_use]
    pub fn vlan_tags(self, vlan_tags: usize) -> Self {
        Self { vlan_tags, ..self }
    }

    /// With this many words of IPv4 options.
    #[must_use]
    pub fn ip_options(self, ip_options: usize) -> Self {
        Self { ip_options, ..self }
    }

    /// With these bits in IPv4's fragment field.
    #[must_use]
    pub fn fragment(self, fragment: u16) -> Self {
        Self { fragment, ..self }
    }

    /// With another protocol than UDP.
    #[must_use]
    pub fn protocol(self, protocol: u8) -> Self {
        Self { protocol, ..self }
    }

    /// With a UDP length that is wrong by so much.
    #[must_use]
    pub fn udp_surplus(self, udp_surplus: i32) -> Self {
        Self {
            udp_surplus,
            ..self
        }
    }

    /// Offset of the UDP header.
    #[must_use]
    pub fn udp_offset(&self) -> usize {
        let ip = match self.version {
            IpVersion::V4 { .. } => 20 + self.ip_options * 4,
            IpVersion::V6 { .. } => 40,
            IpVersion::Other { .. } => 0,
        };
        ETHERNET + self.vlan_tags * 4 + ip
    }

    /// The frame with a payload.
    #[must_use]
    pub fn carrying(&self, payload: &[u8]) -> Vec<u8> {
        let udp_len = (payload.len() as i32 + 8 + self.udp_surplus) as u16;
        let udp = udp_header(self.destination_port, udp_len);
        let ip = self.ip_header(udp.len() + payload.len());
        [&self.ethernet_header()[..], &ip, &udp, payload].concat()
    }

    fn ethernet_header(&self) -> Vec<u8> {
        let mut bytes = vec![2, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 1];
        for _ in 0..self.vlan_tags {
            bytes.extend_from_slice(&[0x81, 0x00, 0, 7]);
        }
        let ethertype: u16 = match self.version {
            IpVersion::V4 { .. } => 0x0800,
            IpVersion::V6 { .. } => 0x86dd,
            IpVersion::Other { ethertype } => ethertype,
        };
        bytes.extend_from_slice(&ethertype.to_be_bytes());
        bytes
    }

    fn ip_header(&self, payload: usize) -> Vec<u8> {
        match self.version {
            IpVersion::V4 { destination } => {
                let len = 20 + self.ip_options * 4;
                let mut bytes = vec![0x45 + self.ip_options as u8, 0];
                bytes.extend_from_slice(&((len + payload) as u16).to_be_bytes());
                bytes.extend_from_slice(&[0, 0]);
                bytes.extend_from_slice(&self.fragment.to_be_bytes());
                bytes.extend_from_slice(&[64, self.protocol, 0, 0]);
                bytes.extend_from_slice(&Self::SOURCE_V4);
                bytes.extend_from_slice(&destination);
                bytes.resize(len, 1);
                bytes
            }
            IpVersion::V6 { destination } => {
                let mut bytes = vec![0x60, 0, 0, 0];
                bytes.extend_from_slice(&(payload as u16).to_be_bytes());
                bytes.extend_from_slice(&[self.protocol, 64]);
                bytes.extend_from_slice(&Self::SOURCE_V6);
                bytes.extend_from_slice(&destination);
                bytes
            }
            IpVersion::Other { .. } => Vec::new(),
        }
    }
}

/// What `BPF_PROG_TEST_RUN` needs to show a socket filter a datagram as a UDP socket does. A test
/// run strips the Ethernet header and no more, so the UDP header has to follow it at once; the
/// "IP header" in which the filter then finds the source address is the UDP header, too.
#[must_use]
pub fn at_socket(destination_port: u16, payload: &[u8]) -> Vec<u8> {
    let udp = udp_header(destination_port, (payload.len() + 8) as u16);
    // The kernel refuses to run on IP that is shorter than its header.
    let frame = if udp.len() + payload.len() < 20 {
        Frame::ethertype(LOCAL_EXPERIMENTAL)
    } else {
        Frame::v4([0; 4], 0)
    };
    [&frame.ethernet_header()[..], &udp, payload].concat()
}

/// The longest payload for which [`at_socket`] fits a test run.
pub const AT_SOCKET_MAX: usize = 3_000;

fn udp_header(destination_port: u16, len: u16) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..2].copy_from_slice(&Frame::SOURCE_PORT.to_be_bytes());
    bytes[2..4].copy_from_slice(&destination_port.to_be_bytes());
    bytes[4..6].copy_from_slice(&len.to_be_bytes());
    // A checksum that must not survive a change of the port.
    bytes[6..].copy_from_slice(&[0xab, 0xcd]);
    bytes
}
