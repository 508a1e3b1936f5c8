//! The interfaces that the in-process layer uses: all that are up and have an IPv4 address.

use std::collections::BTreeMap;
use std::io;
use std::net::Ipv4Addr;

use nix::ifaddrs::getifaddrs;
use nix::net::if_::{InterfaceFlags, if_nametoindex};

use crate::sys::udp;

/// Names of the interfaces to use, separated by commas; all that are up where it is not set.
const CHOICE_VARIABLE: &str = "RTPS_INTERFACES";
/// IP and UDP headers.
const HEADERS: u32 = 28;
/// What fits where the MTU is not known.
const ETHERNET_MTU: u32 = 1500;

/// An interface.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct Interface {
    /// Its number.
    pub(super) index: u32,
    /// Its addresses.
    pub(super) addresses: Vec<Ipv4Addr>,
    /// Whether it is `lo`.
    pub(super) is_loopback: bool,
    /// The largest IP packet that it takes.
    pub(super) mtu: u32,
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
    for entry in getifaddrs()?.filter(|entry| wanted(&entry.interface_name)) {
        let address = entry
            .address
            .as_ref()
            .and_then(|address| address.as_sockaddr_in());
        let (Some(address), true) = (address, entry.flags.contains(InterfaceFlags::IFF_UP)) else {
            continue;
        };
        // An interface may vanish meanwhile.
        let Ok(index) = if_nametoindex(entry.interface_name.as_str()) else {
            continue;
        };
        let mtu = udp::interface_mtu(&entry.interface_name).unwrap_or(ETHERNET_MTU);
        let interface = interfaces
            .entry(entry.interface_name)
            .or_insert_with(|| Interface {
                index,
                addresses: Vec::new(),
                is_loopback: entry.flags.contains(InterfaceFlags::IFF_LOOPBACK),
                mtu,
            });
        interface.addresses.push(address.ip());
    }
    Ok(interfaces.into_values().collect())
}

/// The most bytes of UDP payload that no interface has to fragment.
pub(super) fn datagram_size(smallest_mtu: Option<u32>) -> u16 {
    // The loopback interface's MTU leaves UDP's own limit as the smaller one.
    let mtu = smallest_mtu.unwrap_or(ETHERNET_MTU).clamp(576, 65_535);
    (mtu - HEADERS) as u16
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
        assert!(loopback.addresses.contains(&Ipv4Addr::LOCALHOST));
        assert!(loopback.index > 0);
        let chosen = up_among(Some("nosuch0, lo")).unwrap();
        assert_eq!(chosen, std::slice::from_ref(loopback));
        assert_eq!(up_among(Some("nosuch0")).unwrap(), []);
    }

    #[test]
    fn datagrams_fit_the_smallest_interface() {
        assert_eq!(datagram_size(Some(1500)), 1472);
        assert_eq!(datagram_size(Some(65_536)), 65_507);
        assert_eq!(datagram_size(Some(68)), 548);
        assert_eq!(datagram_size(None), 1472);
    }
}
