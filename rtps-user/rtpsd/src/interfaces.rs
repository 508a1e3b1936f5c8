//! The interfaces that the layer works on, and the addresses of this network namespace.

use std::collections::BTreeSet;
use std::fs;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

use anyhow::{Context, Result, bail};
use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::{
    AddressFamily, MsgFlags, NetlinkAddr, SockFlag, SockProtocol, SockType, bind, recv, socket,
};
use rtps_user::ipv6::{self, Assigned};

use crate::sys;

/// The index of the loopback interface in every network namespace.
pub(crate) const LOOPBACK_INDEX: u32 = 1;
/// Its name.
pub(crate) const LOOPBACK: &str = "lo";

/// The kernel's table of IPv6 addresses of the calling thread's network namespace; there is none without IPv6.
const IPV6_ADDRESSES: &str = "/proc/thread-self/net/if_inet6";

/// An interface that the layer was told to work on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Interface {
    pub(crate) name: String,
    pub(crate) index: u32,
    /// The largest IP packet that goes out in one piece.
    pub(crate) mtu: u32,
    /// Its addresses that others are told of, IPv4 first; none as long as the kernel checks whether they are unique.
    pub(crate) addresses: Vec<IpAddr>,
}

impl Interface {
    /// Looks an interface up; it must exist and have an address.
    pub(crate) fn find(name: &str) -> Result<Self> {
        let index = if_nametoindex(name).with_context(|| {
            format!(
                "there is no interface `{name}` in this network namespace; `ip link` lists them"
            )
        })?;
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        let mtu = sys::interface_mtu(socket.as_fd(), name)
            .with_context(|| format!("cannot read the MTU of `{name}`"))?;
        let (v4, v6) = (ipv4_addresses(name)?, ipv6_addresses(name));
        if v4.is_empty() && v6.is_empty() {
            bail!(
                "interface `{name}` has no address, so nobody could answer; give it one first, \
                 such as `ip addr add 10.0.0.1/24 dev {name}`, and set it up"
            );
        }
        Ok(Self {
            name: name.to_owned(),
            index,
            mtu,
            addresses: ipv6::announced(v4, v6),
        })
    }

    /// The address that datagrams to a group come from; `None` where the interface has none of the family.
    pub(crate) fn source(&self, group: IpAddr) -> Option<IpAddr> {
        let mut addresses = self.addresses.iter();
        let is_same_family = |ip: &&IpAddr| ip.is_ipv6() == group.is_ipv6();
        addresses.find(is_same_family).copied()
    }
}

/// The addresses of the interface that datagrams to a unicast address leave through; `None` where that is none of these.
pub(crate) fn addresses_towards(interfaces: &[Interface], to: SocketAddr) -> Option<&[IpAddr]> {
    let link = ipv6::interface_of(to.ip());
    let source = source_towards(to);
    let mut interfaces = interfaces.iter();
    let found = interfaces.find(|known| {
        known.index == link || source.is_some_and(|source| known.addresses.contains(&source))
    });
    found.map(|interface| interface.addresses.as_slice())
}

/// The address that the kernel would send from.
pub(crate) fn source_towards(to: SocketAddr) -> Option<IpAddr> {
    let any: IpAddr = match to {
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let socket = UdpSocket::bind((any, 0)).ok()?;
    socket.connect(ipv6::to_socket(to)).ok()?;
    let local = socket.local_addr().ok()?;
    Some(ipv6::from_socket(local).ip())
}

/// The most bytes of UDP payload that no interface has to fragment, whichever family carries it.
pub(crate) fn datagram_size(interfaces: &[Interface]) -> u16 {
    let mtu = interfaces.iter().map(|interface| interface.mtu).min();
    let mtu = u16::try_from(mtu.unwrap_or(1500)).unwrap_or(u16::MAX);
    mtu.saturating_sub(ipv6::HEADERS).max(512)
}

/// Where a port of a host with these interfaces is reached.
pub(crate) fn locators(interfaces: &[Interface], port: u16) -> Vec<SocketAddr> {
    let addresses = interfaces.iter().map(|known| known.addresses.as_slice());
    ipv6::locators(addresses, port)
}

fn ipv4_addresses(name: &str) -> Result<Vec<IpAddr>> {
    Ok(getifaddrs()
        .context("cannot list the interfaces' addresses")?
        .filter(|entry| entry.interface_name == name)
        .filter_map(|entry| Some(entry.address?.as_sockaddr_in()?.ip().into()))
        .collect())
}

/// The IPv6 addresses of an interface, with those that others are not told of.
pub(crate) fn ipv6_addresses(name: &str) -> Vec<Assigned> {
    let table = fs::read_to_string(IPV6_ADDRESSES).unwrap_or_default();
    ipv6::read_table(&table)
        .filter(|address| address.name == name)
        .collect()
}

/// Every unicast address of this network namespace, as the `addresses` map keys them: IPv4 mapped into IPv6.
pub(crate) fn own_addresses() -> Result<BTreeSet<[u8; 16]>> {
    Ok(getifaddrs()
        .context("cannot list the interfaces' addresses")?
        .filter_map(|entry| {
            let address = entry.address?;
            let ip = match (address.as_sockaddr_in(), address.as_sockaddr_in6()) {
                (Some(v4), _) => IpAddr::V4(v4.ip()),
                (None, Some(v6)) => IpAddr::V6(v6.ip()),
                (None, None) => return None,
            };
            Some(mapped(ip))
        })
        .collect())
}

/// An address as the programs see it in packets, which do not tell the interface of a link-local one.
pub(crate) fn mapped(ip: IpAddr) -> [u8; 16] {
    match ipv6::without_interface(ip) {
        IpAddr::V4(ip) => ip.to_ipv6_mapped().octets(),
        IpAddr::V6(ip) => ip.octets(),
    }
}

/// Becomes readable when an address or an interface of this network namespace changes.
pub(crate) struct AddressWatch {
    socket: OwnedFd,
}

impl AddressWatch {
    pub(crate) fn new() -> Result<Self> {
        let socket = socket(
            AddressFamily::Netlink,
            SockType::Raw,
            SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK,
            SockProtocol::NetlinkRoute,
        )
        .context("cannot open a netlink socket")?;
        let groups = libc::RTMGRP_LINK | libc::RTMGRP_IPV4_IFADDR | libc::RTMGRP_IPV6_IFADDR;
        bind(
            socket.as_raw_fd(),
            &NetlinkAddr::new(0, groups.cast_unsigned()),
        )
        .context("cannot watch the interfaces' addresses")?;
        Ok(Self { socket })
    }

    /// Throws the notifications away: whoever is told looks at everything again.
    pub(crate) fn drain(&self) {
        let mut buffer = [0; 8192];
        loop {
            match recv(self.socket.as_raw_fd(), &mut buffer, MsgFlags::MSG_DONTWAIT) {
                // The kernel ran out of room for notifications, which is one more.
                Ok(1..) | Err(Errno::EINTR | Errno::ENOBUFS) => {}
                Ok(0) | Err(_) => return,
            }
        }
    }
}

impl AsFd for AddressWatch {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interface(mtu: u32) -> Interface {
        Interface {
            name: "if".into(),
            index: 1,
            mtu,
            addresses: vec![],
        }
    }

    #[test]
    fn datagrams_fit_the_smallest_mtu() {
        assert_eq!(
            datagram_size(&[interface(9000), interface(1500)]),
            1500 - 48
        );
        assert_eq!(datagram_size(&[interface(65_536)]), 65_487);
        assert_eq!(datagram_size(&[interface(68)]), 512);
    }

    #[test]
    fn groups_are_sent_to_from_an_address_of_their_family() {
        let mut interface = interface(1500);
        let group = IpAddr::from(ipv6::GROUPS[0]);
        assert_eq!(interface.source(group), None);
        interface.addresses = vec![[10, 0, 0, 1].into(), Ipv6Addr::LOCALHOST.into()];
        assert_eq!(interface.source(group), Some(Ipv6Addr::LOCALHOST.into()));
        assert_eq!(
            interface.source([239, 255, 0, 1].into()),
            Some([10, 0, 0, 1].into())
        );
    }

    #[test]
    fn unicast_leaves_through_the_interface_of_its_source() {
        let addressed = |index, address: &str| Interface {
            index,
            addresses: vec![address.parse().unwrap()],
            ..interface(1500)
        };
        let interfaces = [
            addressed(7, "10.0.0.1"),
            addressed(1, "127.0.0.1"),
            addressed(9, "fd00::1"),
        ];
        let towards = |to: &str| addresses_towards(&interfaces, to.parse().unwrap());
        assert_eq!(
            towards("127.0.0.1:7410"),
            Some(&interfaces[1].addresses[..])
        );
        assert_eq!(
            towards("[fe80:0:0:9::1]:7410"),
            Some(&interfaces[2].addresses[..])
        );
        let elsewhere = addresses_towards(&interfaces[..1], ([127, 0, 0, 1], 7410).into());
        assert_eq!(elsewhere, None);
    }

    #[test]
    fn loopback_is_an_own_address() {
        assert!(
            own_addresses()
                .unwrap()
                .contains(&mapped(Ipv4Addr::LOCALHOST.into()))
        );
    }

    #[test]
    fn an_unknown_interface_is_named() {
        let error = Interface::find("nosuchif0").unwrap_err();
        assert!(error.to_string().contains("nosuchif0"), "{error}");
    }
}
