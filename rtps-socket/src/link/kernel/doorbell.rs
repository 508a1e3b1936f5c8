//! The app's own UDP socket: datagrams leave through it, and what arrives in it only wakes the app.

use std::net::UdpSocket;

use crate::sys::udp;

/// Wake-ups after which what has piled up is thrown away: few enough that the socket's receive buffer, without room
/// in which it would not wake anybody, cannot be full, and enough for the system call not to matter.
const RINGS_PER_CLEARING: u32 = 32;

/// See the module.
#[derive(Debug)]
pub(super) struct Doorbell {
    socket: UdpSocket,
    rings: u32,
}

impl Doorbell {
    pub(super) fn new(socket: UdpSocket) -> Self {
        Self { socket, rings: 0 }
    }

    /// The socket, to send from.
    pub(super) fn socket(&self) -> &UdpSocket {
        &self.socket
    }

    /// Something arrived: the message itself is in the ring.
    pub(super) fn rang(&mut self) {
        self.rings += 1;
        if self.rings == RINGS_PER_CLEARING {
            self.rings = 0;
            udp::discard_pending(&self.socket);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;
    use std::time::Duration;

    use super::*;
    use crate::sys::{Epoll, Interest};

    #[test]
    fn it_never_stops_ringing() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (epoll, address) = (Epoll::new().unwrap(), socket.local_addr().unwrap());
        epoll.add(socket.as_fd(), 5, Interest::Edge).unwrap();
        let mut doorbell = Doorbell::new(socket);
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        for round in 0..2000 {
            sender.send_to(&[0; 1400], address).unwrap();
            let wakeups = epoll.wait(Some(Duration::from_millis(500))).unwrap();
            assert!(wakeups.contains(5), "silent in round {round}");
            doorbell.rang();
        }
    }
}
