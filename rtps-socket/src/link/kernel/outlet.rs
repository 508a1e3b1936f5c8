//! The app's socket for IPv6 destinations: opened for the first of them, only ever sent from.

use std::io;
use std::net::{Ipv6Addr, SocketAddr, UdpSocket};

use rtps_user::ipv6;

use crate::sys::udp;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Outlet {
    socket: Option<UdpSocket>,
}

impl Outlet {
    /// Sends a datagram; an error where the host has no IPv6.
    pub(super) fn send_to(
        &mut self,
        datagram: &[u8],
        destination: SocketAddr,
    ) -> io::Result<usize> {
        let socket = match &mut self.socket {
            Some(socket) => socket,
            none => none.insert(udp::bind((Ipv6Addr::UNSPECIFIED, 0).into())?),
        };
        socket.send_to(datagram, ipv6::to_socket(destination))
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
            assert_eq!(outlet.send_to(text, address).unwrap(), text.len());
            let mut buffer = [0; 8];
            let (len, _) = receiver.recv_from(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], text);
        }
    }
}
