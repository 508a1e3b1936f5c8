//! A record of the ring: [`RecordHeader`](rtps_ebpf::abi::RecordHeader), the RTPS message, unused bytes.

use std::mem::offset_of;
use std::net::{Ipv6Addr, SocketAddr};

use rtps_ebpf::abi::RecordHeader;
use rtps_user::ipv6;

/// Where a message came from, and the message.
pub(super) fn parse(record: &[u8]) -> Option<(SocketAddr, &[u8])> {
    let header = record.get(..size_of::<RecordHeader>())?;
    let len = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, message_len))?);
    let port = u16::from_ne_bytes(field(header, offset_of!(RecordHeader, source_port))?);
    let address: [u8; 16] = field(header, offset_of!(RecordHeader, source_address))?;
    let message = record.get(header.len()..)?.get(..len as usize)?;
    let interface = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, ifindex))?);
    let ip = ipv6::with_interface(Ipv6Addr::from(address).to_canonical(), interface);
    Some((SocketAddr::new(ip, port), message))
}

fn field<const N: usize>(header: &[u8], offset: usize) -> Option<[u8; N]> {
    header.get(offset..)?.first_chunk().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(len: u32, message: &[u8]) -> Vec<u8> {
        let mut record = vec![0; size_of::<RecordHeader>()];
        record[..4].copy_from_slice(&len.to_ne_bytes());
        record[14..16].copy_from_slice(&7411u16.to_ne_bytes());
        record[26..28].fill(0xff);
        record[28..32].copy_from_slice(&[10, 0, 0, 1]);
        record.extend_from_slice(message);
        record
    }

    #[test]
    fn the_message_ends_where_its_length_says() {
        let record = record(4, b"RTPS and padding");
        let (source, message) = parse(&record).unwrap();
        assert_eq!(source, "10.0.0.1:7411".parse().unwrap());
        assert_eq!(message, b"RTPS");
    }

    #[test]
    fn link_local_sources_have_an_interface() {
        let mut record = record(0, b"");
        record[4..8].copy_from_slice(&3u32.to_ne_bytes());
        record[16..32].copy_from_slice(&"fe80::1".parse::<Ipv6Addr>().unwrap().octets());
        let (source, _) = parse(&record).unwrap();
        assert_eq!(source, "[fe80:0:0:3::1]:7411".parse().unwrap());
    }

    #[test]
    fn records_that_lie_are_refused() {
        assert_eq!(parse(&record(5, b"RTPS")), None);
        assert_eq!(parse(&record(u32::MAX, b"RTPS")), None);
        assert_eq!(parse(&record(0, b"")[..39]), None);
    }
}
