//! A record of the ring: [`RecordHeader`](rtps_ebpf::abi::RecordHeader), the RTPS message, unused bytes.

use std::mem::offset_of;
use std::net::{Ipv6Addr, SocketAddr};

use rtps_ebpf::abi::RecordHeader;
use rtps_user::ipv6;

/// Where messages came from, and each of them.
pub(super) fn parse(record: &[u8]) -> Option<(SocketAddr, impl Iterator<Item = &[u8]>)> {
    let header = record.get(..size_of::<RecordHeader>())?;
    let len = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, message_len))?);
    let port = u16::from_ne_bytes(field(header, offset_of!(RecordHeader, source_port))?);
    let address: [u8; 16] = field(header, offset_of!(RecordHeader, source_address))?;
    let messages = record.get(header.len()..)?.get(..len as usize)?;
    let segment = match u16::from_ne_bytes(field(header, offset_of!(RecordHeader, segment))?) {
        // One message, perhaps an empty one.
        0 => messages.len().max(1),
        segment => segment.into(),
    };
    let interface = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, ifindex))?);
    let ip = ipv6::with_interface(Ipv6Addr::from(address).to_canonical(), interface);
    Some((SocketAddr::new(ip, port), messages.chunks(segment)))
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
        let (source, messages) = parse(&record).unwrap();
        assert_eq!(source, "10.0.0.1:7411".parse().unwrap());
        assert_eq!(messages.collect::<Vec<_>>(), [b"RTPS"]);
    }

    #[test]
    fn messages_that_came_together_are_taken_apart() {
        let mut record = record(10, b"RTPSRTPSRT and padding");
        record[10..12].copy_from_slice(&4u16.to_ne_bytes());
        let (_, messages) = parse(&record).unwrap();
        assert_eq!(messages.collect::<Vec<_>>(), [&b"RTPS"[..], b"RTPS", b"RT"]);
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
        assert!(parse(&record(5, b"RTPS")).is_none());
        assert!(parse(&record(u32::MAX, b"RTPS")).is_none());
        assert!(parse(&record(0, b"")[..39]).is_none());
    }
}
