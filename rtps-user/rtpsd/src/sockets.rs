//! The layer's own UDP sockets in one domain, each with the low-level layer's filter attached.
//!
//! Ports follow RTPS 2.5, 9.6.2.3: PB 7400, DG 250, PG 2, offsets 0, 10, 1 and 11. The multicast sockets are bound
//! to the group's address and share their ports, so that they take nothing from other DDS stacks of this host; the
//! unicast ones belong to the first participant id that is free.

use std::io::{self, IoSlice};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result, bail};
use aya::programs::SocketFilter;
use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrIn, sendmsg};
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, Socket, Type};
use tracing::{debug, warn};

use crate::interfaces::{Interface, LOOPBACK_INDEX};

/// The group of SPDP and, by default, of user multicast (RTPS 2.5, 9.6.2.4).
pub(crate) const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

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
    metatraffic: UdpSocket,
    user: UdpSocket,
    metatraffic_multicast: UdpSocket,
    user_multicast: UdpSocket,
}

impl DomainSockets {
    /// Opens all four, with the participant id of before where it is still free.
    pub(crate) fn open(
        ports: Ports,
        interfaces: &[Interface],
        filter: &SocketFilter,
        preferred_id: Option<u16>,
    ) -> Result<Self> {
        let (participant_id, metatraffic, user) = open_unicast(ports, filter, preferred_id)?;
        let sockets = Self {
            participant_id,
            metatraffic,
            user,
            metatraffic_multicast: open_multicast(ports.metatraffic_multicast(), filter)?,
            user_multicast: open_multicast(ports.user_multicast(), filter)?,
        };
        for interface in interfaces {
            sockets.join(interface)?;
        }
        sockets.join_loopback();
        Ok(sockets)
    }

    /// Joins the group on an interface.
    pub(crate) fn join(&self, interface: &Interface) -> Result<()> {
        for socket in [&self.metatraffic_multicast, &self.user_multicast] {
            join(socket, interface.index).with_context(|| {
                format!(
                    "cannot join {GROUP} on `{}`; is it up, and does it do multicast?",
                    interface.name
                )
            })?;
        }
        Ok(())
    }

    /// Other stacks that keep to this host announce themselves on the loopback interface, where there may be none.
    fn join_loopback(&self) {
        for socket in [&self.metatraffic_multicast, &self.user_multicast] {
            if let Err(error) = join(socket, LOOPBACK_INDEX) {
                debug!("multicast on the loopback interface is not heard: {error}");
            }
        }
    }

    /// Every socket, in the order that [`receive`](Self::receive) counts them.
    pub(crate) fn all(&self) -> [&UdpSocket; 4] {
        [
            &self.metatraffic,
            &self.user,
            &self.metatraffic_multicast,
            &self.user_multicast,
        ]
    }

    /// The next datagram of a socket; `None` when there is none now.
    pub(crate) fn receive(&self, socket: usize, buffer: &mut [u8]) -> Option<(usize, SocketAddr)> {
        let socket = *self.all().get(socket)?;
        loop {
            match socket.recv_from(buffer) {
                Ok(datagram) => return Some(datagram),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    warn!("cannot receive: {error}");
                    return None;
                }
            }
        }
    }

    /// Sends a datagram from the metatraffic port; to a group: out of every interface. What cannot be sent now is
    /// lost, as the network might have lost it.
    pub(crate) fn send(&self, datagram: &[u8], destination: SocketAddr, interfaces: &[Interface]) {
        let SocketAddr::V4(destination) = destination else {
            debug!(%destination, "no IPv6 yet");
            return;
        };
        if !destination.ip().is_multicast() {
            if let Err(error) = self.metatraffic.send_to(datagram, destination) {
                debug!(%destination, "cannot send: {error}");
            }
            return;
        }
        for interface in interfaces {
            if let Err(error) = self.send_out_of(datagram, destination, interface) {
                debug!(%destination, interface = interface.name, "cannot send: {error}");
            }
        }
    }

    fn send_out_of(
        &self,
        datagram: &[u8],
        destination: SocketAddrV4,
        interface: &Interface,
    ) -> io::Result<()> {
        let source = interface
            .addresses
            .first()
            .copied()
            .unwrap_or(Ipv4Addr::UNSPECIFIED);
        let out_of = libc::in_pktinfo {
            ipi_ifindex: i32::try_from(interface.index).map_err(io::Error::other)?,
            ipi_spec_dst: libc::in_addr {
                s_addr: u32::from_ne_bytes(source.octets()),
            },
            ipi_addr: libc::in_addr { s_addr: 0 },
        };
        sendmsg(
            self.metatraffic.as_raw_fd(),
            &[IoSlice::new(datagram)],
            &[ControlMessage::Ipv4PacketInfo(&out_of)],
            MsgFlags::MSG_DONTWAIT,
            Some(&SockaddrIn::from(destination)),
        )?;
        Ok(())
    }
}

fn join(socket: &UdpSocket, interface_index: u32) -> io::Result<()> {
    let interface = InterfaceIndexOrAddress::Index(interface_index);
    match socket2::SockRef::from(socket).join_multicast_v4_n(&GROUP, &interface) {
        Err(error) if error.raw_os_error() == Some(libc::EADDRINUSE) => Ok(()),
        other => other,
    }
}

/// The two unicast sockets of the first free participant id, the preferred one first.
fn open_unicast(
    ports: Ports,
    filter: &SocketFilter,
    preferred_id: Option<u16>,
) -> Result<(u16, UdpSocket, UdpSocket)> {
    let ids = preferred_id
        .into_iter()
        .chain(0..=ports.last_participant_id());
    for participant_id in ids {
        let metatraffic = open_exclusive(ports.metatraffic_unicast(participant_id), filter)?;
        let user = open_exclusive(ports.user_unicast(participant_id), filter)?;
        if let (Some(metatraffic), Some(user)) = (metatraffic, user) {
            return Ok((participant_id, metatraffic, user));
        }
    }
    bail!(
        "every participant id of the domain is taken by other DDS stacks (UDP ports {} to {}); `ss -ulpn` lists them",
        ports.metatraffic_unicast(0),
        ports.user_unicast(ports.last_participant_id())
    )
}

/// A socket that shares its port with nobody; `None` when the port is taken.
fn open_exclusive(port: u16, filter: &SocketFilter) -> Result<Option<UdpSocket>> {
    let socket = new_socket(filter)?;
    let address = SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
    match socket.bind(&address.into()) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => return Ok(None),
        Err(error) => return Err(error).with_context(|| format!("cannot bind UDP port {port}")),
    }
    socket.set_multicast_ttl_v4(1)?;
    socket.set_multicast_loop_v4(true)?;
    Ok(Some(socket.into()))
}

fn open_multicast(port: u16, filter: &SocketFilter) -> Result<UdpSocket> {
    let socket = new_socket(filter)?;
    // Both, because other stacks set either, and a port is shared only among those who set the same.
    socket.set_reuse_address(true)?;
    socket.set_reuse_port(true)?;
    // Only what comes in on a joined interface, even when another process joined elsewhere.
    socket.set_multicast_all_v4(false)?;
    let address = SocketAddr::from((GROUP, port));
    socket.bind(&address.into()).with_context(|| {
        format!("cannot share UDP port {port}, which another program keeps for itself; `ss -ulpn` names it")
    })?;
    Ok(socket.into())
}

/// A socket that already has the filter, so that no datagram comes in without passing it.
fn new_socket(filter: &SocketFilter) -> Result<Socket> {
    let socket = Socket::new(
        Domain::IPV4,
        Type::DGRAM.nonblocking().cloexec(),
        Some(Protocol::UDP),
    )
    .context("cannot open a UDP socket")?;
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
