//! The interfaces of this network namespace and their addresses.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::{fs, io};

use nix::ifaddrs::{InterfaceAddress, getifaddrs};
use nix::net::if_::{InterfaceFlags, if_nametoindex};
use rtps_user::ipv6::{self, Assigned};
use thiserror::Error;

use crate::sys;

/// The index of the loopback interface in every network namespace.
pub const LOOPBACK_INDEX: u32 = 1;

/// What fits where the MTU is not known.
const ETHERNET_MTU: u32 = 1500;
/// What every host takes in one piece (RFC 791).
const MINIMUM_MTU: u16 = 576;
/// The kernel's table of IPv6 addresses of the calling thread's network namespace; there is none without IPv6.
const IPV6_ADDRESSES: &str = "/proc/thread-self/net/if_inet6";

/// An interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Its number.
    pub index: u32,
    /// The largest IP packet that goes out in one piece, in bytes.
    pub mtu: u32,
    /// Its addresses that others are told of, IPv4 first; none as long as the kernel checks whether they are unique.
    pub addresses: Vec<IpAddr>,
    /// Whether it is `lo`.
    pub is_loopback: bool,
}

impl Interface {
    /// The address that datagrams to a group come from; `None` where the interface has none of the family.
    pub fn source(&self, group: IpAddr) -> Option<IpAddr> {
        let mut addresses = self.addresses.iter();
        let is_same_family = |ip: &&IpAddr| ip.is_ipv6() == group.is_ipv6();
        addresses.find(is_same_family).copied()
    }

    /// Whether it is one end of a pair that is joined within this machine, as containers have.
    pub fn is_veth(&self) -> bool {
        sys::interface_driver(&self.name).is_ok_and(|driver| driver == "veth")
    }
}

/// Why an interface cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FindError {
    /// Its name is wrong, or it is elsewhere.
    #[error("there is no interface `{0}` in this network namespace; `ip link` lists them")]
    Unknown(String),
    /// It could not be heard from.
    #[error(
        "interface `{0}` has no address, so nobody could answer; give it one first, \
         such as `ip addr add 10.0.0.1/24 dev {0}`, and set it up"
    )]
    NoAddress(String),
    /// The system does not say.
    #[error("cannot list the interfaces' addresses: {0}")]
    System(#[from] io::Error),
}

/// Looks an interface up; it must have an address, if only one that nobody is told of.
pub fn find(name: &str) -> Result<Interface, FindError> {
    let unknown = || FindError::Unknown(name.to_owned());
    let mut found = listed(|entry| entry.interface_name == name)?;
    let listed = found.remove(name).ok_or_else(unknown)?;
    if listed.v4.is_empty() && listed.v6.is_empty() {
        return Err(FindError::NoAddress(name.to_owned()));
    }
    Ok(listed.into_interface(name.to_owned()))
}

/// The interfaces that are up and have an address that others may be told of, by name.
pub fn all_up() -> io::Result<Vec<Interface>> {
    let found = listed(|entry| entry.flags.contains(InterfaceFlags::IFF_UP))?;
    let mut interfaces: Vec<_> = found
        .into_iter()
        .map(|(name, listed)| listed.into_interface(name))
        .collect();
    interfaces.retain(|interface| !interface.addresses.is_empty());
    Ok(interfaces)
}

/// What the kernel says of an interface.
struct Listed {
    index: u32,
    is_loopback: bool,
    v4: Vec<IpAddr>,
    v6: Vec<Assigned>,
}

impl Listed {
    fn into_interface(self, name: String) -> Interface {
        Interface {
            index: self.index,
            mtu: sys::interface_mtu(&name).unwrap_or(ETHERNET_MTU),
            addresses: ipv6::announced(self.v4, self.v6),
            is_loopback: self.is_loopback,
            name,
        }
    }
}

/// The interfaces of which there is an entry that is wanted, by name.
fn listed(wanted: impl Fn(&InterfaceAddress) -> bool) -> io::Result<BTreeMap<String, Listed>> {
    let mut interfaces: BTreeMap<String, Listed> = BTreeMap::new();
    // Every interface has an entry without IP address.
    for entry in getifaddrs()?.filter(wanted) {
        // An interface may vanish meanwhile.
        let Ok(index) = if_nametoindex(entry.interface_name.as_str()) else {
            continue;
        };
        let listed = interfaces
            .entry(entry.interface_name)
            .or_insert_with(|| Listed {
                index,
                is_loopback: entry.flags.contains(InterfaceFlags::IFF_LOOPBACK),
                v4: Vec::new(),
                v6: Vec::new(),
            });
        let address = entry.address.as_ref();
        let v4 = address.and_then(|address| address.as_sockaddr_in());
        listed.v4.extend(v4.map(|v4| IpAddr::V4(v4.ip())));
    }
    for address in ipv6_table() {
        if let Some(listed) = interfaces.get_mut(&address.name) {
            listed.v6.push(address);
        }
    }
    Ok(interfaces)
}

/// The IPv6 addresses of an interface, with those that others are not told of.
pub fn ipv6_addresses(name: &str) -> Vec<Assigned> {
    let mut addresses = ipv6_table();
    addresses.retain(|address| address.name == name);
    addresses
}

fn ipv6_table() -> Vec<Assigned> {
    let table = fs::read_to_string(IPV6_ADDRESSES).unwrap_or_default();
    ipv6::read_table(&table).collect()
}

/// Every unicast address of this network namespace, with those that others are not told of; link-local ones without
/// their interface.
pub fn own_addresses() -> io::Result<Vec<IpAddr>> {
    let addresses = getifaddrs()?.filter_map(|entry| entry.address);
    let ips = addresses.filter_map(|address| {
        let v4 = address.as_sockaddr_in().map(|v4| IpAddr::V4(v4.ip()));
        v4.or_else(|| address.as_sockaddr_in6().map(|v6| IpAddr::V6(v6.ip())))
    });
    Ok(ips.collect())
}

/// The most bytes of UDP payload that no interface has to fragment, whichever family carries it.
pub fn datagram_size(interfaces: &[Interface]) -> u16 {
    let mtu = interfaces.iter().map(|interface| interface.mtu).min();
    let mtu = u16::try_from(mtu.unwrap_or(ETHERNET_MTU)).unwrap_or(u16::MAX);
    mtu.max(MINIMUM_MTU) - ipv6::HEADERS
}

/// Where a port of a host with these interfaces is reached.
pub fn locators<'a>(
    interfaces: impl IntoIterator<Item = &'a Interface>,
    port: u16,
) -> Vec<SocketAddr> {
    let addresses = interfaces.into_iter().map(|known| &known.addresses[..]);
    ipv6::locators(addresses, port)
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, Ipv6Addr};

    use super::*;

    fn interface(mtu: u32) -> Interface {
        Interface {
            name: "if".into(),
            index: 2,
            mtu,
            addresses: vec![],
            is_loopback: false,
        }
    }

    #[test]
    fn the_loopback_interface_is_one() {
        let interfaces = all_up().unwrap();
        let loopback = interfaces.iter().find(|interface| interface.is_loopback);
        let Some(loopback) = loopback else {
            println!("skipped: this network namespace has no loopback interface that is up");
            return;
        };
        assert!(loopback.addresses.contains(&Ipv4Addr::LOCALHOST.into()));
        assert_eq!(loopback.index, LOOPBACK_INDEX);
        assert_eq!(find(&loopback.name).unwrap(), *loopback);
        assert!(
            own_addresses()
                .unwrap()
                .contains(&Ipv4Addr::LOCALHOST.into())
        );
    }

    #[test]
    fn an_unknown_interface_is_named() {
        let error = find("nosuchif0").unwrap_err();
        assert!(error.to_string().contains("nosuchif0"), "{error}");
    }

    #[test]
    fn datagrams_fit_the_smallest_interface() {
        assert_eq!(datagram_size(&[interface(9000), interface(1500)]), 1452);
        assert_eq!(datagram_size(&[interface(65_536)]), 65_487);
        assert_eq!(datagram_size(&[interface(68)]), 528);
        assert_eq!(datagram_size(&[]), 1452);
    }

    #[test]
    fn groups_are_sent_to_from_an_address_of_their_family() {
        let mut interface = interface(1500);
        let group = IpAddr::from(ipv6::GROUPS[0]);
        assert_eq!(interface.source(group), None);
        interface.addresses = vec![[10, 0, 0, 1].into(), Ipv6Addr::LOCALHOST.into()];
        assert_eq!(interface.source(group), Some(Ipv6Addr::LOCALHOST.into()));
        let v4 = interface.source([239, 255, 0, 1].into());
        assert_eq!(v4, Some([10, 0, 0, 1].into()));
    }
}
