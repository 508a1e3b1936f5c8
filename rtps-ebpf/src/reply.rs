//! The headers of an answer: IPv4 or IPv6, and UDP (RFC 791, 8200, 768).
//!
//! Addresses are IPv4 mapped, as in all tables. The first twelve bytes of a mapped address sum up to
//! nothing (0xffff) in one's complement arithmetic, so that one sum serves both versions of IP.

use crate::frame::{IPV4_MIN_LEN, IPV6_LEN, PROTOCOL_UDP, UDP_LEN};

/// Bytes of an IPv4 and a UDP header.
pub const IPV4_HEAD: usize = (IPV4_MIN_LEN + UDP_LEN) as usize;
/// Bytes of an IPv6 and a UDP header.
pub const IPV6_HEAD: usize = (IPV6_LEN + UDP_LEN) as usize;
/// Routers between two hosts of a domain; what Linux uses by default.
const HOP_LIMIT: u8 = 64;

/// Whom an answer goes to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    /// Of this host.
    pub source: [u8; 16],
    /// Of the one who asked.
    pub destination: [u8; 16],
    /// Host order.
    pub source_port: u16,
    /// Host order.
    pub destination_port: u16,
    /// Tells the fragments of an IPv4 packet from those of others.
    pub identification: u16,
}

impl Flow {
    /// IPv4 and UDP header before `payload_len` bytes. Routers may fragment the packet: an answer fits the link that the
    /// request came by, but nobody would hear that it does not fit one behind it.
    #[inline(always)]
    pub const fn ipv4_head(&self, payload_len: u16, udp_checksum: u16) -> [u8; IPV4_HEAD] {
        let udp_len = payload_len + UDP_LEN as u16;
        let [t0, t1] = (udp_len + IPV4_MIN_LEN as u16).to_be_bytes();
        let [.., s0, s1, s2, s3] = self.source;
        let [.., d0, d1, d2, d3] = self.destination;
        let sum = 0x4500
            + u16::from_be_bytes([t0, t1]) as u32
            + self.identification as u32
            + u16::from_be_bytes([HOP_LIMIT, PROTOCOL_UDP]) as u32
            + sum_of(&self.source)
            + sum_of(&self.destination);
        let [c0, c1] = (!fold(sum)).to_be_bytes();
        let [i0, i1] = self.identification.to_be_bytes();
        let [u0, u1, u2, u3, u4, u5, u6, u7] = self.udp_header(udp_len, udp_checksum);
        [
            0x45,
            0,
            t0,
            t1,
            i0,
            i1,
            0,
            0,
            HOP_LIMIT,
            PROTOCOL_UDP,
            c0,
            c1, //
            s0,
            s1,
            s2,
            s3,
            d0,
            d1,
            d2,
            d3, //
            u0,
            u1,
            u2,
            u3,
            u4,
            u5,
            u6,
            u7,
        ]
    }

    /// IPv6 and UDP header before `payload_len` bytes.
    #[inline(always)]
    pub fn ipv6_head(&self, payload_len: u16, udp_checksum: u16) -> [u8; IPV6_HEAD] {
        let udp_len = payload_len + UDP_LEN as u16;
        let [l0, l1] = udp_len.to_be_bytes();
        let mut head = [0; IPV6_HEAD];
        head[..8].copy_from_slice(&[0x60, 0, 0, 0, l0, l1, PROTOCOL_UDP, HOP_LIMIT]);
        head[8..24].copy_from_slice(&self.source);
        head[24..40].copy_from_slice(&self.destination);
        head[40..].copy_from_slice(&self.udp_header(udp_len, udp_checksum));
        head
    }

    /// What stands in place of the checksum where the sender's hardware, or a virtual link, has still
    /// to add the rest: the sum of the pseudo-header.
    #[inline(always)]
    pub const fn checksum_seed(&self, payload_len: u16) -> u16 {
        fold(self.pseudo_header_sum(payload_len + UDP_LEN as u16))
    }

    /// The UDP checksum, given the folded sum of the payload's 16-bit words.
    #[inline(always)]
    pub const fn udp_checksum(&self, payload_len: u16, payload_sum: u16) -> u16 {
        let udp_len = payload_len + UDP_LEN as u16;
        let sum = self.pseudo_header_sum(udp_len)
            + self.source_port as u32
            + self.destination_port as u32
            + udp_len as u32
            + payload_sum as u32;
        match !fold(sum) {
            0 => 0xffff,
            checksum => checksum,
        }
    }

    #[inline(always)]
    const fn pseudo_header_sum(&self, udp_len: u16) -> u32 {
        sum_of(&self.source) + sum_of(&self.destination) + PROTOCOL_UDP as u32 + udp_len as u32
    }

    #[inline(always)]
    const fn udp_header(&self, udp_len: u16, checksum: u16) -> [u8; UDP_LEN as usize] {
        let [s0, s1] = self.source_port.to_be_bytes();
        let [d0, d1] = self.destination_port.to_be_bytes();
        let [l0, l1] = udp_len.to_be_bytes();
        let [c0, c1] = checksum.to_be_bytes();
        [s0, s1, d0, d1, l0, l1, c0, c1]
    }
}

/// One's complement sum of 16-bit words, down to 16 bits.
#[inline(always)]
pub const fn fold(sum: u32) -> u16 {
    let once = (sum & 0xffff) + (sum >> 16);
    ((once & 0xffff) + (once >> 16)) as u16
}

#[inline(always)]
const fn sum_of(address: &[u8; 16]) -> u32 {
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = *address;
    u16::from_be_bytes([a, b]) as u32
        + u16::from_be_bytes([c, d]) as u32
        + u16::from_be_bytes([e, f]) as u32
        + u16::from_be_bytes([g, h]) as u32
        + u16::from_be_bytes([i, j]) as u32
        + u16::from_be_bytes([k, l]) as u32
        + u16::from_be_bytes([m, n]) as u32
        + u16::from_be_bytes([o, p]) as u32
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::frame::{datagram, mapped};

    fn words(bytes: &[u8]) -> u32 {
        bytes
            .chunks(2)
            .map(|word| u32::from(u16::from_be_bytes([word[0], word[1]])))
            .sum()
    }

    fn framed(ethertype: [u8; 2], head: &[u8], payload: &[u8]) -> Vec<u8> {
        [&[0; 12][..], &ethertype, head, payload].concat()
    }

    const PAYLOAD: [u8; 6] = [0xff, 1, 2, 3, 4, 5];

    #[test]
    fn ipv4_headers_sum_up_and_are_read_back() {
        let flow = Flow {
            source: mapped([192, 0, 2, 1]),
            destination: mapped([198, 51, 100, 7]),
            source_port: 7410,
            destination_port: 40_000,
            identification: 0xfe01,
        };
        let checksum = flow.udp_checksum(6, fold(words(&PAYLOAD)));
        let head = flow.ipv4_head(6, checksum);
        assert_eq!(fold(words(&head[..20])), 0xffff);
        let pseudo_header = words(&head[12..20]) + 17 + 14;
        let udp = pseudo_header + words(&head[20..]) + words(&PAYLOAD);
        assert_eq!(fold(udp), 0xffff);
        assert_eq!(fold(pseudo_header), flow.checksum_seed(6));

        let frame = framed([8, 0], &head, &PAYLOAD);
        let found = datagram(&frame[..]).unwrap();
        assert_eq!(
            (found.source, found.destination),
            (flow.source, flow.destination)
        );
        assert_eq!(
            (found.ports.source, found.ports.destination),
            (7410, 40_000)
        );
        assert_eq!((found.ip, found.udp, found.ports.len), (14, 34, 14));
        assert_eq!(
            head[4..8],
            [0xfe, 0x01, 0, 0],
            "fragments can be told apart"
        );
    }

    #[test]
    fn ipv6_headers_sum_up_and_are_read_back() {
        let mut flow = Flow {
            source: [0xfd; 16],
            destination: [0xfe; 16],
            source_port: 1,
            destination_port: 2,
            identification: 0,
        };
        flow.source[15] = 1;
        let checksum = flow.udp_checksum(6, fold(words(&PAYLOAD)));
        let head = flow.ipv6_head(6, checksum);
        let pseudo_header = words(&head[8..40]) + 17 + 14;
        assert_eq!(
            fold(pseudo_header + words(&head[40..]) + words(&PAYLOAD)),
            0xffff
        );
        assert_eq!(fold(pseudo_header), flow.checksum_seed(6));

        let frame = framed([0x86, 0xdd], &head, &PAYLOAD);
        let found = datagram(&frame[..]).unwrap();
        assert_eq!(
            (found.source, found.destination),
            (flow.source, flow.destination)
        );
        assert_eq!((found.ip, found.udp, found.ports.len), (14, 54, 14));
    }

    #[test]
    fn a_checksum_of_zero_would_mean_none() {
        let flow = Flow::default();
        let rest = !fold(17 + 8 + 8);
        assert_eq!(flow.udp_checksum(0, rest), 0xffff);
    }
}
