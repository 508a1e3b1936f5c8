//! The addresses of this network namespace, as the `addresses` map keys them.

use std::collections::BTreeSet;
use std::net::IpAddr;

use anyhow::{Context, Result};
use rtps_user::ipv6;

/// Every unicast address of this network namespace: IPv4 mapped into IPv6.
pub(crate) fn own_addresses() -> Result<BTreeSet<[u8; 16]>> {
    let addresses = rtps_net::own_addresses().context("cannot list the interfaces' addresses")?;
    Ok(addresses.into_iter().map(mapped).collect())
}

/// An address as the programs see it in packets, which do not tell the interface of a link-local one.
pub(crate) fn mapped(ip: IpAddr) -> [u8; 16] {
    match ipv6::without_interface(ip) {
        IpAddr::V4(ip) => ip.to_ipv6_mapped().octets(),
        IpAddr::V6(ip) => ip.octets(),
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn loopback_is_an_own_address() {
        let loopback = mapped(Ipv4Addr::LOCALHOST.into());
        assert!(own_addresses().unwrap().contains(&loopback));
    }
}
