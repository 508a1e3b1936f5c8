//! The command line.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::os::fd::RawFd;
use std::str::FromStr;
use std::time::Duration;

use clap::Parser;
use rtps_ebpf::abi::{DISCOVERY_KERNEL, DISCOVERY_USER, DOORBELL_PACKET, DOORBELL_RING};
use rtps_user::ipv6;
use tracing::warn;

use crate::loader::WantedMode;
use crate::sockets::Ports;

/// Runs the kernel layer of this network namespace, until SIGTERM or SIGINT ends it and removes it from the kernel.
#[derive(Clone, Debug, Parser)]
#[command(name = "rtpsd", version)]
pub struct Options {
    /// An interface to work on; may be given several times.
    #[arg(long = "iface", value_name = "IF", required = true)]
    pub interfaces: Vec<String>,

    /// A DDS domain to take part in; may be given several times.
    #[arg(long = "domain", value_name = "N", default_value = "0", value_parser = parse_domain)]
    pub domains: Vec<u32>,

    /// Where messages for apps are taken from the interfaces.
    #[arg(long, value_enum, default_value_t)]
    pub mode: WantedMode,

    /// How a sleeping app is woken.
    #[arg(long, value_enum, default_value_t)]
    pub doorbell: Doorbell,

    /// Who answers discovery messages.
    #[arg(long, value_enum, default_value_t)]
    pub discovery: Discovery,

    /// Take what names a known participant as its sender from any address: for participants on hosts that send from
    /// addresses which they do not announce.
    #[arg(long)]
    pub any_source: bool,

    /// Permissions of the socket that apps connect to, in octal.
    #[arg(long, value_name = "MODE", default_value = "0666", value_parser = parse_mode)]
    pub socket_mode: u32,

    /// The group that the socket belongs to.
    #[arg(long, value_name = "NAME")]
    pub group: Option<String>,

    /// The address of a host that multicast does not reach, with or without port; may be given several times. Those in
    /// ROS_STATIC_PEERS, separated by semicolons, count as well.
    #[arg(long = "peer", value_name = "ADDR")]
    pub peers: Vec<Peer>,

    /// Neither announce to the multicast group nor listen to it for discovery.
    #[arg(long)]
    pub no_multicast: bool,

    /// How long others believe in this host without a sign of life.
    #[arg(long, value_name = "SECONDS", default_value = "20", value_parser = parse_lease)]
    pub lease: Duration,

    /// The largest ring that an app may have, in bytes.
    #[arg(long, value_name = "BYTES", default_value_t = 64 << 20)]
    pub max_ring: u32,

    /// A descriptor that a line is written to when apps can connect.
    #[arg(long, value_name = "FD")]
    pub ready_fd: Option<RawFd>,

    /// Log details; RUST_LOG says so more finely.
    #[arg(long, short)]
    pub verbose: bool,

    /// Stay in the foreground, which rtpsd always does: who starts it decides about a daemon.
    #[arg(long)]
    pub foreground: bool,
}

/// Who answers discovery messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Discovery {
    /// The kernel, which tells rtpsd the news; rtpsd where the kernel cannot.
    #[default]
    Kernel,
    /// rtpsd alone.
    User,
}

impl Discovery {
    pub(crate) fn to_abi(self) -> u32 {
        match self {
            Self::Kernel => DISCOVERY_KERNEL,
            Self::User => DISCOVERY_USER,
        }
    }
}

/// How a sleeping app is woken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Doorbell {
    /// By the datagram itself where that works: fastest.
    #[default]
    Packet,
    /// By the ring's own notification: where a firewall keeps datagrams from the apps' ports.
    Ring,
}

impl Doorbell {
    pub(crate) fn to_abi(self) -> u32 {
        match self {
            Self::Packet => DOORBELL_PACKET,
            Self::Ring => DOORBELL_RING,
        }
    }
}

/// Where a peer may be announced to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peer {
    /// One of the first participants of a host.
    Host(IpAddr),
    /// One participant.
    Port(SocketAddr),
}

/// Participants of a host that is given without a port.
const PARTICIPANTS_OF_A_PEER: u16 = 5;

/// What ROS 2 keeps its peers in.
const STATIC_PEERS: &str = "ROS_STATIC_PEERS";

impl Options {
    /// The peers of the command line and of the environment.
    pub(crate) fn all_peers(&self) -> Vec<Peer> {
        let of_environment = std::env::var(STATIC_PEERS).unwrap_or_default();
        let of_environment = static_peers(&of_environment);
        self.peers.iter().copied().chain(of_environment).collect()
    }
}

/// Addresses, or names of hosts, separated by semicolons. The list is not made for rtpsd alone: what it does not
/// understand it leaves out.
fn static_peers(list: &str) -> Vec<Peer> {
    let entries = list.split(';').map(str::trim);
    entries
        .filter(|entry| !entry.is_empty())
        .flat_map(|entry| match entry.parse() {
            Ok(peer) => vec![peer],
            Err(_) => hosts_by_name(entry),
        })
        .collect()
}

fn hosts_by_name(name: &str) -> Vec<Peer> {
    match (name, 0).to_socket_addrs() {
        Ok(addresses) => addresses.map(|address| Peer::Host(address.ip())).collect(),
        Err(error) => {
            warn!("{STATIC_PEERS}: no address of `{name}` is known ({error})");
            Vec::new()
        }
    }
}

impl Peer {
    pub(crate) fn addresses(self, ports: Ports) -> Vec<SocketAddr> {
        match self {
            Self::Port(address) => vec![ipv6::from_socket(address)],
            Self::Host(ip) => (0..PARTICIPANTS_OF_A_PEER)
                .map(|id| SocketAddr::new(ip, ports.metatraffic_unicast(id)))
                .collect(),
        }
    }
}

impl FromStr for Peer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.parse()
            .map(Self::Port)
            .or_else(|_| text.parse().map(Self::Host))
            .map_err(|_| format!("`{text}` is neither an IP address nor one with a port"))
    }
}

fn parse_domain(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|domain| Ports::of_domain(*domain).is_some())
        .ok_or_else(|| "a domain is a number from 0 to 232".to_owned())
}

fn parse_mode(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 8)
        .ok()
        .filter(|mode| *mode <= 0o777)
        .ok_or_else(|| "permissions are an octal number such as 0660".to_owned())
}

fn parse_lease(text: &str) -> Result<Duration, String> {
    text.parse()
        .ok()
        .filter(|seconds| (2..=86_400).contains(seconds))
        .map(Duration::from_secs)
        .ok_or_else(|| "a lease is a number of seconds from 2 to 86400".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(arguments: &[&str]) -> Result<Options, clap::Error> {
        Options::try_parse_from([&["rtpsd"], arguments].concat())
    }

    #[test]
    fn domain_0_by_default_and_several_on_demand() {
        assert_eq!(parse(&["--iface", "a"]).unwrap().domains, [0]);
        let several = parse(&["--iface", "a", "--domain", "3", "--domain", "0"]).unwrap();
        assert_eq!(several.domains, [3, 0]);
    }

    #[test]
    fn nonsense_is_refused() {
        for arguments in [
            &[][..],
            &["--iface", "a", "--domain", "233"],
            &["--iface", "a", "--socket-mode", "9"],
            &["--iface", "a", "--lease", "0"],
            &["--iface", "a", "--peer", "host"],
            &["--iface", "a", "--discovery", "nobody"],
        ] {
            assert!(parse(arguments).is_err(), "{arguments:?}");
        }
    }

    #[test]
    fn the_kernel_answers_unless_told_otherwise() {
        let discovery = |arguments: &[&str]| parse(arguments).unwrap().discovery;
        assert_eq!(discovery(&["--iface", "a"]), Discovery::Kernel);
        assert_eq!(
            discovery(&["--iface", "a", "--discovery", "user"]),
            Discovery::User
        );
    }

    #[test]
    fn static_peers_are_separated_by_semicolons() {
        assert_eq!(static_peers(""), []);
        let peers = static_peers("10.0.0.2; [fd00::1]:7410 ;;no such host!;::1");
        assert_eq!(
            peers,
            [
                Peer::Host("10.0.0.2".parse().unwrap()),
                Peer::Port("[fd00::1]:7410".parse().unwrap()),
                Peer::Host("::1".parse().unwrap()),
            ]
        );
    }

    #[test]
    fn a_peer_without_port_stands_for_the_first_participants() {
        let ports = Ports::of_domain(0).unwrap();
        let peer: Peer = "10.0.0.2".parse().unwrap();
        let addresses = peer.addresses(ports);
        assert_eq!(addresses.len(), usize::from(PARTICIPANTS_OF_A_PEER));
        assert_eq!(addresses[1], "10.0.0.2:7412".parse().unwrap());
        let one: Peer = "10.0.0.2:99".parse().unwrap();
        assert_eq!(one.addresses(ports), ["10.0.0.2:99".parse().unwrap()]);
    }
}
