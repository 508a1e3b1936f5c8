//! Taking datagrams out of UDP sockets without waiting: as many with one system call as the kernel keeps together.
//!
//! A socket with UDP_GRO (udp(7)) gets what was sent with UDP_SEGMENT, or what the network card put together, in one
//! piece, with the length of its datagrams beside it. `recvmmsg` would save nothing: what a datagram costs is not the
//! system call, but the way through the kernel that each would take by itself.

use std::io::{self, IoSliceMut};
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsRawFd;

use nix::cmsg_space;
use nix::sys::socket::sockopt::{RcvBuf, RcvBufForce, UdpGroSegment};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt};

/// No packet is larger.
const PACKET_MAX: usize = 65_536;

/// Has datagrams of one sender that came together kept together; every kernel since Linux 5.0 can.
pub(crate) fn keep_together(socket: &UdpSocket) -> io::Result<()> {
    Ok(setsockopt(socket, UdpGroSegment, &true)?)
}

/// Asks for room for `bytes` of datagrams not yet read. Without privileges, the kernel gives what `net.core.rmem_max`
/// allows.
pub(crate) fn set_receive_buffer(socket: &UdpSocket, bytes: usize) -> io::Result<()> {
    if setsockopt(socket, RcvBufForce, &bytes).is_err() {
        setsockopt(socket, RcvBuf, &bytes)?;
    }
    Ok(())
}

/// Room for what one system call takes; memory that no datagram has needed is never touched.
#[derive(Debug)]
pub(crate) struct ReceiveBuffer {
    bytes: Vec<u8>,
    control: Vec<u8>,
}

/// What one system call took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Received<'a> {
    /// Who sent it.
    pub(crate) source: SocketAddr,
    bytes: &'a [u8],
    segment: usize,
}

impl<'a> Received<'a> {
    /// Each datagram; one without content is none.
    pub(crate) fn datagrams(&self) -> impl ExactSizeIterator<Item = &'a [u8]> + use<'a> {
        self.bytes.chunks(self.segment)
    }
}

impl ReceiveBuffer {
    /// For datagrams of any size.
    pub(crate) fn new() -> Self {
        Self {
            bytes: vec![0; PACKET_MAX],
            control: cmsg_space!(i32),
        }
    }

    /// Takes what is there, without waiting; an error of kind `WouldBlock` says that there is nothing.
    pub(crate) fn receive(&mut self, socket: &UdpSocket) -> io::Result<Received<'_>> {
        let (len, source, segment) = self.take(socket)?;
        let bytes = self.bytes.get(..len).unwrap_or_default();
        let segment = segment.unwrap_or(len).max(1);
        Ok(Received {
            source,
            bytes,
            segment,
        })
    }

    /// Length, sender, and length of a datagram where there are several.
    fn take(&mut self, socket: &UdpSocket) -> io::Result<(usize, SocketAddr, Option<usize>)> {
        let mut parts = [IoSliceMut::new(&mut self.bytes)];
        let message = recvmsg::<SockaddrStorage>(
            socket.as_raw_fd(),
            &mut parts,
            Some(&mut self.control),
            MsgFlags::MSG_DONTWAIT,
        )?;
        let source = message.address.as_ref().and_then(socket_address);
        let source = source.ok_or(io::ErrorKind::InvalidData)?;
        let segment = message.cmsgs()?.find_map(|part| match part {
            ControlMessageOwned::UdpGroSegments(segment) => usize::try_from(segment).ok(),
            _ => None,
        });
        Ok((message.bytes, source, segment))
    }
}

fn socket_address(address: &SockaddrStorage) -> Option<SocketAddr> {
    let v4 = address
        .as_sockaddr_in()
        .map(|v4| SocketAddr::V4((*v4).into()));
    v4.or_else(|| {
        address
            .as_sockaddr_in6()
            .map(|v6| SocketAddr::V6((*v6).into()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sys::udp;

    /// A socket that keeps datagrams together, and one to send to it; `None` where there is no such address.
    fn pair(any: &str) -> Option<(UdpSocket, UdpSocket)> {
        let Ok(socket) = udp::bind(any.parse().unwrap()) else {
            println!("skipped: {any} is no address here");
            return None;
        };
        keep_together(&socket).unwrap();
        Some((socket, udp::bind(any.parse().unwrap()).unwrap()))
    }

    #[test]
    fn datagrams_tell_where_they_come_from() {
        for (socket, sender) in ["127.0.0.1:0", "[::1]:0"].into_iter().filter_map(pair) {
            sender
                .send_to(b"text", socket.local_addr().unwrap())
                .unwrap();
            let mut buffer = ReceiveBuffer::new();
            let received = buffer.receive(&socket).unwrap();
            assert_eq!(received.source, sender.local_addr().unwrap());
            assert_eq!(received.datagrams().collect::<Vec<_>>(), [b"text"]);
            let error = buffer.receive(&socket).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
        }
    }

    #[test]
    fn what_left_together_is_taken_together() {
        for (socket, sender) in ["127.0.0.1:0", "[::1]:0"].into_iter().filter_map(pair) {
            let to = socket.local_addr().unwrap();
            let bytes: Vec<u8> = (0..250).collect();
            udp::send_segmented(&sender, to, &bytes, 100).unwrap();
            sender.send_to(b"text", to).unwrap();
            let mut buffer = ReceiveBuffer::new();
            let received = buffer.receive(&socket).unwrap();
            assert_eq!(received.datagrams().len(), 3);
            let expected = [&bytes[..100], &bytes[100..200], &bytes[200..]];
            assert_eq!(received.datagrams().collect::<Vec<_>>(), expected);
            let received = buffer.receive(&socket).unwrap();
            assert_eq!(received.datagrams().collect::<Vec<_>>(), [b"text"]);
        }
    }

    #[test]
    fn nothing_and_the_largest_can_be_taken() {
        let (socket, sender) = pair("127.0.0.1:0").unwrap();
        let to = socket.local_addr().unwrap();
        let largest = vec![7; 65_507];
        sender.send_to(&[], to).unwrap();
        sender.send_to(&largest, to).unwrap();
        let mut buffer = ReceiveBuffer::new();
        assert_eq!(buffer.receive(&socket).unwrap().datagrams().len(), 0);
        let received = buffer.receive(&socket).unwrap();
        assert_eq!(received.datagrams().collect::<Vec<_>>(), [largest]);
    }
}
