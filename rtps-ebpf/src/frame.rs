//! Ethernet, IP and UDP, as far as it takes to find an RTPS message for this host.
//!
//! Whatever is unusual here is left to the kernel's own stack, under a counter that says why.

use crate::{bytes::Bytes, counter::Counter};

/// Bytes of an Ethernet header without a VLAN tag.
pub const ETHERNET_LEN: u32 = 14;
const ETHERTYPE_OFFSET: u32 = 12;
const VLAN_TAG_LEN: u32 = 4;
const ETHERTYPE_IPV4: u16 = 0x0800;
const ETHERTYPE_IPV6: u16 = 0x86dd;
const ETHERTYPE_VLAN: u16 = 0x8100;
const ETHERTYPE_SERVICE_VLAN: u16 = 0x88a8;
/// The IP protocol number of UDP.
pub const PROTOCOL_UDP: u8 = 17;
const IPV6_FRAGMENT_HEADER: u8 = 44;
/// Bytes of an IPv4 header without options.
pub const IPV4_MIN_LEN: u32 = 20;
/// Offset of the total length in an IPv4 header.
pub const IPV4_LENGTH: u32 = 2;
/// Offset of the checksum in an IPv4 header.
pub const IPV4_CHECKSUM: u32 = 10;
/// Offset of the source address in an IPv4 header.
pub const IPV4_SOURCE: u32 = 12;
/// Offset of the destination address in an IPv4 header.
pub const IPV4_DESTINATION: u32 = 16;
/// Bytes of an IPv6 header.
pub const IPV6_LEN: u32 = 40;
/// More-fragments flag and fragment offset.
const IPV4_FRAGMENT_MASK: u16 = 0x3fff;

/// Bytes of a UDP header.
pub const UDP_LEN: u32 = 8;
/// Offset of the destination port in a UDP header.
pub const UDP_DESTINATION: u32 = 2;
/// Offset of the length in a UDP header.
pub const UDP_LENGTH: u32 = 4;
/// Offset of the checksum in a UDP header.
pub const UDP_CHECKSUM: u32 = 6;

/// A UDP datagram in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram {
    /// Network order, IPv4 mapped.
    pub source: [u8; 16],
    /// Network order, IPv4 mapped.
    pub destination: [u8; 16],
    /// Whether it came over IPv4, so that its UDP checksum may be left out.
    pub ipv4: bool,
    /// Whether it is for a group, or for everyone.
    pub multicast: bool,
    /// Offset of the IP header in the frame.
    pub ip: u32,
    /// Offset of the UDP header in the frame.
    pub udp: u32,
    /// The UDP header.
    pub ports: Udp,
}

/// The fields of a UDP header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Udp {
    /// Host order.
    pub source: u16,
    /// Host order.
    pub destination: u16,
    /// Length of header and payload.
    pub len: u32,
}

/// An IP header and where it ends.
struct Ip {
    source: [u8; 16],
    destination: [u8; 16],
    ipv4: bool,
    multicast: bool,
    /// Offset of the IP payload in the frame.
    payload: u32,
    /// Length of the IP payload.
    len: u32,
}

/// Finds the UDP datagram in an Ethernet frame; what is not a whole one comes back as the counter
/// under which it is passed on.
#[inline(always)]
pub fn datagram(frame: &(impl Bytes + ?Sized)) -> Result<Datagram, Counter> {
    let (ethertype, offset) = network_header(frame).ok_or(Counter::PassNotIp)?;
    let ip = match ethertype {
        ETHERTYPE_IPV4 => ipv4(frame, offset)?,
        ETHERTYPE_IPV6 => ipv6(frame, offset)?,
        _ => return Err(Counter::PassNotIp),
    };
    let ports = udp(frame, ip.payload).ok_or(Counter::PassBadLengths)?;
    if ip.len > frame.len() - ip.payload || ports.len < UDP_LEN || ports.len > ip.len {
        return Err(Counter::PassBadLengths);
    }
    Ok(Datagram {
        source: ip.source,
        destination: ip.destination,
        ipv4: ip.ipv4,
        multicast: ip.multicast,
        ip: offset,
        udp: ip.payload,
        ports,
    })
}

/// Reads the UDP header at `offset`.
#[inline(always)]
pub fn udp(bytes: &(impl Bytes + ?Sized), offset: u32) -> Option<Udp> {
    let [s0, s1, d0, d1, l0, l1, ..] = bytes.load::<{ UDP_LEN as usize }>(offset)?;
    Some(Udp {
        source: u16::from_be_bytes([s0, s1]),
        destination: u16::from_be_bytes([d0, d1]),
        len: u32::from(u16::from_be_bytes([l0, l1])),
    })
}

/// An IPv4 address in the 16 bytes that all tables use.
#[inline(always)]
pub const fn mapped([a, b, c, d]: [u8; 4]) -> [u8; 16] {
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, a, b, c, d]
}

/// Ethertype and offset of what lies below at most two VLAN tags.
#[inline(always)]
fn network_header(frame: &(impl Bytes + ?Sized)) -> Option<(u16, u32)> {
    let outer = ethertype(frame, ETHERTYPE_OFFSET)?;
    if !is_vlan(outer) {
        return Some((outer, ETHERNET_LEN));
    }
    let inner = ethertype(frame, ETHERTYPE_OFFSET + VLAN_TAG_LEN)?;
    if !is_vlan(inner) {
        return Some((inner, ETHERNET_LEN + VLAN_TAG_LEN));
    }
    let innermost = ethertype(frame, ETHERTYPE_OFFSET + 2 * VLAN_TAG_LEN)?;
    Some((innermost, ETHERNET_LEN + 2 * VLAN_TAG_LEN))
}

#[inline(always)]
fn ethertype(frame: &(impl Bytes + ?Sized), offset: u32) -> Option<u16> {
    frame.load::<2>(offset).map(u16::from_be_bytes)
}

#[inline(always)]
const fn is_vlan(ethertype: u16) -> bool {
    ethertype == ETHERTYPE_VLAN || ethertype == ETHERTYPE_SERVICE_VLAN
}

#[inline(always)]
fn ipv4(frame: &(impl Bytes + ?Sized), offset: u32) -> Result<Ip, Counter> {
    let header = frame
        .load::<{ IPV4_MIN_LEN as usize }>(offset)
        .ok_or(Counter::PassBadLengths)?;
    let [
        version_ihl,
        _,
        t0,
        t1,
        _,
        _,
        f0,
        f1,
        _,
        protocol,
        _,
        _,
        addresses @ ..,
    ] = header;
    let [s0, s1, s2, s3, d0, d1, d2, d3] = addresses;
    let header_len = u32::from(version_ihl & 0xf) * 4;
    let total = u32::from(u16::from_be_bytes([t0, t1]));
    if version_ihl >> 4 != 4 || header_len < IPV4_MIN_LEN || total < header_len {
        return Err(Counter::PassBadLengths);
    }
    if protocol != PROTOCOL_UDP {
        return Err(Counter::PassNotUdp);
    }
    if u16::from_be_bytes([f0, f1]) & IPV4_FRAGMENT_MASK != 0 {
        return Err(Counter::PassFragment);
    }
    Ok(Ip {
        source: mapped([s0, s1, s2, s3]),
        destination: mapped([d0, d1, d2, d3]),
        ipv4: true,
        // 224.0.0.0/4, and the broadcast address; a subnet's broadcast is no address of ours.
        multicast: d0 >> 4 == 0xe || [d0, d1, d2, d3] == [0xff; 4],
        payload: offset + header_len,
        len: total - header_len,
    })
}

#[inline(always)]
fn ipv6(frame: &(impl Bytes + ?Sized), offset: u32) -> Result<Ip, Counter> {
    let [version, _, _, _, l0, l1, next_header, _] =
        frame.load::<8>(offset).ok_or(Counter::PassBadLengths)?;
    let source = frame
        .load::<16>(offset + 8)
        .ok_or(Counter::PassBadLengths)?;
    let destination = frame
        .load::<16>(offset + 24)
        .ok_or(Counter::PassBadLengths)?;
    if version >> 4 != 6 {
        return Err(Counter::PassBadLengths);
    }
    match next_header {
        PROTOCOL_UDP => {}
        IPV6_FRAGMENT_HEADER => return Err(Counter::PassFragment),
        _ => return Err(Counter::PassNotUdp),
    }
    Ok(Ip {
        source,
        destination,
        ipv4: false,
        multicast: destination[0] == 0xff,
        payload: offset + IPV6_LEN,
        len: u32::from(u16::from_be_bytes([l0, l1])),
    })
}
