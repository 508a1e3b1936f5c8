//! The parameters of discovery data beside those of QoS policies (RTPS 2.5 table 9.14), and what reading and
//! writing of participants and endpoints have in common.

use std::net::{IpAddr, SocketAddr};

use crate::qos::parameters::write_string;
use crate::wire::{
    Cursor, Locator, PROTOCOL_VERSION, ParameterId, ParameterWriter, VendorId, WireError,
};
use crate::{ipv6, local};

pub(super) const PARTICIPANT_LEASE_DURATION: ParameterId = ParameterId(0x0002);
pub(super) const TOPIC_NAME: ParameterId = ParameterId::TOPIC_NAME;
pub(super) const TYPE_NAME: ParameterId = ParameterId(0x0007);
pub(super) const DOMAIN_ID: ParameterId = ParameterId(0x000f);
pub(super) const DOMAIN_TAG: ParameterId = ParameterId(0x4014);
pub(super) const PROTOCOL_VERSION_ID: ParameterId = ParameterId(0x0015);
pub(super) const VENDOR_ID: ParameterId = ParameterId(0x0016);
pub(super) const UNICAST_LOCATOR: ParameterId = ParameterId(0x002f);
pub(super) const MULTICAST_LOCATOR: ParameterId = ParameterId(0x0030);
pub(super) const DEFAULT_UNICAST_LOCATOR: ParameterId = ParameterId(0x0031);
pub(super) const METATRAFFIC_UNICAST_LOCATOR: ParameterId = ParameterId(0x0032);
pub(super) const METATRAFFIC_MULTICAST_LOCATOR: ParameterId = ParameterId(0x0033);
pub(super) const EXPECTS_INLINE_QOS: ParameterId = ParameterId(0x0043);
pub(super) const PARTICIPANT_GUID: ParameterId = ParameterId(0x0050);
pub(super) const BUILTIN_ENDPOINT_SET: ParameterId = ParameterId(0x0058);
pub(super) const ENDPOINT_GUID: ParameterId = ParameterId(0x005a);
pub(super) const ENTITY_NAME: ParameterId = ParameterId(0x0062);
pub(super) const TYPE_INFORMATION: ParameterId = ParameterId(0x0075);
pub(super) const BUILTIN_ENDPOINT_QOS: ParameterId = ParameterId(0x0077);
/// Of Cyclone DDS: numbers, and `host/version/system/target`.
pub(super) const VERSION_INFO: ParameterId = ParameterId(0x8007);

/// The most locators of one kind that are remembered: one is enough, and hosts with more interfaces are rare.
const MAX_LOCATORS: usize = 16;

/// Reads a locator and adds it where it is one that a datagram can be sent to; other transports are skipped.
pub(super) fn read_locator(
    value: &mut Cursor<'_>,
    list: &mut Vec<SocketAddr>,
) -> Result<(), WireError> {
    let address = Locator::decode(value)?.to_socket_addr();
    match address.filter(|address| !list.contains(address) && list.len() < MAX_LOCATORS) {
        Some(address) if is_destination(address.ip()) => list.push(address),
        _ => {}
    }
    Ok(())
}

/// The interface of a link-local address is ours to say, and so are the addresses within this host.
fn is_destination(ip: IpAddr) -> bool {
    let is_nowhere = match ip {
        IpAddr::V4(v4) => local::is_local(ip) || v4.is_broadcast(),
        IpAddr::V6(v6) => v6.is_unspecified(),
    };
    !is_nowhere && ipv6::interface_of(ip) == 0
}

/// Unicast addresses in the order in which to try them: that which the participant's datagrams come from, then those
/// of the same family, which is one that both hosts have. Loopback ones are left out unless its datagrams come from
/// there, link-local ones always unless they do, and so are multicast ones.
pub(super) fn reachable(addresses: &[SocketAddr], source: IpAddr) -> Vec<SocketAddr> {
    let mut reachable: Vec<_> = addresses
        .iter()
        .filter(|address| !address.ip().is_multicast())
        .filter(|address| !address.ip().is_loopback() || source.is_loopback())
        .filter_map(|address| on_interface(*address, source))
        .collect();
    reachable.sort_by_key(|address| {
        let is_other_family = address.is_ipv6() != source.is_ipv6();
        (address.ip() != source, is_other_family)
    });
    reachable
}

/// A link-local address with the interface that it was seen on.
fn on_interface(address: SocketAddr, source: IpAddr) -> Option<SocketAddr> {
    let is_local = matches!(address.ip(), IpAddr::V6(ip) if ip.is_unicast_link_local());
    if is_local {
        let is_source = ipv6::without_interface(source) == address.ip();
        return is_source.then(|| SocketAddr::new(source, address.port()));
    }
    Some(address)
}

/// Reads a boolean: one octet.
pub(super) fn read_bool(value: &mut Cursor<'_>) -> Result<bool, WireError> {
    Ok(value.u8()? != 0)
}

/// Writes each address as a locator.
pub(super) fn write_locators(
    list: &mut ParameterWriter<'_>,
    id: ParameterId,
    addresses: &[SocketAddr],
) {
    for address in addresses {
        let ip = ipv6::without_interface(address.ip());
        let locator = Locator::from(SocketAddr::new(ip, address.port()));
        list.parameter(id, |out| locator.encode(out));
    }
}

/// Writes a string.
pub(super) fn write_string_parameter(
    list: &mut ParameterWriter<'_>,
    id: ParameterId,
    string: &str,
) {
    list.parameter(id, |out| write_string(string, out));
}

/// Writes which protocol and whose implementation the announced entity speaks.
pub(super) fn write_version(list: &mut ParameterWriter<'_>) {
    list.parameter(PROTOCOL_VERSION_ID, |out| {
        out.extend_from_slice(&[PROTOCOL_VERSION.major, PROTOCOL_VERSION.minor]);
    });
    list.parameter(VENDOR_ID, |out| out.extend_from_slice(&VendorId::UNKNOWN.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn addresses(list: &[&str]) -> Vec<SocketAddr> {
        list.iter()
            .map(|address| address.parse().unwrap())
            .collect()
    }

    #[test]
    fn the_source_comes_first_and_then_its_family() {
        let all = addresses(&[
            "[fd00::1]:7410",
            "10.0.0.1:7410",
            "127.0.0.1:7410",
            "239.255.0.1:7410",
            "10.0.1.1:7410",
        ]);
        assert_eq!(
            reachable(&all, "10.0.1.1".parse().unwrap()),
            addresses(&["10.0.1.1:7410", "10.0.0.1:7410", "[fd00::1]:7410"])
        );
        let from = |source: &str| reachable(&all, source.parse().unwrap())[0];
        assert_eq!(from("127.0.0.1"), all[2], "a participant on this host");
        assert_eq!(from("fd00::2"), all[0], "not announced, IPv6");
        assert_eq!(from("10.0.2.1"), all[1], "not announced, IPv4");
    }

    #[test]
    fn link_local_addresses_are_used_where_they_were_seen() {
        let all = addresses(&["[fe80::1]:7410", "[fe80::2]:7410", "[fd00::1]:7410"]);
        assert_eq!(
            reachable(&all, "fe80:0:0:3::1".parse().unwrap()),
            addresses(&["[fe80:0:0:3::1]:7410", "[fd00::1]:7410"])
        );
        assert_eq!(reachable(&all, "fd00::1".parse().unwrap()), [all[2]]);
    }

    #[test]
    fn locators_that_no_datagram_can_be_sent_to_are_skipped() {
        let mut list = Vec::new();
        for address in [
            "0.0.0.0:1",
            "0.0.0.1:7400",
            "255.255.255.255:1",
            "[::]:1",
            "[fe80:0:0:1::1]:1",
            "1.2.3.4:0",
        ] {
            let mut bytes = Vec::new();
            Locator::from(address.parse::<SocketAddr>().unwrap()).encode(&mut bytes);
            let mut value = Cursor::new(&bytes, crate::wire::Endianness::Little);
            read_locator(&mut value, &mut list).unwrap();
        }
        assert_eq!(list, []);
    }
}
