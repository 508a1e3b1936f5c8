//! A connected socket for the destination that most datagrams go to.
//!
//! The kernel looks for the way of each datagram that names its destination, and remembers that of a connected socket: a
//! tenth of what it costs to send one. But a connected socket also keeps the source address that it had at first, so it
//! is used for a second at most, in case the host's addresses change.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use crate::sys::udp;

/// Datagrams to a destination, beyond those to others, for which it is worth to open a socket.
const FAVOUR: u8 = 64;
/// For how long it is used.
const LIFE: Duration = Duration::from_secs(1);

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Direct {
    /// Who has had the majority of late, and by how many.
    favourite: Option<SocketAddr>,
    lead: u8,
    open: Option<Open>,
}

#[derive(Debug)]
struct Open {
    socket: UdpSocket,
    until: Instant,
}

impl Direct {
    /// Sends a datagram to a destination, if it is the one; whether the datagram has left.
    pub(super) fn send(&mut self, now: Instant, destination: SocketAddr, datagram: &[u8]) -> bool {
        if !self.favours(now, destination) {
            return false;
        }
        let open = match &mut self.open {
            Some(open) => open,
            none => match Open::to(now, destination) {
                Some(open) => none.insert(open),
                None => return self.give_up(),
            },
        };
        // An error may be about an earlier datagram, which met a closed port.
        open.socket.send(datagram).is_ok() || self.give_up()
    }

    /// Notes one more datagram; whether its destination is worth a socket.
    fn favours(&mut self, now: Instant, destination: SocketAddr) -> bool {
        if self.favourite != Some(destination) {
            self.lead = self.lead.saturating_sub(1);
            if self.lead == 0 {
                *self = Self::default();
                self.favourite = Some(destination);
            }
            return false;
        }
        self.lead = self.lead.saturating_add(1);
        if self.open.as_ref().is_some_and(|open| open.until <= now) {
            return self.give_up();
        }
        self.lead >= FAVOUR
    }

    fn give_up(&mut self) -> bool {
        self.lead = 0;
        self.open = None;
        false
    }
}

impl Open {
    fn to(now: Instant, destination: SocketAddr) -> Option<Self> {
        let any: IpAddr = match destination {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let socket = udp::bind((any, 0).into()).ok()?;
        socket.connect(destination).ok()?;
        let until = now + LIFE;
        Some(Self { socket, until })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn receiver() -> (UdpSocket, SocketAddr) {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = receiver.local_addr().unwrap();
        (receiver, address)
    }

    /// How many of `count` datagrams left.
    fn sent(direct: &mut Direct, now: Instant, to: SocketAddr, count: usize) -> usize {
        let left = (0..count).filter(|_| direct.send(now, to, b"datagram"));
        left.count()
    }

    #[test]
    fn the_favourite_gets_a_socket_for_a_while() {
        let (receiver, to) = receiver();
        let (mut direct, now) = (Direct::default(), Instant::now());
        let first = usize::from(FAVOUR);
        assert_eq!(sent(&mut direct, now, to, first), 0);
        assert_eq!(sent(&mut direct, now, to, 100), 100);
        let mut buffer = [0; 16];
        for _ in 0..100 {
            assert_eq!(receiver.recv(&mut buffer).unwrap(), 8);
        }
        assert_eq!(sent(&mut direct, now + LIFE, to, first), 0);
        assert_eq!(sent(&mut direct, now + LIFE, to, 2), 2);
    }

    #[test]
    fn others_in_between_do_not_matter_and_a_new_favourite_does() {
        let ((_one, to_one), (_two, to_two)) = (receiver(), receiver());
        let (mut direct, now) = (Direct::default(), Instant::now());
        sent(&mut direct, now, to_one, 80);
        assert_eq!(sent(&mut direct, now, to_two, 10), 0);
        assert_eq!(sent(&mut direct, now, to_one, 10), 10);
        assert_eq!(sent(&mut direct, now, to_two, 200), 200 - 79 - 63);
        assert_eq!(sent(&mut direct, now, to_one, 1), 0);
    }

    #[test]
    fn a_closed_port_costs_no_datagram() {
        let (receiver, to) = receiver();
        let (mut direct, now) = (Direct::default(), Instant::now());
        sent(&mut direct, now, to, 64);
        drop(receiver);
        // The port's unreachability is known when the next one is sent, which the caller then sends by itself.
        let left: Vec<_> = (0..3).map(|_| direct.send(now, to, b"datagram")).collect();
        assert_eq!(left, [true, false, false]);
    }
}
