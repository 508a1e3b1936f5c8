//! The Unix socket between rtpsd and one app: one encoded value a packet, descriptors beside it, and never a wait.

use std::collections::VecDeque;
use std::io::IoSlice;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd, RawFd};

use nix::errno::Errno;
use nix::sys::socket::{ControlMessage, MsgFlags, recv, sendmsg};
use rtps_user::layer::protocol::{FromLayer, MAX_PROTOCOL_MESSAGE, ToLayer};
use tracing::warn;

/// What may wait for an app that does not read, in packets and in bytes.
const MAX_QUEUED_PACKETS: usize = 16 * 1024;
const MAX_QUEUED_BYTES: usize = 16 << 20;

/// What came from an app.
#[derive(Debug, PartialEq)]
pub(crate) enum Incoming {
    Message(ToLayer),
    /// Nothing that can be understood; a sentence for the app's author.
    Garbage(String),
    /// Nothing now.
    Nothing,
    /// The app is gone.
    Closed,
}

/// Why an app can no longer be told anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SendFailure {
    /// The app is gone.
    Closed,
    /// The app does not read.
    Stalled,
}

struct Packet {
    bytes: Vec<u8>,
    descriptors: Vec<OwnedFd>,
}

/// One end of a connection.
pub(crate) struct PacketSocket {
    socket: OwnedFd,
    queue: VecDeque<Packet>,
    queued_bytes: usize,
}

impl PacketSocket {
    /// Wraps a non-blocking `SOCK_SEQPACKET` socket.
    pub(crate) fn new(socket: OwnedFd) -> Self {
        Self {
            socket,
            queue: VecDeque::new(),
            queued_bytes: 0,
        }
    }

    /// The next packet.
    pub(crate) fn receive(&self, buffer: &mut [u8; MAX_PROTOCOL_MESSAGE]) -> Incoming {
        // MSG_TRUNC tells the real length; descriptors that an app might send are dropped by the kernel.
        let flags = MsgFlags::MSG_DONTWAIT | MsgFlags::MSG_TRUNC;
        let length = match recv(self.socket.as_raw_fd(), buffer, flags) {
            Ok(0) => return Incoming::Closed,
            Ok(length) => length,
            Err(Errno::EAGAIN | Errno::EINTR) => return Incoming::Nothing,
            Err(_) => return Incoming::Closed,
        };
        let Some(packet) = buffer.get(..length) else {
            return Incoming::Garbage(format!(
                "a message of {length} bytes is longer than the {MAX_PROTOCOL_MESSAGE} that the layer takes"
            ));
        };
        match postcard::take_from_bytes(packet) {
            Ok((message, [])) => Incoming::Message(message),
            Ok((_, rest)) => Incoming::Garbage(format!(
                "{} bytes follow the message; app and rtpsd were built from different versions",
                rest.len()
            )),
            Err(error) => Incoming::Garbage(format!(
                "a message of {length} bytes is not of the layer protocol ({error}); \
                 app and rtpsd were built from different versions"
            )),
        }
    }

    /// Sends a value, or queues it behind those that the app has not read yet. One that is larger than the app takes
    /// is dropped: what a remote participant announces must not part the app from the layer.
    pub(crate) fn send(
        &mut self,
        message: &FromLayer,
        descriptors: Vec<OwnedFd>,
    ) -> Result<(), SendFailure> {
        let bytes = postcard::to_stdvec(message).map_err(|_| SendFailure::Closed)?;
        if bytes.len() > MAX_PROTOCOL_MESSAGE {
            warn!(length = bytes.len(), "a message is too large for an app");
            return Ok(());
        }
        self.queued_bytes += bytes.len();
        self.queue.push_back(Packet { bytes, descriptors });
        self.flush()?;
        if self.queue.len() > MAX_QUEUED_PACKETS || self.queued_bytes > MAX_QUEUED_BYTES {
            return Err(SendFailure::Stalled);
        }
        Ok(())
    }

    /// Whether something waits until the app has read.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.queue.is_empty()
    }

    /// Sends what waits, as far as the socket takes it.
    pub(crate) fn flush(&mut self) -> Result<(), SendFailure> {
        while let Some(packet) = self.queue.front() {
            match send_packet(self.socket.as_fd(), packet) {
                Ok(()) => {
                    self.queued_bytes -= packet.bytes.len();
                    self.queue.pop_front();
                }
                // Larger than the socket's buffer, which the administrator has made small.
                Err(Errno::EMSGSIZE) => {
                    warn!(
                        length = packet.bytes.len(),
                        "a message is too large for a socket"
                    );
                    self.queued_bytes -= packet.bytes.len();
                    self.queue.pop_front();
                }
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN | Errno::ENOBUFS) => return Ok(()),
                Err(_) => return Err(SendFailure::Closed),
            }
        }
        Ok(())
    }
}

impl AsFd for PacketSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

fn send_packet(socket: BorrowedFd<'_>, packet: &Packet) -> Result<(), Errno> {
    let descriptors: Vec<RawFd> = packet.descriptors.iter().map(AsRawFd::as_raw_fd).collect();
    let control = [ControlMessage::ScmRights(&descriptors)];
    let control = if descriptors.is_empty() {
        &[][..]
    } else {
        &control[..]
    };
    let flags = MsgFlags::MSG_DONTWAIT | MsgFlags::MSG_NOSIGNAL;
    sendmsg::<()>(
        socket.as_raw_fd(),
        &[IoSlice::new(&packet.bytes)],
        control,
        flags,
        None,
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use nix::sys::socket::sockopt::SndBuf;
    use nix::sys::socket::{AddressFamily, SockFlag, SockType, send, setsockopt, socketpair};
    use rtps_user::wire::EntityId;

    use super::*;

    fn pair() -> (PacketSocket, OwnedFd) {
        let (ours, theirs) = socketpair(
            AddressFamily::Unix,
            SockType::SeqPacket,
            None,
            SockFlag::SOCK_NONBLOCK,
        )
        .unwrap();
        (PacketSocket::new(ours), theirs)
    }

    fn receive_after(bytes: &[u8]) -> Incoming {
        let (ours, theirs) = pair();
        send(theirs.as_raw_fd(), bytes, MsgFlags::empty()).unwrap();
        ours.receive(&mut [0; MAX_PROTOCOL_MESSAGE])
    }

    #[test]
    fn a_message_is_read() {
        let message = ToLayer::Withdraw(EntityId([1, 0, 1, 2]));
        let bytes = postcard::to_stdvec(&message).unwrap();
        assert_eq!(receive_after(&bytes), Incoming::Message(message));
    }

    #[test]
    fn garbage_is_told_from_messages() {
        let mut trailing = postcard::to_stdvec(&ToLayer::AssertLiveliness).unwrap();
        trailing.push(0);
        for bytes in [
            &[0xff; 40][..],
            &trailing,
            &[0; MAX_PROTOCOL_MESSAGE + 1],
            &[0],
        ] {
            assert!(matches!(receive_after(bytes), Incoming::Garbage(_)));
        }
    }

    #[test]
    fn the_end_is_noticed() {
        let (ours, theirs) = pair();
        let mut buffer = [0; MAX_PROTOCOL_MESSAGE];
        assert_eq!(ours.receive(&mut buffer), Incoming::Nothing);
        drop(theirs);
        assert_eq!(ours.receive(&mut buffer), Incoming::Closed);
    }

    #[test]
    fn messages_that_are_too_large_are_dropped_and_others_are_sent() {
        let (mut ours, theirs) = pair();
        let refused = |length| FromLayer::Refused {
            reason: "x".repeat(length),
        };
        setsockopt(&ours.socket, SndBuf, &(MAX_PROTOCOL_MESSAGE / 4)).unwrap();
        for length in [MAX_PROTOCOL_MESSAGE, MAX_PROTOCOL_MESSAGE - 100, 10] {
            assert_eq!(ours.send(&refused(length), vec![]), Ok(()));
        }
        assert!(!ours.is_waiting());
        let mut buffer = vec![0; 2 * MAX_PROTOCOL_MESSAGE];
        let length = recv(theirs.as_raw_fd(), &mut buffer, MsgFlags::empty()).unwrap();
        assert_eq!(postcard::from_bytes(&buffer[..length]), Ok(refused(10)));
    }

    #[test]
    fn an_app_that_does_not_read_is_found_stalled() {
        let (mut ours, _theirs) = pair();
        let message = FromLayer::Refused {
            reason: "x".repeat(1000),
        };
        let failure = (0..=MAX_QUEUED_PACKETS * 2).find_map(|_| ours.send(&message, vec![]).err());
        assert_eq!(failure, Some(SendFailure::Stalled));
        assert!(ours.is_waiting());
    }
}
