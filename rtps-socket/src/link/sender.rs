//! Sending datagrams from a UDP socket: a burst in one system call, where the kernel can segment it.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use rtps_user::ipv6;

use super::Burst;
use crate::sys::udp;

/// What is known of one socket.
#[derive(Debug, Default)]
pub(crate) struct Sender {
    /// The kernel has refused to segment: it is old, or the path's MTU is smaller than a datagram.
    one_by_one: bool,
}

impl Sender {
    /// Sends the datagrams of a burst to one of its destinations.
    pub(crate) fn send(
        &mut self,
        socket: &UdpSocket,
        destination: SocketAddr,
        burst: &Burst<'_>,
    ) -> io::Result<()> {
        let destination = ipv6::to_socket(destination);
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
    use super::*;

    fn receive_all(sender: &mut Sender, any: &str) -> Option<Vec<Vec<u8>>> {
        let receiver = UdpSocket::bind(any).ok()?;
        let socket = UdpSocket::bind(any).unwrap();
        let destination = receiver.local_addr().unwrap();
        let bytes: Vec<u8> = (0..250).collect();
        let burst = Burst {
            destinations: &[destination],
            bytes: &bytes,
            segment: 100,
        };
        sender.send(&socket, destination, &burst).unwrap();
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
                match receive_all(&mut Sender { one_by_one }, any) {
                    Some(datagrams) => assert_eq!(datagrams, expected),
                    None => println!("skipped: {any} is no address here"),
                }
            }
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
        };
        let mut sender = Sender::default();
        sender.send(&socket, destination, &burst).unwrap();
        assert!(sender.one_by_one);
        for _ in 0..200 {
            let mut buffer = [0; 8];
            assert_eq!(receiver.recv(&mut buffer).unwrap(), 2);
        }
    }
}
