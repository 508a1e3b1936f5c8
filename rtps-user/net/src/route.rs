//! Which interface leads to an address.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use rtps_user::ipv6;

use crate::Interface;

/// The addresses of the interface that datagrams to a unicast address leave through; `None` where that is none of these.
pub fn addresses_towards(interfaces: &[Interface], to: SocketAddr) -> Option<&[IpAddr]> {
    let link = ipv6::interface_of(to.ip());
    let source = source_towards(to);
    let mut interfaces = interfaces.iter();
    let found = interfaces.find(|known| {
        known.index == link || source.is_some_and(|source| known.addresses.contains(&source))
    });
    found.map(|interface| interface.addresses.as_slice())
}

/// The address that the kernel would send from.
pub fn source_towards(to: SocketAddr) -> Option<IpAddr> {
    let any: IpAddr = match to {
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let socket = UdpSocket::bind((any, 0)).ok()?;
    socket.connect(ipv6::to_socket(to)).ok()?;
    let local = socket.local_addr().ok()?;
    Some(ipv6::from_socket(local).ip())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn addressed(index: u32, address: &str) -> Interface {
        Interface {
            name: format!("if{index}"),
            index,
            mtu: 1500,
            addresses: vec![address.parse().unwrap()],
            is_loopback: false,
        }
    }

    #[test]
    fn unicast_leaves_through_the_interface_of_its_source() {
        let interfaces = [
            addressed(7, "10.0.0.1"),
            addressed(1, "127.0.0.1"),
            addressed(9, "fd00::1"),
        ];
        let towards = |to: &str| addresses_towards(&interfaces, to.parse().unwrap());
        let of = |position: usize| Some(&interfaces[position].addresses[..]);
        assert_eq!(towards("127.0.0.1:7410"), of(1));
        assert_eq!(towards("[fe80:0:0:7::1]:7410"), of(0));
        assert_eq!(towards("[fe80:0:0:9::1]:7410"), of(2));
        assert_eq!(towards("[::1]:7410"), None);
        let elsewhere = addresses_towards(&interfaces[..1], ([127, 0, 0, 1], 7410).into());
        assert_eq!(elsewhere, None);
    }
}
