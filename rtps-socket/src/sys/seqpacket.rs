//! The Unix socket to rtpsd: one message a packet, descriptors beside it.

use std::io;
use std::mem;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use super::{check, check_len};

/// The most descriptors that come with one packet: those of a channel.
const MAX_FDS: usize = rtps_user::layer::protocol::CHANNEL_DESCRIPTORS;

/// A connected `SOCK_SEQPACKET` socket.
#[derive(Debug)]
pub(crate) struct SeqPacket(OwnedFd);

/// A packet; its bytes are in the buffer.
#[derive(Debug)]
pub(crate) struct Packet {
    /// How many bytes.
    pub(crate) len: usize,
    /// What was passed beside them.
    pub(crate) fds: Vec<OwnedFd>,
}

impl SeqPacket {
    /// Connects to the socket at `path`; never waits.
    pub(crate) fn connect(path: &Path) -> io::Result<Self> {
        let kind = libc::SOCK_SEQPACKET | libc::SOCK_CLOEXEC | libc::SOCK_NONBLOCK;
        // SAFETY: no preconditions.
        let fd = check(unsafe { libc::socket(libc::AF_UNIX, kind, 0) })?;
        // SAFETY: a new descriptor that nobody else owns.
        let socket = Self(unsafe { OwnedFd::from_raw_fd(fd) });
        let (address, len) = unix_address(path)?;
        // SAFETY: `len` bytes of the address are initialized.
        check(unsafe { libc::connect(fd, (&raw const address).cast(), len) })?;
        Ok(socket)
    }

    /// Sends one packet; an error of kind `WouldBlock` says that the other side does not read.
    pub(crate) fn send(&self, bytes: &[u8]) -> io::Result<()> {
        let flags = libc::MSG_NOSIGNAL | libc::MSG_DONTWAIT;
        // SAFETY: the buffer is readable for its length.
        check_len(unsafe {
            libc::send(
                self.0.as_raw_fd(),
                bytes.as_ptr().cast(),
                bytes.len(),
                flags,
            )
        })?;
        Ok(())
    }

    /// Takes one packet, without waiting. A length of 0 says that the other side is gone.
    pub(crate) fn receive(&self, buffer: &mut [u8]) -> io::Result<Packet> {
        // SAFETY: plain data; all zeros is a valid value.
        let mut message: libc::msghdr = unsafe { mem::zeroed() };
        let mut part = libc::iovec {
            iov_base: buffer.as_mut_ptr().cast(),
            iov_len: buffer.len(),
        };
        // Aligned for `cmsghdr`, and larger than CMSG_SPACE of so many descriptors.
        let mut control = [0u64; 8];
        message.msg_iov = &raw mut part;
        message.msg_iovlen = 1;
        message.msg_control = control.as_mut_ptr().cast();
        message.msg_controllen = size_of_val(&control);
        let flags = libc::MSG_DONTWAIT | libc::MSG_CMSG_CLOEXEC;
        // SAFETY: the message's parts are writable for their lengths and outlive the call.
        let len = check_len(unsafe { libc::recvmsg(self.0.as_raw_fd(), &raw mut message, flags) })?;
        let fds = take_fds(&message);
        if message.msg_flags & (libc::MSG_TRUNC | libc::MSG_CTRUNC) != 0 {
            let what = "a packet from the layer is longer than the layer protocol allows";
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        Ok(Packet { len, fds })
    }
}

impl AsFd for SeqPacket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

fn unix_address(path: &Path) -> io::Result<(libc::sockaddr_un, libc::socklen_t)> {
    let bytes = path.as_os_str().as_bytes();
    let mut address = libc::sockaddr_un {
        sun_family: libc::AF_UNIX as libc::sa_family_t,
        sun_path: [0; 108],
    };
    if bytes.len() >= address.sun_path.len() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("{} is too long for a Unix socket's path", path.display()),
        ));
    }
    for (to, from) in address.sun_path.iter_mut().zip(bytes) {
        *to = from.cast_signed();
    }
    let len = mem::offset_of!(libc::sockaddr_un, sun_path) + bytes.len() + 1;
    Ok((address, len as libc::socklen_t))
}

/// Owns the descriptors that came with a message, so that none leaks whatever the message says.
fn take_fds(message: &libc::msghdr) -> Vec<OwnedFd> {
    let mut fds = Vec::with_capacity(MAX_FDS);
    // SAFETY: `message` was filled by `recvmsg`, so the headers of its control data are well formed.
    unsafe {
        let mut header = libc::CMSG_FIRSTHDR(message);
        while let Some(control) = header.as_ref() {
            if control.cmsg_level == libc::SOL_SOCKET && control.cmsg_type == libc::SCM_RIGHTS {
                let len = control.cmsg_len - libc::CMSG_LEN(0) as usize;
                let data = libc::CMSG_DATA(control).cast::<libc::c_int>();
                for index in 0..len / size_of::<libc::c_int>() {
                    fds.push(OwnedFd::from_raw_fd(data.add(index).read_unaligned()));
                }
            }
            header = libc::CMSG_NXTHDR(message, control);
        }
    }
    fds
}

/// Takes a connection.
#[cfg(test)]
pub(crate) fn accept(listener: &OwnedFd) -> OwnedFd {
    let fd = nix::sys::socket::accept(listener.as_raw_fd()).expect("somebody connects");
    // SAFETY: a new descriptor that nobody else owns.
    unsafe { OwnedFd::from_raw_fd(fd) }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::{IoSlice, Read, Seek, Write};

    use nix::sys::socket::{
        AddressFamily, ControlMessage, MsgFlags, SockFlag, SockType, sendmsg, socketpair,
    };

    use super::*;
    use crate::sys::ring::tests::memory_file;

    fn pair() -> (SeqPacket, OwnedFd) {
        let flags = SockFlag::SOCK_CLOEXEC;
        let (a, b) = socketpair(AddressFamily::Unix, SockType::SeqPacket, None, flags).unwrap();
        (SeqPacket(a), b)
    }

    #[test]
    fn descriptors_arrive_beside_a_packet() {
        let (socket, other) = pair();
        let mut file = memory_file(0);
        file.write_all(b"shared").unwrap();
        let rights = [file.as_raw_fd(), file.as_raw_fd()];
        let control = [ControlMessage::ScmRights(&rights)];
        let parts = [IoSlice::new(b"hello")];
        sendmsg::<()>(other.as_raw_fd(), &parts, &control, MsgFlags::empty(), None).unwrap();
        let mut buffer = [0; 16];
        let packet = socket.receive(&mut buffer).unwrap();
        assert_eq!(&buffer[..packet.len], b"hello");
        let [first, _second] = <[OwnedFd; 2]>::try_from(packet.fds).unwrap();
        let (mut file, mut text) = (File::from(first), String::new());
        file.rewind().unwrap();
        file.read_to_string(&mut text).unwrap();
        assert_eq!(text, "shared");
    }

    #[test]
    fn odd_packets_are_errors_or_the_end() {
        let (socket, other) = pair();
        let other = SeqPacket(other);
        let mut buffer = [0; 4];
        let error = socket.receive(&mut buffer).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
        other.send(b"too long").unwrap();
        let error = socket.receive(&mut buffer).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        drop(other);
        assert_eq!(socket.receive(&mut buffer).unwrap().len, 0);
        let long = "x".repeat(200);
        assert!(SeqPacket::connect(Path::new(&long)).is_err());
    }
}
