//! What UDP sockets can do beyond the standard library: shared ports, chosen interfaces, several datagrams at once.

use std::io::{self, IoSlice};
use std::mem;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};

use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrStorage, sendmsg};

use super::check;

/// A socket on a port of its own. One of IPv6 is for IPv6 only.
pub(crate) fn bind(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = open(address)?;
    bind_to(&socket, address)?;
    Ok(socket)
}

/// A socket on a port that other programs of this host may have open as well; each gets its own copy of what is
/// sent to a group.
pub(crate) fn bind_shared(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = open(address)?;
    set_option(&socket, libc::SOL_SOCKET, libc::SO_REUSEADDR, &1i32)?;
    set_option(&socket, libc::SOL_SOCKET, libc::SO_REUSEPORT, &1i32)?;
    bind_to(&socket, address)?;
    Ok(socket)
}

/// A socket of the address's family.
fn open(address: SocketAddr) -> io::Result<UdpSocket> {
    /// IPV6_PREFER_SRC_PUBLIC of `linux/in6.h`: temporary addresses are not announced.
    const PREFER_PUBLIC: i32 = 2;
    let kind = libc::SOCK_DGRAM | libc::SOCK_CLOEXEC;
    let family = match address {
        SocketAddr::V4(_) => libc::AF_INET,
        SocketAddr::V6(_) => libc::AF_INET6,
    };
    // SAFETY: no preconditions.
    let fd = check(unsafe { libc::socket(family, kind, 0) })?;
    // SAFETY: a new descriptor that nobody else owns.
    let socket = UdpSocket::from(unsafe { OwnedFd::from_raw_fd(fd) });
    if address.is_ipv6() {
        set_option(&socket, libc::IPPROTO_IPV6, libc::IPV6_V6ONLY, &1i32)?;
        let preferences = libc::IPV6_ADDR_PREFERENCES;
        set_option(&socket, libc::IPPROTO_IPV6, preferences, &PREFER_PUBLIC)?;
    }
    Ok(socket)
}

fn bind_to(socket: &UdpSocket, address: SocketAddr) -> io::Result<()> {
    use nix::sys::socket::bind;
    Ok(bind(socket.as_raw_fd(), &SockaddrStorage::from(address))?)
}

/// Joins a group on one interface. To be in it already is no error.
pub(crate) fn join_group(socket: &UdpSocket, group: IpAddr, interface: u32) -> io::Result<()> {
    let joined = match group {
        IpAddr::V4(group) => {
            let request = libc::ip_mreqn {
                imr_multiaddr: in_addr(group),
                imr_address: in_addr(Ipv4Addr::UNSPECIFIED),
                imr_ifindex: interface.cast_signed(),
            };
            set_option(socket, libc::IPPROTO_IP, libc::IP_ADD_MEMBERSHIP, &request)
        }
        IpAddr::V6(group) => socket.join_multicast_v6(&group, interface),
    };
    match joined {
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Ok(()),
        result => result,
    }
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

/// Sends `bytes` as datagrams of `segment` bytes each, the last may be shorter, in one system call (UDP_SEGMENT, udp(7)).
/// An error says that none was sent.
pub(crate) fn send_segmented(
    socket: &UdpSocket,
    destination: SocketAddr,
    bytes: &[u8],
    segment: usize,
) -> io::Result<()> {
    let segment = u16::try_from(segment).map_err(io::Error::other)?;
    sendmsg(
        socket.as_raw_fd(),
        &[IoSlice::new(bytes)],
        &[ControlMessage::UdpGsoSegments(&segment)],
        MsgFlags::empty(),
        Some(&SockaddrStorage::from(destination)),
    )?;
    Ok(())
}

/// Sends to a group out of one interface, from that interface's address `source`, which is of the group's family.
pub(crate) fn send_multicast(
    socket: &UdpSocket,
    (interface, source): (u32, IpAddr),
    group: SocketAddr,
    datagram: &[u8],
) -> io::Result<()> {
    let (to, v4, v6);
    let control = match (group, source) {
        (SocketAddr::V4(_), IpAddr::V4(source)) => {
            to = group;
            v4 = libc::in_pktinfo {
                ipi_ifindex: interface.cast_signed(),
                ipi_spec_dst: in_addr(source),
                ipi_addr: in_addr(Ipv4Addr::UNSPECIFIED),
            };
            ControlMessage::Ipv4PacketInfo(&v4)
        }
        (SocketAddr::V6(mut group), IpAddr::V6(source)) => {
            group.set_scope_id(interface);
            to = group.into();
            v6 = libc::in6_pktinfo {
                ipi6_addr: libc::in6_addr {
                    s6_addr: source.octets(),
                },
                ipi6_ifindex: interface,
            };
            ControlMessage::Ipv6PacketInfo(&v6)
        }
        _ => return Err(io::ErrorKind::InvalidInput.into()),
    };
    sendmsg(
        socket.as_raw_fd(),
        &[IoSlice::new(datagram)],
        &[control],
        MsgFlags::empty(),
        Some(&SockaddrStorage::from(to)),
    )?;
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_reaches_every_socket_on_a_shared_port() {
        const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 77);
        let mut any = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
        let first = bind_shared(any).unwrap();
        let port = first.local_addr().unwrap().port();
        any.set_port(port);
        let second = bind_shared(any).unwrap();
        let loopback = 1;
        for socket in [&first, &second] {
            join_group(socket, GROUP.into(), loopback).unwrap();
            join_group(socket, GROUP.into(), loopback).unwrap();
            socket
                .set_read_timeout(Some(std::time::Duration::from_secs(2)))
                .unwrap();
        }
        let sender = UdpSocket::bind("0.0.0.0:0").unwrap();
        let from = (loopback, Ipv4Addr::LOCALHOST.into());
        send_multicast(&sender, from, (GROUP, port).into(), b"all").unwrap();
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
        socket.set_nonblocking(true).unwrap();
        let mut buffer = [9; 8];
        assert_eq!(socket.recv(&mut buffer).unwrap(), 1);
        assert_eq!(buffer[0], 0);
        discard_pending(&socket);
        let error = socket.recv(&mut buffer).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
    }
}
