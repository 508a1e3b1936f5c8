//! Sending datagrams from a UDP socket: a burst in one system call, where the kernel can segment it.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::Instant;

use nix::sys::socket::{setsockopt, sockopt};
use rtps_user::ipv6;

use super::Burst;
use super::direct::Direct;
use crate::sys::udp;

/// What is known of one socket, or of one for each family.
#[derive(Debug, Default)]
pub(crate) struct Sender {
    /// The kernel has refused to segment: it is old, or the path's MTU is smaller than a datagram.
    one_by_one: bool,
    /// What the socket marks datagrams with, by IPv4 and IPv6.
    dscp: [u8; 2],
    /// For lone datagrams without a mark.
    direct: Direct,
}

impl Sender {
    /// Sends the datagrams of a burst to one of its destinations: from the socket, or from another where nobody cares
    /// and that is faster.
    pub(crate) fn send(
        &mut self,
        now: Instant,
        socket: &UdpSocket,
        destination: SocketAddr,
        burst: &Burst<'_>,
    ) -> io::Result<()> {
        let is_lone = burst.bytes.len() <= burst.segment && burst.dscp == 0;
        let to = ipv6::to_socket(destination);
        match is_lone && self.direct.send(now, to, burst.bytes) {
            true => Ok(()),
            false => self.send_from(socket, destination, burst),
        }
    }

    /// Sends the datagrams of a burst from the socket.
    pub(crate) fn send_from(
        &mut self,
        socket: &UdpSocket,
        destination: SocketAddr,
        burst: &Burst<'_>,
    ) -> io::Result<()> {
        let destination = ipv6::to_socket(destination);
        self.mark(socket, destination.is_ipv6(), burst.dscp);
        if burst.bytes.len() > burst.segment && !self.one_by_one {
            match udp::send_segmented(socket, destination, burst.bytes, burst.segment) {
                Err(error) if is_refusal(&error) => self.one_by_one = true,
                result => return result,
            }
        }
        for datagram in burst.datagrams() {
            socket.send_to(datagram, destination)?;
        }
        Ok(())
    }

    /// Has the socket mark what it sends from now on.
    fn mark(&mut self, socket: &UdpSocket, is_v6: bool, dscp: u8) {
        let marked = &mut self.dscp[usize::from(is_v6)];
        if std::mem::replace(marked, dscp) == dscp {
            return;
        }
        let class = i32::from(dscp) << 2;
        let result = match is_v6 {
            false => setsockopt(socket, sockopt::Ipv4Tos, &class),
            true => setsockopt(socket, sockopt::Ipv6TClass, &class),
        };
        if let Err(error) = result {
            tracing::debug!(dscp, %error, "datagrams are sent without their mark");
        }
    }
}

/// Whether it is segmentation that the kernel does not want, and not the datagrams.
fn is_refusal(error: &io::Error) -> bool {
    matches!(
        error.raw_os_error(),
        Some(libc::EINVAL | libc::EIO | libc::ENOPROTOOPT | libc::EOPNOTSUPP | libc::EMSGSIZE)
    )
}

#[cfg(test)]
mod tests {
    use nix::sys::socket::getsockopt;

    use super::*;

    fn segmenting(one_by_one: bool) -> Sender {
        Sender {
            one_by_one,
            ..Sender::default()
        }
    }

    fn receive_all(sender: &mut Sender, any: &str) -> Option<Vec<Vec<u8>>> {
        let receiver = UdpSocket::bind(any).ok()?;
        let socket = UdpSocket::bind(any).unwrap();
        let destination = receiver.local_addr().unwrap();
        let bytes: Vec<u8> = (0..250).collect();
        let burst = Burst {
            destinations: &[destination],
            bytes: &bytes,
            segment: 100,
            dscp: 0,
        };
        sender
            .send(Instant::now(), &socket, destination, &burst)
            .unwrap();
        let mut datagrams = Vec::new();
        for _ in 0..3 {
            let mut buffer = [0; 300];
            let len = receiver.recv(&mut buffer).unwrap();
            datagrams.push(buffer[..len].to_vec());
        }
        Some(datagrams)
    }

    #[test]
    fn a_burst_arrives_as_datagrams() {
        let expected: Vec<Vec<u8>> = vec![
            (0..100).collect(),
            (100..200).collect(),
            (200..250).collect(),
        ];
        for any in ["127.0.0.1:0", "[::1]:0"] {
            for one_by_one in [false, true] {
                match receive_all(&mut segmenting(one_by_one), any) {
                    Some(datagrams) => assert_eq!(datagrams, expected),
                    None => println!("skipped: {any} is no address here"),
                }
            }
        }
    }

    #[test]
    fn what_is_urgent_is_marked() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let destination = receiver.local_addr().unwrap();
        let mut sender = Sender::default();
        for dscp in [0, 46, 46, 0] {
            let burst = Burst {
                destinations: &[destination],
                bytes: b"datagram",
                segment: 8,
                dscp,
            };
            sender
                .send(Instant::now(), &socket, destination, &burst)
                .unwrap();
            let class = getsockopt(&socket, sockopt::Ipv4Tos).unwrap();
            assert_eq!(class, i32::from(dscp) << 2);
        }
    }

    #[test]
    fn what_the_kernel_cannot_segment_is_sent_one_by_one() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let destination = receiver.local_addr().unwrap();
        // More segments than any kernel takes.
        let bytes = [7; 400];
        let burst = Burst {
            destinations: &[destination],
            bytes: &bytes,
            segment: 2,
            dscp: 0,
        };
        let mut sender = Sender::default();
        sender
            .send(Instant::now(), &socket, destination, &burst)
            .unwrap();
        assert!(sender.one_by_one);
        for _ in 0..200 {
            let mut buffer = [0; 8];
            assert_eq!(receiver.recv(&mut buffer).unwrap(), 2);
        }
    }
}
