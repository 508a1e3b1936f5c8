//! Addresses of apps of this host that are reached by shared memory: 0.0.0.`slot`.
//!
//! "This host on this network" (RFC 1122 section 3.2.1.3) never is a destination on the wire, so that such an address
//! cannot be mistaken for one that another host announces. The layer gives it to an app for the endpoints of another app
//! when the two have a channel; whoever sends looks at it with [`slot`], and what comes out of a channel comes from
//! its [`address`].

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// Means nothing, but no address of an endpoint is without a port.
const PORT: u16 = 7400;

/// Where the app in a slot is reached by the other apps of its host.
pub fn address(slot: u8) -> SocketAddr {
    (Ipv4Addr::new(0, 0, 0, slot), PORT).into()
}

/// The slot that an address stands for; `None` for those of the network.
pub fn slot(address: SocketAddr) -> Option<u8> {
    match address {
        SocketAddr::V4(address) => match address.ip().octets() {
            [0, 0, 0, slot] if slot != 0 && address.port() == PORT => Some(slot),
            _ => None,
        },
        SocketAddr::V6(_) => None,
    }
}

/// Whether an address means nothing outside of this host: nobody else may announce it or send from it.
pub fn is_local(ip: IpAddr) -> bool {
    matches!(ip, IpAddr::V4(ip) if ip.octets()[0] == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_have_addresses() {
        for number in [1, 7, 255] {
            assert_eq!(slot(address(number)), Some(number));
            assert!(is_local(address(number).ip()));
        }
    }

    #[test]
    fn other_addresses_have_no_slot() {
        for other in [
            "0.0.0.0:7400",
            "0.0.1.1:7400",
            "0.0.0.1:7411",
            "127.0.0.1:7400",
            "[::1]:7400",
        ] {
            assert_eq!(slot(other.parse().unwrap()), None, "{other}");
        }
    }
}
