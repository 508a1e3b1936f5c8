//! Hosts that multicast does not reach: the environment names them as it does for ROS 2.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

use super::sockets::unicast_ports;

/// Names and addresses of hosts, separated by semicolons; with a port, one participant is meant.
const PEERS_VARIABLE: &str = "ROS_STATIC_PEERS";
/// Participants of a host that is named without a port: those that start first.
const PARTICIPANTS_OF_A_PEER: u32 = 5;

/// Where to announce in a domain, beside the groups, as the environment says.
pub(super) fn from_environment(domain: u32) -> Vec<SocketAddr> {
    let peers = std::env::var(PEERS_VARIABLE).unwrap_or_default();
    peers
        .split(';')
        .map(str::trim)
        .filter(|peer| !peer.is_empty())
        .flat_map(|peer| {
            let addresses = addresses_of(peer, domain);
            if addresses.is_empty() {
                tracing::warn!(peer, "{PEERS_VARIABLE} names a host that nobody knows");
            }
            addresses
        })
        .collect()
}

fn addresses_of(peer: &str, domain: u32) -> Vec<SocketAddr> {
    if let Ok(address) = peer.parse() {
        return vec![address];
    }
    let hosts = match peer.parse::<IpAddr>() {
        Ok(ip) => vec![ip],
        Err(_) => resolve(peer),
    };
    let ports = (0..PARTICIPANTS_OF_A_PEER)
        .filter_map(|participant| unicast_ports(domain, participant))
        .map(|(metatraffic, _)| metatraffic);
    ports
        .flat_map(|port| hosts.iter().map(move |ip| SocketAddr::new(*ip, port)))
        .collect()
}

/// The addresses of a name; none where it is unknown.
fn resolve(name: &str) -> Vec<IpAddr> {
    let addresses = (name, 0).to_socket_addrs();
    addresses.map_or_else(|_| Vec::new(), |found| found.map(|one| one.ip()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_stands_for_its_first_participants() {
        let host = addresses_of("fd00::2", 1);
        assert_eq!(host.len(), 5);
        assert_eq!(host[1], "[fd00::2]:7662".parse().unwrap());
        let one = "[fd00::2]:99".parse().unwrap();
        assert_eq!(addresses_of("[fd00::2]:99", 1), [one]);
        assert_eq!(
            addresses_of("10.0.0.2", 0)[0],
            "10.0.0.2:7410".parse().unwrap()
        );
        assert_eq!(addresses_of("no host has spaces", 0), []);
    }
}
