//! The sockets of a participant, and the ports that RTPS 2.5 section 9.6.2.3 gives them: three for IPv4 and, where the
//! host has it, three on the same ports for IPv6.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;

use rtps_net::Interface;
use rtps_user::ipv6;

use super::InProcessError;
use crate::sys::{Epoll, Interest, receive, udp};

/// The group of SPDP for IPv4 (RTPS 2.5 section 9.6.2.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// PB, DG, PG, d0, d1 and d3.
const PORT_BASE: u32 = 7400;
const DOMAIN_GAIN: u32 = 250;
const PARTICIPANT_GAIN: u32 = 2;
const METATRAFFIC_OFFSET: u32 = 10;
const USER_OFFSET: u32 = 11;
/// Participant ids whose ports are below those of the next domain.
const PARTICIPANTS: u32 = 120;

/// Room for bursts while the app does other things, in bytes; the kernel may cap it.
const RECEIVE_BUFFER: usize = 4 << 20;

/// See the module.
#[derive(Debug)]
pub(super) struct Sockets {
    pub(super) metatraffic_port: u16,
    pub(super) user_port: u16,
    v4: FamilySockets,
    /// `None` on a host without IPv6.
    v6: Option<FamilySockets>,
    multicast_port: u16,
}

/// Those of IPv4, or those of IPv6.
#[derive(Debug)]
pub(super) struct FamilySockets {
    /// Samples, both ways.
    pub(super) user: UdpSocket,
    /// What concerns this participant's discovery alone; sends discovery traffic, too.
    pub(super) metatraffic: UdpSocket,
    /// Announcements to the groups, shared with every other participant of this host.
    multicast: UdpSocket,
    groups: Vec<IpAddr>,
}

/// What comes to a socket.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Kind {
    /// For the app's endpoints.
    User,
    /// For discovery.
    Metatraffic,
}

impl FamilySockets {
    fn all(&self) -> [(Kind, &UdpSocket); 3] {
        [
            (Kind::User, &self.user),
            (Kind::Metatraffic, &self.metatraffic),
            (Kind::Metatraffic, &self.multicast),
        ]
    }

    fn join(&self, interface: &Interface) {
        for group in &self.groups {
            if let Err(error) = udp::join_group(&self.multicast, *group, interface.index) {
                tracing::debug!(index = interface.index, %group, %error, "no multicast");
            }
        }
    }
}

/// The port of the SPDP group; the domain is at most 232.
pub(super) fn multicast_port(domain: u32) -> u16 {
    (PORT_BASE + DOMAIN_GAIN * domain) as u16
}

/// The metatraffic and user ports of a participant, where there are such.
pub(super) fn unicast_ports(domain: u32, participant: u32) -> Option<(u16, u16)> {
    let first = u32::from(multicast_port(domain)) + PARTICIPANT_GAIN * participant;
    let metatraffic = u16::try_from(first + METATRAFFIC_OFFSET).ok()?;
    let user = u16::try_from(first + USER_OFFSET).ok()?;
    Some((metatraffic, user))
}

impl Sockets {
    /// Opens them on the ports of the first participant id that are free in both families.
    pub(super) fn open(domain: u32, interfaces: &[Interface]) -> Result<Self, InProcessError> {
        let multicast_port = multicast_port(domain);
        let shared_v4 = udp::bind_shared((Ipv4Addr::UNSPECIFIED, multicast_port).into())?;
        let shared_v6 = udp::bind_shared((Ipv6Addr::UNSPECIFIED, multicast_port).into())
            .inspect_err(|error| tracing::info!(%error, "without IPv6"))
            .ok();
        let ports = (0..PARTICIPANTS).map_while(|participant| unicast_ports(domain, participant));
        for (metatraffic_port, user_port) in ports {
            let own = |any: IpAddr| bind_both(any, metatraffic_port, user_port);
            let Some(own_v4) = own(Ipv4Addr::UNSPECIFIED.into())? else {
                continue;
            };
            let own_v6 = match &shared_v6 {
                Some(_) => own(Ipv6Addr::UNSPECIFIED.into())?,
                None => None,
            };
            if shared_v6.is_some() && own_v6.is_none() {
                continue;
            }
            let groups_v6 = ipv6::GROUPS.map(IpAddr::from).to_vec();
            let v6 = own_v6.zip(shared_v6);
            let sockets = Self {
                metatraffic_port,
                user_port,
                v4: family(own_v4, shared_v4, vec![GROUP.into()]),
                v6: v6.map(|(own, shared)| family(own, shared, groups_v6)),
                multicast_port,
            };
            sockets.join(interfaces);
            return Ok(sockets);
        }
        Err(InProcessError::NoFreePorts(domain))
    }

    /// Listens to the groups on these interfaces, too.
    pub(super) fn join(&self, interfaces: &[Interface]) {
        for interface in interfaces {
            self.families().for_each(|family| family.join(interface));
        }
    }

    /// Every socket, in the order in which they are watched.
    pub(super) fn all(&self) -> impl Iterator<Item = (Kind, &UdpSocket)> {
        self.families().flat_map(FamilySockets::all)
    }

    fn families(&self) -> impl Iterator<Item = &FamilySockets> {
        [&self.v4].into_iter().chain(&self.v6)
    }

    /// Those that reach an address.
    pub(super) fn of(&self, address: SocketAddr) -> Option<&FamilySockets> {
        match address {
            SocketAddr::V4(_) => Some(&self.v4),
            SocketAddr::V6(_) => self.v6.as_ref(),
        }
    }

    /// Where announcements go to and come from.
    pub(super) fn groups(&self) -> Vec<SocketAddr> {
        self.families()
            .flat_map(|family| &family.groups)
            .map(|group| SocketAddr::new(*group, self.multicast_port))
            .collect()
    }

    /// Watches all under numbers from `first` on.
    pub(super) fn register(&self, epoll: &Epoll, first: u8) -> io::Result<()> {
        for ((_, socket), number) in self.all().zip(first..) {
            epoll.add(socket.as_fd(), number, Interest::Level)?;
        }
        Ok(())
    }
}

fn family(
    [metatraffic, user]: [UdpSocket; 2],
    multicast: UdpSocket,
    groups: Vec<IpAddr>,
) -> FamilySockets {
    FamilySockets {
        user,
        metatraffic,
        multicast,
        groups,
    }
}

/// Metatraffic and user socket; `None` when somebody has one of the ports.
fn bind_both(any: IpAddr, metatraffic: u16, user: u16) -> io::Result<Option<[UdpSocket; 2]>> {
    let metatraffic = bind_own((any, metatraffic).into())?;
    let user = bind_own((any, user).into())?;
    let both = metatraffic.zip(user);
    Ok(both.map(|(metatraffic, user)| [metatraffic, user]))
}

/// A port of the participant's own; `None` when somebody has it.
fn bind_own(address: SocketAddr) -> io::Result<Option<UdpSocket>> {
    match udp::bind(address) {
        Ok(socket) => {
            receive::set_receive_buffer(&socket, RECEIVE_BUFFER)?;
            if let Err(error) = receive::keep_together(&socket) {
                tracing::debug!(%error, "datagrams come one by one");
            }
            Ok(Some(socket))
        }
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_of_the_standard() {
        assert_eq!(multicast_port(0), 7400);
        assert_eq!(multicast_port(232), 65_400);
        assert_eq!(unicast_ports(0, 1), Some((7412, 7413)));
        assert_eq!(unicast_ports(232, 62), Some((65_534, 65_535)));
        assert_eq!(unicast_ports(232, 63), None);
    }

    #[test]
    fn each_participant_has_its_own_ports() {
        const DOMAIN: u32 = 231;
        let first = Sockets::open(DOMAIN, &[]).unwrap();
        let second = Sockets::open(DOMAIN, &[]).unwrap();
        assert_eq!(first.user_port, first.metatraffic_port + 1);
        assert_ne!(first.user_port, second.user_port);
    }

    #[test]
    fn a_port_is_free_where_both_families_have_it() {
        const DOMAIN: u32 = 230;
        let (port, _) = unicast_ports(DOMAIN, 0).unwrap();
        let taken = match udp::bind((Ipv6Addr::UNSPECIFIED, port).into()) {
            Ok(taken) => taken,
            Err(error) => return println!("skipped: no IPv6 here, {error}"),
        };
        let sockets = Sockets::open(DOMAIN, &[]).unwrap();
        assert_ne!(sockets.metatraffic_port, taken.local_addr().unwrap().port());
        for address in ["10.0.0.1:1", "[fd00::1]:1"] {
            let address: SocketAddr = address.parse().unwrap();
            let of = sockets.of(address).unwrap();
            for (socket, port) in [
                (&of.user, sockets.user_port),
                (&of.metatraffic, sockets.metatraffic_port),
            ] {
                let local = socket.local_addr().unwrap();
                assert_eq!((local.is_ipv6(), local.port()), (address.is_ipv6(), port));
            }
        }
        assert_eq!(sockets.groups().len(), 3);
    }
}
