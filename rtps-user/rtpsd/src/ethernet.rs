//! Who the host is on an Ethernet, as the kernel has to know to answer there.

use std::net::{IpAddr, Ipv6Addr};

use nix::ifaddrs::getifaddrs;
use rtps_ebpf::abi;
use rtps_net::Interface;
use rtps_user::ipv6;

/// Reads hardware and network addresses; the error is why the tc program has nothing to do on the interface.
pub(crate) fn describe(interface: &Interface, tasks: u16) -> Result<abi::Interface, String> {
    let mac = hardware_address(&interface.name).ok_or("no Ethernet")?;
    let announced = || interface.addresses.iter();
    let ipv4 = announced().find_map(|address| match address {
        IpAddr::V4(address) => Some(address.octets()),
        IpAddr::V6(_) => None,
    });
    let ipv6 = announced().find_map(|address| match address {
        IpAddr::V6(address) if !address.is_unicast_link_local() => Some(address.octets()),
        _ => None,
    });
    Ok(abi::Interface {
        mac,
        tasks,
        ipv4: ipv4.unwrap_or_default(),
        ipv6: ipv6.unwrap_or_default(),
        ipv6_link_local: link_local(&interface.name).map_or([0; 16], |address| address.octets()),
    })
}

/// `None` where there is no Ethernet.
fn hardware_address(name: &str) -> Option<[u8; 6]> {
    let entries = getifaddrs().ok()?;
    entries
        .filter(|entry| entry.interface_name == name)
        .filter_map(|entry| entry.address)
        .find_map(|address| {
            let link = address.as_link_addr()?;
            (link.hatype() == libc::ARPHRD_ETHER).then(|| link.addr())?
        })
}

fn link_local(name: &str) -> Option<Ipv6Addr> {
    let mut lasting = rtps_net::ipv6_addresses(name)
        .into_iter()
        .filter(|address| address.is_lasting);
    let found = lasting.find(|address| address.ip.is_unicast_link_local())?;
    match ipv6::without_interface(found.ip.into()) {
        IpAddr::V6(address) => Some(address),
        IpAddr::V4(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rtps_net::LOOPBACK_INDEX;

    #[test]
    fn the_loopback_interface_is_no_ethernet() {
        let loopback = rtps_net::find("lo").unwrap();
        assert_eq!(loopback.index, LOOPBACK_INDEX);
        assert_eq!(describe(&loopback, 0), Err("no Ethernet".to_owned()));
    }
}
