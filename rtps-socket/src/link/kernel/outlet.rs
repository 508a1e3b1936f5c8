//! The app's socket for IPv6 destinations: opened for the first of them, only ever sent from.

use std::io;
use std::net::{Ipv6Addr, SocketAddr, UdpSocket};
use std::time::Instant;

use crate::link::Burst;
use crate::link::sender::Sender;
use crate::sys::udp;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Outlet {
    socket: Option<UdpSocket>,
    sender: Sender,
}

impl Outlet {
    /// Sends datagrams; an error where the host has no IPv6.
    pub(super) fn send(
        &mut self,
        now: Instant,
        burst: &Burst<'_>,
        destination: SocketAddr,
    ) -> io::Result<()> {
        let socket = match &mut self.socket {
            Some(socket) => socket,
            none => none.insert(udp::bind((Ipv6Addr::UNSPECIFIED, 0).into())?),
        };
        self.sender.send(now, socket, destination, burst)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_opens_for_the_first_datagram() {
        let receiver = match UdpSocket::bind("[::1]:0") {
            Ok(receiver) => receiver,
            Err(error) => return println!("skipped: no IPv6 here, {error}"),
        };
        let address = receiver.local_addr().unwrap();
        let mut outlet = Outlet::default();
        for text in [b"one", b"two"] {
            let burst = Burst {
                destinations: &[address],
                bytes: text,
                segment: text.len(),
                dscp: 0,
            };
            outlet.send(Instant::now(), &burst, address).unwrap();
            let mut buffer = [0; 8];
            let (len, _) = receiver.recv_from(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], text);
        }
    }
}
