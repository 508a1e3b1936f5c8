//! The three sockets of a participant and the ports that RTPS 2.5 section 9.6.2.3 gives them.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsFd;

use super::interfaces::Interface;
use super::{GROUP, InProcessError};
use crate::sys::{Epoll, Interest, udp};

/// PB, DG, PG, d0, d1 and d3.
const PORT_BASE: u32 = 7400;
const DOMAIN_GAIN: u32 = 250;
const PARTICIPANT_GAIN: u32 = 2;
const METATRAFFIC_OFFSET: u32 = 10;
const USER_OFFSET: u32 = 11;
/// Participant ids whose ports are below those of the next domain.
const PARTICIPANTS: u32 = 120;

/// Room for bursts while the app does other things; the kernel caps it.
const RECEIVE_BUFFER: i32 = 4 << 20;

/// See the module.
#[derive(Debug)]
pub(super) struct Sockets {
    /// What concerns this participant's discovery alone; sends discovery traffic, too.
    pub(super) metatraffic: UdpSocket,
    pub(super) metatraffic_port: u16,
    /// Samples, both ways.
    pub(super) user: UdpSocket,
    pub(super) user_port: u16,
    /// Announcements to the group, shared with every other participant of this host.
    pub(super) multicast: UdpSocket,
}

/// The port of the SPDP group; the domain is at most 232.
pub(super) fn multicast_port(domain: u32) -> u16 {
    (PORT_BASE + DOMAIN_GAIN * domain) as u16
}

/// The metatraffic and user ports of a participant, where there are such.
fn unicast_ports(domain: u32, participant: u32) -> Option<(u16, u16)> {
    let first = u32::from(multicast_port(domain)) + PARTICIPANT_GAIN * participant;
    let metatraffic = u16::try_from(first + METATRAFFIC_OFFSET).ok()?;
    let user = u16::try_from(first + USER_OFFSET).ok()?;
    Some((metatraffic, user))
}

impl Sockets {
    pub(super) fn open(domain: u32, interfaces: &[Interface]) -> Result<Self, InProcessError> {
        let multicast = udp::bind_shared(multicast_port(domain))?;
        for interface in interfaces {
            if let Err(error) = udp::join_group(&multicast, GROUP, interface.index) {
                tracing::debug!(index = interface.index, %error, "no multicast on an interface");
            }
        }
        let ports = (0..PARTICIPANTS).map_while(|participant| unicast_ports(domain, participant));
        for (metatraffic_port, user_port) in ports {
            let Some(metatraffic) = bind_own(metatraffic_port)? else {
                continue;
            };
            let Some(user) = bind_own(user_port)? else {
                continue;
            };
            return Ok(Self {
                metatraffic,
                metatraffic_port,
                user,
                user_port,
                multicast,
            });
        }
        Err(InProcessError::NoFreePorts(domain))
    }

    /// Watches user, metatraffic and multicast socket under these numbers.
    pub(super) fn register(&self, epoll: &Epoll, numbers: [u8; 3]) -> io::Result<()> {
        let sockets = [&self.user, &self.metatraffic, &self.multicast];
        for (socket, number) in sockets.into_iter().zip(numbers) {
            epoll.add(socket.as_fd(), number, Interest::Level)?;
        }
        Ok(())
    }
}

/// A port of the participant's own; `None` when somebody has it.
fn bind_own(port: u16) -> io::Result<Option<UdpSocket>> {
    match UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port)) {
        Ok(socket) => {
            udp::set_receive_buffer(&socket, RECEIVE_BUFFER)?;
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
}
