//! What IPv6 needs beyond IPv4: groups of its own, and an interface for each link-local address.
//!
//! A link-local address means nothing without the interface that it is used on, which neither a locator nor the
//! layer protocol carries. Within a host it is therefore kept inside the address, in bits that RFC 4291 wants to be
//! zero: fe80::1 on interface 3 is fe80:0:0:3::1. [`from_socket`] and [`to_socket`] stand where datagrams come in and
//! go out; everything between, addresses as keys included, need not know.

use std::net::{IpAddr, Ipv6Addr, SocketAddr, SocketAddrV6};

/// The groups of SPDP, for which RTPS 2.5 names none: Cyclone DDS listens to the first, Fast DDS to the second.
pub const GROUPS: [Ipv6Addr; 2] = [
    Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0xffff, 0xefff, 1),
    Ipv6Addr::new(0xff1e, 0, 0, 0, 0, 0xffff, 0xefff, 1),
];

/// The most addresses that a host announces: each takes 56 bytes of an SPDP message that must fit one frame, and
/// others remember no more of a participant.
pub const ANNOUNCED_ADDRESSES: usize = 8;

/// IPv6 and UDP header, the larger of the two families', in bytes.
pub const HEADERS: u16 = 40 + 8;

/// Where the interface is kept: the third and fourth 16 bits of the address.
const INTERFACE_SHIFT: u32 = 64;
const INTERFACE_MASK: u128 = 0xffff_ffff << INTERFACE_SHIFT;

/// The address as the layer knows it that a socket gives with this interface; an interface of 0 is none.
pub fn with_interface(ip: IpAddr, interface: u32) -> IpAddr {
    match ip {
        IpAddr::V6(ip) if ip.is_unicast_link_local() => {
            let bits = ip.to_bits() & !INTERFACE_MASK | u128::from(interface) << INTERFACE_SHIFT;
            Ipv6Addr::from_bits(bits).into()
        }
        _ => ip,
    }
}

/// The address as it is on the wire.
pub fn without_interface(ip: IpAddr) -> IpAddr {
    with_interface(ip, 0)
}

/// The interface of a link-local address; 0 for all others.
pub fn interface_of(ip: IpAddr) -> u32 {
    match ip {
        IpAddr::V6(ip) if ip.is_unicast_link_local() => {
            ((ip.to_bits() & INTERFACE_MASK) >> INTERFACE_SHIFT) as u32
        }
        _ => 0,
    }
}

/// Where a datagram came from, for the layer.
pub fn from_socket(source: SocketAddr) -> SocketAddr {
    let interface = match source {
        SocketAddr::V4(_) => 0,
        SocketAddr::V6(source) => source.scope_id(),
    };
    // Without flow label and scope, so that equal addresses are equal.
    SocketAddr::new(with_interface(source.ip(), interface), source.port())
}

/// Where a socket is to send what the layer has for `destination`.
pub fn to_socket(destination: SocketAddr) -> SocketAddr {
    match without_interface(destination.ip()) {
        IpAddr::V4(_) => destination,
        IpAddr::V6(ip) => {
            let interface = interface_of(destination.ip());
            SocketAddrV6::new(ip, destination.port(), 0, interface).into()
        }
    }
}

/// An address of this network namespace.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Assigned {
    /// The address, with its interface inside where it is link-local.
    pub ip: Ipv6Addr,
    /// The interface's number.
    pub interface: u32,
    /// The interface's name.
    pub name: String,
    /// Whether others may be told of it: the kernel has found it unique, and means to keep it.
    pub is_lasting: bool,
}

/// Reads the kernel's table of addresses (`/proc/net/if_inet6`), which says more than `getifaddrs`: per line address,
/// interface, prefix length, scope, flags, all in hexadecimal, and the interface's name.
pub fn read_table(table: &str) -> impl Iterator<Item = Assigned> {
    table.lines().filter_map(read_line)
}

fn read_line(line: &str) -> Option<Assigned> {
    // IFA_F_TEMPORARY, IFA_F_DADFAILED, IFA_F_DEPRECATED, IFA_F_TENTATIVE.
    const PASSING: u32 = 0x01 | 0x08 | 0x20 | 0x40;
    let mut words = line.split_whitespace();
    let address = u128::from_str_radix(words.next()?, 16).ok()?;
    let mut number = || u32::from_str_radix(words.next()?, 16).ok();
    let (interface, _prefix, _scope, flags) = (number()?, number()?, number()?, number()?);
    let IpAddr::V6(ip) = with_interface(Ipv6Addr::from_bits(address).into(), interface) else {
        return None;
    };
    Some(Assigned {
        ip,
        interface,
        name: words.next()?.to_owned(),
        is_lasting: flags & PASSING == 0,
    })
}

/// Which of an interface's addresses others are told of: all lasting ones but link-local ones, which only peers on
/// the same link could use; and these where there is nothing else.
pub fn announced(
    v4: impl IntoIterator<Item = IpAddr>,
    v6: impl IntoIterator<Item = Assigned>,
) -> Vec<IpAddr> {
    let lasting = v6.into_iter().filter(|address| address.is_lasting);
    let (local, wide): (Vec<_>, Vec<_>) = lasting
        .map(|address| address.ip)
        .partition(Ipv6Addr::is_unicast_link_local);
    let mut all: Vec<IpAddr> = v4
        .into_iter()
        .chain(wide.into_iter().map(IpAddr::from))
        .collect();
    if all.is_empty() {
        all.extend(local.into_iter().map(IpAddr::from));
    }
    all
}

/// The addresses that a host with these interfaces announces: where there are too many, the first of each family
/// and interface before the others.
pub fn locators<'a>(
    interfaces: impl IntoIterator<Item = &'a [IpAddr]>,
    port: u16,
) -> Vec<SocketAddr> {
    let (mut first, mut others) = (Vec::new(), Vec::new());
    for addresses in interfaces {
        for is_v6 in [false, true] {
            let mut of_family = addresses.iter().filter(|ip| ip.is_ipv6() == is_v6);
            first.extend(of_family.next().copied());
            others.extend(of_family.copied());
        }
    }
    first.extend::<Vec<IpAddr>>(others);
    let announced = first.into_iter().take(ANNOUNCED_ADDRESSES);
    announced.map(|ip| SocketAddr::new(ip, port)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn link_local_addresses_keep_their_interface() {
        let source = SocketAddrV6::new("fe80::a:1".parse().unwrap(), 7410, 5, 3);
        let inside = from_socket(source.into());
        assert_eq!(inside, SocketAddr::new(ip("fe80:0:0:3::a:1"), 7410));
        assert_eq!(interface_of(inside.ip()), 3);
        assert_eq!(without_interface(inside.ip()), ip("fe80::a:1"));
        let back = SocketAddrV6::new("fe80::a:1".parse().unwrap(), 7410, 0, 3);
        assert_eq!(to_socket(inside), back.into());
        let highest = with_interface(ip("fe80::1"), u32::MAX);
        assert_eq!(interface_of(highest), u32::MAX);
    }

    #[test]
    fn other_addresses_stay_as_they_are() {
        for text in ["10.0.0.1", "fd00:0:0:3::1", "ff02::ffff:efff:1", "::1"] {
            let address = SocketAddr::new(ip(text), 7400);
            assert_eq!(from_socket(address), address);
            assert_eq!(to_socket(address), address);
            assert_eq!(interface_of(with_interface(ip(text), 9)), 0);
        }
    }

    const TABLE: &str = "\
fe80000000000000bc69ddfffe8cd4b1 02 40 20 80     eth0
fd000000000000000000000000000001 02 78 00 80     eth0
fd000000000000000000000000000002 02 40 00 01     eth0
fd000000000000000000000000000003 02 40 00 c0     eth0
fd000000000000000000000000000004 02 40 00 a0     eth0
00000000000000000000000000000001 01 80 10 80       lo
no address at all
";

    fn of(name: &str) -> Vec<Assigned> {
        read_table(TABLE)
            .filter(|entry| entry.name == name)
            .collect()
    }

    #[test]
    fn temporary_tentative_and_deprecated_addresses_are_not_announced() {
        assert_eq!(read_table(TABLE).count(), 6);
        assert_eq!(announced([], of("eth0")), [ip("fd00::1")]);
        let both = announced([ip("10.0.0.1")], of("eth0"));
        assert_eq!(both, [ip("10.0.0.1"), ip("fd00::1")]);
        assert_eq!(announced([], of("lo")), [ip("::1")]);
    }

    #[test]
    fn link_local_addresses_are_announced_where_there_is_nothing_else() {
        let only = of("eth0").into_iter().take(1);
        let local = ip("fe80:0:0:2:bc69:ddff:fe8c:d4b1");
        assert_eq!(announced([], only.clone()), [local]);
        assert_eq!(announced([ip("10.0.0.1")], only), [ip("10.0.0.1")]);
    }

    #[test]
    fn each_interface_and_family_is_announced_before_more_of_the_same() {
        let many: Vec<_> = (1..=20).map(|n| IpAddr::from([10, 0, 0, n])).collect();
        let other = [ip("10.1.0.1"), ip("fd00::1")];
        let locators = locators([many.as_slice(), &other], 7410);
        assert_eq!(locators.len(), ANNOUNCED_ADDRESSES);
        let ips: Vec<_> = locators.iter().map(SocketAddr::ip).take(4).collect();
        assert_eq!(ips, [many[0], other[0], other[1], many[1]]);
    }
}
