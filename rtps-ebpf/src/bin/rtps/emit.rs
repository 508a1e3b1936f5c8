//! How an answer leaves: the frame that asked is overwritten, a copy of it sent, and what others still
//! have to see is put back.
//!
//! A packet cannot be made from nothing at this hook, and XDP could only turn the one frame around
//! (and on a veth not even that: what XDP_TX sends is lost when the other end has no XDP program).
//! Here the copy takes the way of every packet that the host sends, on any kind of Ethernet interface,
//! and keeps the VLAN tag, which lies beside the frame. Overwriting before copying, and not in a
//! program on egress, costs the traffic that is sent nothing, and no request can leave as it came.

use rtps_ebpf::{
    Bytes as _,
    abi::Interface,
    frame::{Datagram, UDP_CHECKSUM, UDP_LEN, mapped},
    reply::{Flow, IPV4_HEAD, IPV6_HEAD},
};

use crate::sys::{self, LinkBuffer};

/// Bytes of the two hardware addresses in an Ethernet header.
const ADDRESSES_LEN: usize = 12;
/// Answers are numbered by the time in units of 4 us: a number comes back after a quarter of a second.
const IDENTIFICATION_SHIFT: u32 = 12;
/// The most bytes of a frame that can be put back; jumbo frames fit.
pub(crate) const ORIGINAL_BYTES: usize = 9_728;

/// What becomes of the frame that asked. In a map, because the stack is too small.
#[repr(C)]
pub(crate) struct Reply {
    request: Datagram,
    flow: Flow,
    /// The frame is no longer what it was.
    pub(crate) has_begun: bool,
    /// Hardware address of the interface.
    mac: [u8; 6],
    /// Destination and source of the Ethernet header.
    hardware: [u8; ADDRESSES_LEN],
    /// The link adds the rest of the UDP checksum.
    completes_checksum: bool,
    ipv4_head: [u8; IPV4_HEAD],
    ipv6_head: [u8; IPV6_HEAD],
    original: [u8; ORIGINAL_BYTES],
}

/// Where answers to a datagram come from; `None` where the interface has no such address.
#[inline(always)]
fn source_of_answers(request: &Datagram, interface: &Interface) -> Option<[u8; 16]> {
    if !request.multicast {
        return Some(request.destination);
    }
    if request.ipv4 {
        return (interface.ipv4 != [0; 4]).then_some(mapped(interface.ipv4));
    }
    let link_local = request.source[0] == 0xfe && request.source[1] & 0xc0 == 0x80;
    let source = if link_local {
        interface.ipv6_link_local
    } else {
        interface.ipv6
    };
    (source != [0; 16]).then_some(source)
}

impl Reply {
    /// For answers to `request`, which came at `now_ns`, from a port of this host; fails where the interface has no
    /// address for them.
    #[inline(always)]
    pub(crate) fn prepare(
        &mut self,
        request: &Datagram,
        interface: &Interface,
        source_port: u16,
        now_ns: u64,
    ) -> Result<(), ()> {
        self.has_begun = false;
        self.request = *request;
        self.mac = interface.mac;
        self.flow = Flow {
            source: source_of_answers(request, interface).ok_or(())?,
            destination: request.source,
            source_port,
            destination_port: 0,
            identification: (now_ns >> IDENTIFICATION_SHIFT) as u16,
        };
        Ok(())
    }

    /// Keeps the frame when it is to be put back. After this it must be, or be dropped.
    #[inline(never)]
    pub(crate) fn begin(&mut self, buffer: &LinkBuffer, destination_port: u16) -> Result<(), ()> {
        let [d0, d1, d2, d3, d4, d5, s0, s1, s2, s3, s4, s5] =
            buffer.load::<ADDRESSES_LEN>(0).ok_or(())?;
        let [o0, o1, o2, o3, o4, o5] = if self.request.multicast {
            buffer.copy_whole(&mut self.original)?;
            self.mac
        } else {
            [d0, d1, d2, d3, d4, d5]
        };
        self.has_begun = true;
        self.flow.destination_port = destination_port;
        self.hardware = [s0, s1, s2, s3, s4, s5, o0, o1, o2, o3, o4, o5];
        self.completes_checksum = buffer.completes_checksum(self.request.udp + UDP_CHECKSUM);
        Ok(())
    }

    /// Sends the first `len` bytes of `payload`, a multiple of 4.
    #[inline(always)]
    pub(crate) fn send<const N: usize>(
        &mut self,
        buffer: &LinkBuffer,
        payload: &[u8; N],
        len: u32,
    ) -> Result<(), ()> {
        let payload_at = self.request.udp + UDP_LEN;
        self.flow.identification = self.flow.identification.wrapping_add(1);
        let checksum = self.checksum(payload, len as u16);
        buffer.resize(payload_at + len)?;
        buffer.store_some(payload_at, payload, len)?;
        self.store_headers(buffer, len as u16, checksum)?;
        buffer.send(buffer.ifindex())
    }

    #[inline(always)]
    fn store_headers(&mut self, buffer: &LinkBuffer, len: u16, checksum: u16) -> Result<(), ()> {
        buffer.store(0, &self.hardware)?;
        if self.request.ipv4 {
            self.store_ipv4(buffer, len, checksum)
        } else {
            self.store_ipv6(buffer, len, checksum)
        }
    }

    #[inline(never)]
    fn store_ipv4(&mut self, buffer: &LinkBuffer, len: u16, checksum: u16) -> Result<(), ()> {
        self.ipv4_head = self.flow.ipv4_head(len, checksum);
        buffer.store(self.request.ip, &self.ipv4_head)
    }

    #[inline(never)]
    fn store_ipv6(&mut self, buffer: &LinkBuffer, len: u16, checksum: u16) -> Result<(), ()> {
        self.ipv6_head = self.flow.ipv6_head(len, checksum);
        buffer.store(self.request.ip, &self.ipv6_head)
    }

    /// Puts back what came in, if others have still to see it.
    #[inline(always)]
    pub(crate) fn restore(&self, buffer: &LinkBuffer) -> Result<(), ()> {
        if !self.has_begun || !self.request.multicast {
            return Ok(());
        }
        buffer.resize(buffer.len())?;
        buffer.store_some(0, &self.original, buffer.len())
    }

    /// What to write in place of the UDP checksum; IPv4 may go without.
    #[inline(never)]
    fn checksum<const N: usize>(&self, payload: &[u8; N], len: u16) -> u16 {
        if self.completes_checksum {
            self.flow.checksum_seed(len)
        } else if self.request.ipv4 {
            0
        } else {
            self.flow.udp_checksum(len, sys::sum(payload, len.into()))
        }
    }
}
