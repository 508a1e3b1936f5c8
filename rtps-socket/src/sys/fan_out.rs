//! The socket that sends to several destinations at once: what the kernel refuses there it says.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;

use nix::sys::socket::setsockopt;
use nix::sys::socket::sockopt::Ipv4RecvErr;

use super::check;

/// Opens it, and gives the cookie by which the kernel's programs know it.
pub(crate) fn open() -> io::Result<(UdpSocket, u64)> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    setsockopt(&socket, Ipv4RecvErr, &true)?;
    let cookie = cookie(&socket)?;
    Ok((socket, cookie))
}

fn cookie(socket: &UdpSocket) -> io::Result<u64> {
    let mut cookie = 0_u64;
    let mut len = size_of_val(&cookie) as libc::socklen_t;
    // SAFETY: `cookie` is writable for its size.
    check(unsafe {
        libc::getsockopt(
            socket.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_COOKIE,
            (&raw mut cookie).cast(),
            &raw mut len,
        )
    })?;
    Ok(cookie)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_socket_has_its_cookie() {
        let (first, cookie_of_first) = open().unwrap();
        let (_second, cookie_of_second) = open().unwrap();
        assert_ne!(cookie_of_first, cookie_of_second);
        assert_eq!(cookie(&first).unwrap(), cookie_of_first);
    }
}
