//! The ring in which the kernel hands discovery messages over that rtpsd has to know of.
//!
//! A record is a [`RecordHeader`], the RTPS message as it came, and unused bytes. What a killed rtpsd has not read is
//! still there for the next one.

use std::mem::offset_of;
use std::net::{Ipv6Addr, SocketAddr};
use std::os::fd::{AsFd, BorrowedFd};

use anyhow::Result;
use aya::maps::{MapData, RingBuf};
use rtps_ebpf::abi::{RECORD_ANSWERED, RecordHeader, name};
use rtps_user::ipv6;

use crate::kernel_maps::open;
use crate::pins::PinFolder;

/// Records that are read before others get their turn.
const BURST: usize = 256;

/// The consumer's end.
pub(crate) struct News {
    ring: RingBuf<MapData>,
}

/// A message that came in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Item<'a> {
    /// Index into `domains`, not the domain id.
    pub(crate) domain_index: u32,
    /// Whether the kernel has answered it as far as it asks for that.
    pub(crate) is_answered: bool,
    pub(crate) source: SocketAddr,
    pub(crate) message: &'a [u8],
}

impl News {
    /// Opens the pinned ring.
    pub(crate) fn open(folder: &PinFolder) -> Result<Self> {
        let ring = open(folder, name::NEWS)?;
        Ok(Self { ring })
    }

    /// Hands what is there to `take`, up to a burst.
    pub(crate) fn read(&mut self, mut take: impl FnMut(Item<'_>)) {
        for _ in 0..BURST {
            let Some(record) = self.ring.next() else {
                return;
            };
            if let Some(item) = parse(&record) {
                take(item);
            }
        }
    }
}

impl AsFd for News {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.ring.as_fd()
    }
}

/// `None` for a record that is shorter than it says.
fn parse(record: &[u8]) -> Option<Item<'_>> {
    let (header, rest) = record.split_at_checked(size_of::<RecordHeader>())?;
    let length = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, message_len))?);
    let ifindex = u32::from_ne_bytes(field(header, offset_of!(RecordHeader, ifindex))?);
    let [flags] = field(header, offset_of!(RecordHeader, flags))?;
    let port = u16::from_ne_bytes(field(header, offset_of!(RecordHeader, source_port))?);
    let address = field::<16>(header, offset_of!(RecordHeader, source_address))?;
    Some(Item {
        domain_index: u16::from_ne_bytes(field(header, offset_of!(RecordHeader, domain_index))?)
            .into(),
        is_answered: flags & RECORD_ANSWERED != 0,
        source: source(address.into(), port, ifindex),
        message: rest.get(..usize::try_from(length).ok()?)?,
    })
}

/// As the layer knows addresses that sockets say.
fn source(address: Ipv6Addr, port: u16, ifindex: u32) -> SocketAddr {
    let address = ipv6::with_interface(address.to_canonical(), ifindex);
    SocketAddr::new(address, port)
}

fn field<const N: usize>(header: &[u8], offset: usize) -> Option<[u8; N]> {
    header.get(offset..)?.first_chunk().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(length: u32, flags: u8, address: [u8; 16]) -> Vec<u8> {
        let mut record = Vec::new();
        for word in [length, 3, 1] {
            record.extend(word.to_ne_bytes());
        }
        record.extend([0, flags]);
        record.extend(7410u16.to_ne_bytes());
        record.extend(address);
        record.extend([0; 8]);
        record.extend(b"RTPS and unused bytes");
        record
    }

    #[test]
    fn records_are_read_as_far_as_they_are_long() {
        let ipv4 = std::net::Ipv4Addr::new(10, 0, 0, 1).to_ipv6_mapped();
        let bytes = record(4, RECORD_ANSWERED, ipv4.octets());
        let item = Item {
            domain_index: 1,
            is_answered: true,
            source: "10.0.0.1:7410".parse().unwrap(),
            message: b"RTPS",
        };
        assert_eq!(parse(&bytes), Some(item));
        assert!(!parse(&record(4, 0, ipv4.octets())).unwrap().is_answered);
        assert_eq!(parse(&record(22, 0, ipv4.octets())), None);
        assert_eq!(parse(&record(u32::MAX, 0, ipv4.octets())), None);
        assert_eq!(parse(&bytes[..size_of::<RecordHeader>() - 1]), None);
    }

    #[test]
    fn link_local_addresses_name_their_link() {
        let link_local: Ipv6Addr = "fe80::1".parse().unwrap();
        let bytes = record(0, 0, link_local.octets());
        let source = parse(&bytes).unwrap().source;
        assert_eq!(ipv6::interface_of(source.ip()), 3);
        assert_eq!(ipv6::without_interface(source.ip()), link_local);
    }
}
