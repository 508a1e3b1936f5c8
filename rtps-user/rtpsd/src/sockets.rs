//! The layer's own UDP sockets in one domain, each with the low-level layer's filter attached.
//!
//! Ports follow RTPS 2.5, 9.6.2.3: PB 7400, DG 250, PG 2, offsets 0, 10, 1 and 11. The multicast sockets are bound
//! to their group's address and share their ports, so that they take nothing from other DDS stacks of this host; the
//! unicast ones belong to the first participant id that is free. IPv4 and IPv6 have sockets of their own on the same
//! ports; a host without IPv6 does with those of IPv4.

use std::io::{self, IoSlice};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV6, UdpSocket};
use std::os::fd::{AsFd, AsRawFd};

use anyhow::{Context, Result, bail};
use aya::programs::SocketFilter;
use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrIn, SockaddrIn6, sendmsg};
use rtps_net::{Interface, LOOPBACK_INDEX, addresses_towards};
use rtps_user::discovery::for_interface;
use rtps_user::ipv6;
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, SockRef, Socket, Type};
use tracing::{debug, info, warn};

use crate::sys;

/// The IPv4 group of SPDP and, by default, of user multicast (RTPS 2.5, 9.6.2.4).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// The highest participant id whose ports stay below those of the next domain.
const LAST_PARTICIPANT_ID: u16 = 119;

/// Room for a burst of discovery traffic, in bytes.
const RECEIVE_BUFFER: usize = 4 << 20;

/// The well-known ports of a domain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ports {
    base: u16,
}

impl Ports {
    /// `None` for domains whose ports do not fit into 16 bits.
    pub(crate) fn of_domain(domain: u32) -> Option<Self> {
        let base = u16::try_from(domain.checked_mul(250)?.checked_add(7400)?).ok()?;
        base.checked_add(11)?;
        Some(Self { base })
    }

    /// The highest participant id whose ports exist and stay below those of the next domain.
    pub(crate) fn last_participant_id(self) -> u16 {
        ((u16::MAX - self.base - 11) / 2).min(LAST_PARTICIPANT_ID)
    }

    pub(crate) fn metatraffic_multicast(self) -> u16 {
        self.base
    }

    pub(crate) fn user_multicast(self) -> u16 {
        self.base + 1
    }

    pub(crate) fn metatraffic_unicast(self, participant_id: u16) -> u16 {
        self.base + 10 + 2 * participant_id
    }

    pub(crate) fn user_unicast(self, participant_id: u16) -> u16 {
        self.base + 11 + 2 * participant_id
    }
}

/// The sockets of one domain.
pub(crate) struct DomainSockets {
    pub(crate) participant_id: u16,
    ports: Ports,
    v4: FamilySockets,
    /// `None` on a host without IPv6.
    v6: Option<FamilySockets>,
}

/// Those of IPv4, or those of IPv6.
struct FamilySockets {
    unicast: UnicastSockets,
    /// By the group that each is bound to: one of either kind for each group.
    multicast: Vec<(IpAddr, UdpSocket)>,
}

/// The two ports that belong to the participant alone.
struct UnicastSockets {
    metatraffic: UdpSocket,
    user: UdpSocket,
}

impl DomainSockets {
    /// Opens all, with the participant id of before where it is still free.
    pub(crate) fn open(
        ports: Ports,
        interfaces: &[Interface],
        filter: &SocketFilter,
        preferred_id: Option<u16>,
    ) -> Result<Self> {
        let (participant_id, v4, v6) = open_unicast(ports, filter, preferred_id)?;
        let v6 = v6.map(|unicast| FamilySockets {
            unicast,
            multicast: open_groups_v6(ports, filter),
        });
        let sockets = Self {
            participant_id,
            ports,
            v4: FamilySockets {
                unicast: v4,
                multicast: open_groups(ports, filter, &[GROUP.into()])?,
            },
            v6,
        };
        for interface in interfaces {
            sockets.join(interface)?;
        }
        sockets.join_loopback();
        Ok(sockets)
    }

    /// Joins the groups on an interface; to have joined before is no error. Without IPv4 addresses on it, its IPv4
    /// group may be missing, and IPv6 groups always may.
    pub(crate) fn join(&self, interface: &Interface) -> Result<()> {
        for (group, socket) in self.multicast() {
            match join(socket, *group, interface.index) {
                Err(error)
                    if interface.addresses.iter().any(IpAddr::is_ipv4) && group.is_ipv4() =>
                {
                    return Err(error).with_context(|| {
                        format!(
                            "cannot join {group} on `{}`; is it up, and does it do multicast?",
                            interface.name
                        )
                    });
                }
                Err(error) => debug!(%group, interface = interface.name, "cannot join: {error}"),
                Ok(()) => {}
            }
        }
        Ok(())
    }

    /// Other stacks that keep to this host announce themselves on the loopback interface, where there may be none.
    fn join_loopback(&self) {
        for (group, socket) in self.multicast() {
            if let Err(error) = join(socket, *group, LOOPBACK_INDEX) {
                debug!(%group, "multicast on the loopback interface is not heard: {error}");
            }
        }
    }

    fn families(&self) -> impl Iterator<Item = &FamilySockets> {
        [&self.v4].into_iter().chain(&self.v6)
    }

    fn multicast(&self) -> impl Iterator<Item = &(IpAddr, UdpSocket)> {
        self.families().flat_map(|family| &family.multicast)
    }

    /// Where announcements go to and come from.
    pub(crate) fn groups(&self) -> Vec<SocketAddr> {
        let port = self.ports.metatraffic_multicast();
        let mut groups: Vec<_> = self
            .multicast()
            .map(|(group, _)| SocketAddr::new(*group, port))
            .collect();
        groups.sort();
        groups.dedup();
        groups
    }

    /// Every socket, in the order that [`receive`](Self::receive) counts them.
    pub(crate) fn all(&self) -> impl Iterator<Item = &UdpSocket> {
        self.families().flat_map(|family| {
            let unicast = [&family.unicast.metatraffic, &family.unicast.user];
            let multicast = family.multicast.iter().map(|(_, socket)| socket);
            unicast.into_iter().chain(multicast)
        })
    }

    /// The next datagram of a socket; `None` when there is none now.
    pub(crate) fn receive(&self, socket: usize, buffer: &mut [u8]) -> Option<(usize, SocketAddr)> {
        let socket = self.all().nth(socket)?;
        loop {
            match socket.recv_from(buffer) {
                Ok((len, source)) => return Some((len, ipv6::from_socket(source))),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    warn!("cannot receive: {error}");
                    return None;
                }
            }
        }
    }

    /// Sends a datagram from the metatraffic port; to a group: out of every interface with an address of the group's
    /// family. An announcement names that interface's addresses first. What cannot be sent now is lost, as the network
    /// might have lost it.
    pub(crate) fn send(&self, datagram: &[u8], destination: SocketAddr, interfaces: &[Interface]) {
        let family = match destination {
            SocketAddr::V4(_) => Some(&self.v4),
            SocketAddr::V6(_) => self.v6.as_ref(),
        };
        let Some(family) = family else {
            debug!(%destination, "this host has no IPv6");
            return;
        };
        let socket = &family.unicast.metatraffic;
        if !destination.ip().is_multicast() {
            let datagram = for_interface(datagram, || addresses_towards(interfaces, destination));
            if let Err(error) = socket.send_to(&datagram, ipv6::to_socket(destination)) {
                debug!(%destination, "cannot send: {error}");
            }
            return;
        }
        for interface in interfaces {
            let Some(source) = interface.source(destination.ip()) else {
                continue;
            };
            let datagram = for_interface(datagram, || Some(&interface.addresses));
            if let Err(error) = send_out_of(socket, &datagram, destination, interface, source) {
                debug!(%destination, interface = interface.name, "cannot send: {error}");
            }
        }
    }
}

/// Sends to a group out of one interface, from one of its addresses: by default the kernel would take a link-local
/// one for the link's own groups, by which nobody knows us.
fn send_out_of(
    socket: &UdpSocket,
    datagram: &[u8],
    destination: SocketAddr,
    interface: &Interface,
    source: IpAddr,
) -> io::Result<()> {
    let (descriptor, parts) = (socket.as_raw_fd(), [IoSlice::new(datagram)]);
    let flags = MsgFlags::MSG_DONTWAIT;
    match (destination, ipv6::without_interface(source)) {
        (SocketAddr::V4(destination), IpAddr::V4(source)) => {
            let out_of = libc::in_pktinfo {
                ipi_ifindex: i32::try_from(interface.index).map_err(io::Error::other)?,
                ipi_spec_dst: libc::in_addr {
                    s_addr: u32::from_ne_bytes(source.octets()),
                },
                ipi_addr: libc::in_addr { s_addr: 0 },
            };
            let control = [ControlMessage::Ipv4PacketInfo(&out_of)];
            let destination = SockaddrIn::from(destination);
            sendmsg(descriptor, &parts, &control, flags, Some(&destination))?;
        }
        (SocketAddr::V6(mut destination), IpAddr::V6(source)) => {
            destination.set_scope_id(interface.index);
            let out_of = libc::in6_pktinfo {
                ipi6_addr: libc::in6_addr {
                    s6_addr: source.octets(),
                },
                ipi6_ifindex: interface.index,
            };
            let control = [ControlMessage::Ipv6PacketInfo(&out_of)];
            let destination = SockaddrIn6::from(destination);
            sendmsg(descriptor, &parts, &control, flags, Some(&destination))?;
        }
        _ => {}
    }
    Ok(())
}

fn join(socket: &UdpSocket, group: IpAddr, interface_index: u32) -> io::Result<()> {
    let socket = SockRef::from(socket);
    let joined = match group {
        IpAddr::V4(group) => {
            let interface = InterfaceIndexOrAddress::Index(interface_index);
            socket.join_multicast_v4_n(&group, &interface)
        }
        IpAddr::V6(group) => socket.join_multicast_v6(&group, interface_index),
    };
    match joined {
        Err(error) if error.raw_os_error() == Some(libc::EADDRINUSE) => Ok(()),
        other => other,
    }
}

/// The unicast sockets of the first participant id that is free in both families, the preferred one first.
fn open_unicast(
    ports: Ports,
    filter: &SocketFilter,
    preferred_id: Option<u16>,
) -> Result<(u16, UnicastSockets, Option<UnicastSockets>)> {
    let has_ipv6 = match UdpSocket::bind((Ipv6Addr::UNSPECIFIED, 0)) {
        Ok(_) => true,
        Err(error) => {
            info!("without IPv6: {error}");
            false
        }
    };
    let ids = preferred_id
        .into_iter()
        .chain(0..=ports.last_participant_id());
    for participant_id in ids {
        let open = |any: IpAddr| -> Result<Option<UnicastSockets>> {
            let port = ports.metatraffic_unicast(participant_id);
            let metatraffic = open_exclusive((any, port).into(), filter)?;
            let port = ports.user_unicast(participant_id);
            let user = open_exclusive((any, port).into(), filter)?;
            let both = metatraffic.zip(user);
            Ok(both.map(|(metatraffic, user)| UnicastSockets { metatraffic, user }))
        };
        let Some(v4) = open(Ipv4Addr::UNSPECIFIED.into())? else {
            continue;
        };
        if !has_ipv6 {
            return Ok((participant_id, v4, None));
        }
        if let Some(v6) = open(Ipv6Addr::UNSPECIFIED.into())? {
            return Ok((participant_id, v4, Some(v6)));
        }
    }
    bail!(
        "every participant id of the domain is taken by other DDS stacks (UDP ports {} to {}); `ss -ulpn` lists them",
        ports.metatraffic_unicast(0),
        ports.user_unicast(ports.last_participant_id())
    )
}

/// A socket that shares its port with nobody; `None` when the port is taken.
fn open_exclusive(address: SocketAddr, filter: &SocketFilter) -> Result<Option<UdpSocket>> {
    let socket = new_socket(Domain::for_address(address), filter)?;
    match socket.bind(&address.into()) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => return Ok(None),
        Err(error) => return Err(error).with_context(|| format!("cannot bind {address}")),
    }
    if address.is_ipv4() {
        socket.set_multicast_ttl_v4(1)?;
        socket.set_multicast_loop_v4(true)?;
    } else {
        socket.set_multicast_hops_v6(1)?;
        socket.set_multicast_loop_v6(true)?;
        // Temporary addresses, which the kernel may prefer, are not announced.
        sys::prefer_public_addresses(socket.as_fd())?;
    }
    Ok(Some(socket.into()))
}

/// Those of IPv6 are dispensable: whom they do not reach may be reached by IPv4.
fn open_groups_v6(ports: Ports, filter: &SocketFilter) -> Vec<(IpAddr, UdpSocket)> {
    let groups = ipv6::GROUPS.map(IpAddr::from);
    open_groups(ports, filter, &groups).unwrap_or_else(|error| {
        warn!("no IPv6 multicast: {error:#}");
        Vec::new()
    })
}

/// For each group a socket of metatraffic and one of user traffic.
fn open_groups(
    ports: Ports,
    filter: &SocketFilter,
    groups: &[IpAddr],
) -> Result<Vec<(IpAddr, UdpSocket)>> {
    let mut sockets = Vec::new();
    for group in groups {
        for port in [ports.metatraffic_multicast(), ports.user_multicast()] {
            sockets.push((*group, open_multicast(*group, port, filter)?));
        }
    }
    Ok(sockets)
}

fn open_multicast(group: IpAddr, port: u16, filter: &SocketFilter) -> Result<UdpSocket> {
    let address = match group {
        IpAddr::V4(group) => SocketAddr::from((group, port)),
        // Groups of the link can be bound on one interface only, any of them: it is taken back below.
        IpAddr::V6(group) => SocketAddrV6::new(group, port, 0, LOOPBACK_INDEX).into(),
    };
    let socket = new_socket(Domain::for_address(address), filter)?;
    // Both, because other stacks set either, and a port is shared only among those who set the same.
    socket.set_reuse_address(true)?;
    socket.set_reuse_port(true)?;
    socket.bind(&address.into()).with_context(|| {
        format!("cannot share UDP port {port}, which another program keeps for itself; `ss -ulpn` names it")
    })?;
    // Only what comes in on a joined interface, even when another process joined elsewhere.
    if group.is_ipv4() {
        socket.set_multicast_all_v4(false)?;
    } else {
        socket.set_multicast_all_v6(false)?;
        socket.bind_device(None)?;
    }
    Ok(socket.into())
}

/// A socket that already has the filter, so that no datagram comes in without passing it.
fn new_socket(family: Domain, filter: &SocketFilter) -> Result<Socket> {
    let kind = Type::DGRAM.nonblocking().cloexec();
    let socket =
        Socket::new(family, kind, Some(Protocol::UDP)).context("cannot open a UDP socket")?;
    if family == Domain::IPV6 {
        socket.set_only_v6(true)?;
    }
    filter
        .attach(&socket)
        .context("cannot attach the socket filter")?;
    if nix::sys::socket::setsockopt(
        &socket,
        nix::sys::socket::sockopt::RcvBufForce,
        &RECEIVE_BUFFER,
    )
    .is_err()
    {
        socket.set_recv_buffer_size(RECEIVE_BUFFER)?;
    }
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_are_those_of_the_standard() {
        let ports = Ports::of_domain(1).unwrap();
        assert_eq!(ports.metatraffic_multicast(), 7650);
        assert_eq!(ports.user_multicast(), 7651);
        assert_eq!(ports.metatraffic_unicast(2), 7664);
        assert_eq!(ports.user_unicast(2), 7665);
    }

    #[test]
    fn the_last_domain_is_232() {
        let last = Ports::of_domain(232).unwrap();
        assert!(last.user_unicast(last.last_participant_id()) >= 65_534);
        assert!(Ports::of_domain(233).is_none());
        assert!(Ports::of_domain(u32::MAX).is_none());
    }
}
