//! What UDP sockets can do beyond the standard library: shared ports, chosen interfaces, reads that never wait.

use std::io;
use std::mem;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};

use super::{check, check_len};

/// A socket on a port that other programs of this host may have open as well; each gets its own copy of what is
/// sent to a group.
pub(crate) fn bind_shared(port: u16) -> io::Result<UdpSocket> {
    let kind = libc::SOCK_DGRAM | libc::SOCK_CLOEXEC;
    // SAFETY: no preconditions.
    let fd = check(unsafe { libc::socket(libc::AF_INET, kind, 0) })?;
    // SAFETY: a new descriptor that nobody else owns.
    let socket = UdpSocket::from(unsafe { OwnedFd::from_raw_fd(fd) });
    set_option(&socket, libc::SOL_SOCKET, libc::SO_REUSEADDR, &1i32)?;
    set_option(&socket, libc::SOL_SOCKET, libc::SO_REUSEPORT, &1i32)?;
    let (address, len) = ipv4_address(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port));
    // SAFETY: the address is initialized and `len` bytes long.
    check(unsafe { libc::bind(fd, (&raw const address).cast(), len) })?;
    Ok(socket)
}

/// Asks for room for `bytes` of datagrams not yet read; the kernel gives what `net.core.rmem_max` allows.
pub(crate) fn set_receive_buffer(socket: &UdpSocket, bytes: i32) -> io::Result<()> {
    set_option(socket, libc::SOL_SOCKET, libc::SO_RCVBUF, &bytes)
}

/// Joins a group on one interface. To be in it already is no error.
pub(crate) fn join_group(socket: &UdpSocket, group: Ipv4Addr, interface: u32) -> io::Result<()> {
    let request = libc::ip_mreqn {
        imr_multiaddr: in_addr(group),
        imr_address: in_addr(Ipv4Addr::UNSPECIFIED),
        imr_ifindex: interface.cast_signed(),
    };
    match set_option(socket, libc::IPPROTO_IP, libc::IP_ADD_MEMBERSHIP, &request) {
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Ok(()),
        result => result,
    }
}

/// Takes a datagram that is there; an error of kind `WouldBlock` says that there is none.
pub(crate) fn receive_now(
    socket: &UdpSocket,
    buffer: &mut [u8],
) -> io::Result<(usize, SocketAddr)> {
    // SAFETY: plain data; all zeros is a valid value.
    let mut source: libc::sockaddr_in = unsafe { mem::zeroed() };
    let mut source_len = size_of::<libc::sockaddr_in>() as libc::socklen_t;
    // SAFETY: buffer and address are writable for their lengths.
    let len = check_len(unsafe {
        libc::recvfrom(
            socket.as_raw_fd(),
            buffer.as_mut_ptr().cast(),
            buffer.len(),
            libc::MSG_DONTWAIT,
            (&raw mut source).cast(),
            &raw mut source_len,
        )
    })?;
    let ip = Ipv4Addr::from(u32::from_be(source.sin_addr.s_addr));
    Ok((len, (ip, u16::from_be(source.sin_port)).into()))
}

/// Throws away the datagrams that are there, without copying any. One system call does it for a few; a sender that
/// never stops cannot keep the caller for ever.
pub(crate) fn discard_pending(socket: &UdpSocket) {
    const ROUNDS: usize = 64;
    for _ in 0..ROUNDS {
        if discard_some(socket) < DISCARDED_AT_ONCE {
            return;
        }
    }
}

/// Datagrams thrown away by one system call.
const DISCARDED_AT_ONCE: usize = 64;

/// Throws away up to [`DISCARDED_AT_ONCE`] datagrams; fewer mean that there are no more.
fn discard_some(socket: &UdpSocket) -> usize {
    // SAFETY: plain data; all zeros is a valid value: no buffer, no address.
    let mut messages: [libc::mmsghdr; DISCARDED_AT_ONCE] = unsafe { mem::zeroed() };
    let flags = libc::MSG_DONTWAIT | libc::MSG_TRUNC;
    // SAFETY: as many messages as said, without a buffer; no timeout.
    let count = unsafe {
        libc::recvmmsg(
            socket.as_raw_fd(),
            messages.as_mut_ptr(),
            DISCARDED_AT_ONCE as libc::c_uint,
            flags,
            std::ptr::null_mut(),
        )
    };
    // There being none is no error here.
    usize::try_from(count).unwrap_or_default()
}

/// Sends to a group out of one interface, from that interface's address `source`.
pub(crate) fn send_multicast(
    socket: &UdpSocket,
    (interface, source): (u32, Ipv4Addr),
    group: SocketAddrV4,
    datagram: &[u8],
) -> io::Result<()> {
    /// The control data: one header and what it announces, as `CMSG_SPACE` would lay it out.
    #[repr(C)]
    struct Control {
        header: libc::cmsghdr,
        info: libc::in_pktinfo,
    }
    // SAFETY: plain data; all zeros is a valid value.
    let mut control: Control = unsafe { mem::zeroed() };
    control.header.cmsg_len = (mem::offset_of!(Control, info) + size_of::<libc::in_pktinfo>()) as _;
    control.header.cmsg_level = libc::IPPROTO_IP;
    control.header.cmsg_type = libc::IP_PKTINFO;
    control.info.ipi_ifindex = interface.cast_signed();
    control.info.ipi_spec_dst = in_addr(source);
    let (mut address, address_len) = ipv4_address(group);
    let mut part = libc::iovec {
        iov_base: datagram.as_ptr().cast_mut().cast(),
        iov_len: datagram.len(),
    };
    // SAFETY: plain data; all zeros is a valid value.
    let mut message: libc::msghdr = unsafe { mem::zeroed() };
    message.msg_name = (&raw mut address).cast();
    message.msg_namelen = address_len;
    message.msg_iov = &raw mut part;
    message.msg_iovlen = 1;
    message.msg_control = (&raw mut control).cast();
    message.msg_controllen = size_of::<Control>() as _;
    // SAFETY: all parts of the message outlive the call and are only read.
    check_len(unsafe { libc::sendmsg(socket.as_raw_fd(), &raw const message, 0) })?;
    Ok(())
}

/// The largest IP packet that an interface of this network namespace takes.
pub(crate) fn interface_mtu(name: &str) -> io::Result<u32> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    // SAFETY: plain data; all zeros is a valid value.
    let mut request: libc::ifreq = unsafe { mem::zeroed() };
    if name.len() >= request.ifr_name.len() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    for (to, from) in request.ifr_name.iter_mut().zip(name.as_bytes()) {
        *to = from.cast_signed();
    }
    // SAFETY: the name is NUL-terminated; the kernel fills the MTU in.
    check(unsafe { libc::ioctl(socket.as_raw_fd(), libc::SIOCGIFMTU, &raw mut request) })?;
    // SAFETY: the call filled this member.
    let mtu = unsafe { request.ifr_ifru.ifru_mtu };
    u32::try_from(mtu).map_err(io::Error::other)
}

fn set_option<T>(socket: &UdpSocket, level: i32, option: i32, value: &T) -> io::Result<()> {
    let len = size_of::<T>() as libc::socklen_t;
    // SAFETY: `value` is readable for its size; the kernel checks that the size fits the option.
    check(unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            level,
            option,
            std::ptr::from_ref(value).cast(),
            len,
        )
    })?;
    Ok(())
}

fn in_addr(ip: Ipv4Addr) -> libc::in_addr {
    libc::in_addr {
        s_addr: u32::from(ip).to_be(),
    }
}

fn ipv4_address(address: SocketAddrV4) -> (libc::sockaddr_in, libc::socklen_t) {
    let raw = libc::sockaddr_in {
        sin_family: libc::AF_INET as libc::sa_family_t,
        sin_port: address.port().to_be(),
        sin_addr: in_addr(*address.ip()),
        sin_zero: [0; 8],
    };
    (raw, size_of::<libc::sockaddr_in>() as libc::socklen_t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_reaches_every_socket_on_a_shared_port() {
        const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 77);
        let first = bind_shared(0).unwrap();
        let port = first.local_addr().unwrap().port();
        let second = bind_shared(port).unwrap();
        let loopback = 1;
        for socket in [&first, &second] {
            join_group(socket, GROUP, loopback).unwrap();
            join_group(socket, GROUP, loopback).unwrap();
            socket
                .set_read_timeout(Some(std::time::Duration::from_secs(2)))
                .unwrap();
        }
        let sender = UdpSocket::bind("0.0.0.0:0").unwrap();
        let from = (loopback, Ipv4Addr::LOCALHOST);
        send_multicast(&sender, from, SocketAddrV4::new(GROUP, port), b"all").unwrap();
        for socket in [&first, &second] {
            let mut buffer = [0; 8];
            let (len, source) = socket.recv_from(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], b"all");
            let port = sender.local_addr().unwrap().port();
            assert_eq!(source, (Ipv4Addr::LOCALHOST, port).into());
        }
    }

    #[test]
    fn pending_datagrams_are_discarded() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = socket.local_addr().unwrap();
        for n in 0..150 {
            socket.send_to(&[n], address).unwrap();
        }
        let mut buffer = [9; 8];
        assert_eq!(receive_now(&socket, &mut buffer).unwrap(), (1, address));
        assert_eq!(buffer[0], 0);
        discard_pending(&socket);
        let error = receive_now(&socket, &mut buffer).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
    }
}
