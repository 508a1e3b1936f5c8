//! The interfaces that the in-process layer uses: all that are up and have an address, as of now.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::{fs, io};

use nix::ifaddrs::getifaddrs;
use nix::net::if_::{InterfaceFlags, if_nametoindex};
use rtps_user::ipv6;

use crate::sys::udp;

/// Names of the interfaces to use, separated by commas; all that are up where it is not set.
const CHOICE_VARIABLE: &str = "RTPS_INTERFACES";
/// What fits where the MTU is not known.
const ETHERNET_MTU: u32 = 1500;
/// The kernel's table of IPv6 addresses of the calling thread's network namespace; there is none without IPv6.
const IPV6_ADDRESSES: &str = "/proc/thread-self/net/if_inet6";

/// An interface.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct Interface {
    /// Its number.
    pub(super) index: u32,
    /// Its addresses that others are told of, IPv4 first.
    pub(super) addresses: Vec<IpAddr>,
    /// Whether it is `lo`.
    pub(super) is_loopback: bool,
    /// The largest IP packet that it takes.
    pub(super) mtu: u32,
}

impl Interface {
    /// The address that datagrams to a group come from; `None` where the interface has none of the family.
    pub(super) fn source(&self, group: IpAddr) -> Option<IpAddr> {
        let mut addresses = self.addresses.iter();
        let is_same_family = |ip: &&IpAddr| ip.is_ipv6() == group.is_ipv6();
        addresses.find(is_same_family).copied()
    }
}

/// The addresses of the interface that datagrams to a unicast address leave through; `None` where that is none of these.
pub(super) fn addresses_towards(interfaces: &[Interface], to: SocketAddr) -> Option<&[IpAddr]> {
    let link = ipv6::interface_of(to.ip());
    let source = source_towards(to);
    let mut interfaces = interfaces.iter();
    let found = interfaces.find(|known| {
        known.index == link || source.is_some_and(|source| known.addresses.contains(&source))
    });
    found.map(|interface| interface.addresses.as_slice())
}

/// The address that the kernel would send from.
fn source_towards(to: SocketAddr) -> Option<IpAddr> {
    let any: IpAddr = match to {
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let socket = UdpSocket::bind((any, 0)).ok()?;
    socket.connect(ipv6::to_socket(to)).ok()?;
    let local = socket.local_addr().ok()?;
    Some(ipv6::from_socket(local).ip())
}

/// The interfaces that are up and that the environment does not exclude.
pub(super) fn chosen() -> io::Result<Vec<Interface>> {
    let choice = std::env::var(CHOICE_VARIABLE).ok();
    up_among(choice.as_deref())
}

fn up_among(choice: Option<&str>) -> io::Result<Vec<Interface>> {
    let wanted =
        |name: &str| choice.is_none_or(|names| names.split(',').any(|one| one.trim() == name));
    let mut interfaces: BTreeMap<String, Interface> = BTreeMap::new();
    // Every interface has an entry without IP address.
    for entry in getifaddrs()?.filter(|entry| wanted(&entry.interface_name)) {
        // An interface may vanish meanwhile.
        let (Ok(index), true) = (
            if_nametoindex(entry.interface_name.as_str()),
            entry.flags.contains(InterfaceFlags::IFF_UP),
        ) else {
            continue;
        };
        let interface = interfaces
            .entry(entry.interface_name)
            .or_insert_with_key(|name| Interface {
                index,
                addresses: Vec::new(),
                is_loopback: entry.flags.contains(InterfaceFlags::IFF_LOOPBACK),
                mtu: udp::interface_mtu(name).unwrap_or(ETHERNET_MTU),
            });
        let address = entry.address.as_ref();
        let v4 = address.and_then(|address| address.as_sockaddr_in());
        interface.addresses.extend(v4.map(|v4| IpAddr::V4(v4.ip())));
    }
    let table = fs::read_to_string(IPV6_ADDRESSES).unwrap_or_default();
    for (name, interface) in &mut interfaces {
        let v6 = ipv6::read_table(&table).filter(|address| address.name == *name);
        interface.addresses = ipv6::announced(interface.addresses.drain(..), v6);
    }
    interfaces.retain(|_, interface| !interface.addresses.is_empty());
    Ok(interfaces.into_values().collect())
}

/// The most bytes of UDP payload that no interface has to fragment, whichever family carries it.
pub(super) fn datagram_size(interfaces: &[Interface]) -> u16 {
    let mtu = interfaces.iter().map(|interface| interface.mtu).min();
    let mtu = u16::try_from(mtu.unwrap_or(ETHERNET_MTU)).unwrap_or(u16::MAX);
    mtu.max(576) - ipv6::HEADERS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loopback_interface_is_one() {
        let interfaces = up_among(None).unwrap();
        let loopback = interfaces.iter().find(|interface| interface.is_loopback);
        let Some(loopback) = loopback else {
            println!("skipped: this network namespace has no loopback interface that is up");
            return;
        };
        assert!(loopback.addresses.contains(&IpAddr::from([127, 0, 0, 1])));
        assert!(loopback.index > 0);
        let chosen = up_among(Some("nosuch0, lo")).unwrap();
        assert_eq!(chosen, std::slice::from_ref(loopback));
        assert_eq!(up_among(Some("nosuch0")).unwrap(), []);
    }

    #[test]
    fn unicast_leaves_through_the_interface_of_its_source() {
        let addressed = |index, address: &str| Interface {
            index,
            addresses: vec![address.parse().unwrap()],
            is_loopback: false,
            mtu: 1500,
        };
        let interfaces = [addressed(7, "10.0.0.1"), addressed(1, "127.0.0.1")];
        let towards = |to: &str| addresses_towards(&interfaces, to.parse().unwrap());
        assert_eq!(
            towards("127.0.0.1:7410"),
            Some(&interfaces[1].addresses[..])
        );
        assert_eq!(
            towards("[fe80:0:0:7::1]:7410"),
            Some(&interfaces[0].addresses[..])
        );
        assert_eq!(towards("[::1]:7410"), None);
    }

    #[test]
    fn datagrams_fit_the_smallest_interface() {
        let of = |mtu| Interface {
            index: 2,
            addresses: Vec::new(),
            is_loopback: false,
            mtu,
        };
        assert_eq!(datagram_size(&[of(9000), of(1500)]), 1452);
        assert_eq!(datagram_size(&[of(65_536)]), 65_487);
        assert_eq!(datagram_size(&[of(68)]), 528);
        assert_eq!(datagram_size(&[]), 1452);
    }
}
