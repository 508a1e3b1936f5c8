//! The interfaces that the layer works on, and the addresses of this network namespace.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

use anyhow::{Context, Result, bail};
use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::{
    AddressFamily, MsgFlags, NetlinkAddr, SockFlag, SockProtocol, SockType, bind, recv, socket,
};

use crate::sys;

/// The index of the loopback interface in every network namespace.
pub(crate) const LOOPBACK_INDEX: u32 = 1;

/// IPv4 and UDP header, in bytes.
const IP_AND_UDP_HEADERS: u32 = 20 + 8;

/// The largest payload of a UDP datagram over IPv4.
const LARGEST_DATAGRAM: u32 = 65_507;

/// An interface that the layer was told to work on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Interface {
    pub(crate) name: String,
    pub(crate) index: u32,
    /// The largest IP packet that goes out in one piece.
    pub(crate) mtu: u32,
    pub(crate) addresses: Vec<Ipv4Addr>,
}

impl Interface {
    /// Looks an interface up; it must exist and have an IPv4 address.
    pub(crate) fn find(name: &str) -> Result<Self> {
        let index = if_nametoindex(name).with_context(|| {
            format!(
                "there is no interface `{name}` in this network namespace; `ip link` lists them"
            )
        })?;
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        let mtu = sys::interface_mtu(socket.as_fd(), name)
            .with_context(|| format!("cannot read the MTU of `{name}`"))?;
        let addresses = ipv4_addresses(name)?;
        if addresses.is_empty() {
            bail!(
                "interface `{name}` has no IPv4 address, so nobody could answer; give it one first, \
                 such as `ip addr add 10.0.0.1/24 dev {name}`, and set it up"
            );
        }
        Ok(Self {
            name: name.to_owned(),
            index,
            mtu,
            addresses,
        })
    }
}

/// The most bytes of UDP payload that no interface has to fragment.
pub(crate) fn datagram_size(interfaces: &[Interface]) -> u16 {
    let mtu = interfaces.iter().map(|interface| interface.mtu).min();
    let size = mtu
        .unwrap_or(1500)
        .saturating_sub(IP_AND_UDP_HEADERS)
        .clamp(512, LARGEST_DATAGRAM);
    u16::try_from(size).unwrap_or(u16::MAX)
}

fn ipv4_addresses(name: &str) -> Result<Vec<Ipv4Addr>> {
    Ok(getifaddrs()
        .context("cannot list the interfaces' addresses")?
        .filter(|entry| entry.interface_name == name)
        .filter_map(|entry| Some(entry.address?.as_sockaddr_in()?.ip()))
        .collect())
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

fn mapped(ip: IpAddr) -> [u8; 16] {
    match ip {
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
            1500 - 28
        );
        assert_eq!(datagram_size(&[interface(65_536)]), 65_507);
        assert_eq!(datagram_size(&[interface(68)]), 512);
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
