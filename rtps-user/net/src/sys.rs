//! The only unsafe room: system calls for which nix has no safe function.
#![expect(
    unsafe_code,
    reason = "system calls that no dependency wraps; each block states why it is sound"
)]

use std::io;
use std::mem;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;

/// SIOCETHTOOL (linux/sockios.h).
const ETHTOOL: libc::Ioctl = 0x8946;
/// ETHTOOL_GDRVINFO (linux/ethtool.h).
const GET_DRIVER_INFO: u32 = 3;

/// The largest IP packet that an interface sends in one piece, in bytes.
pub(crate) fn interface_mtu(name: &str) -> io::Result<u32> {
    let mut request = request(name)?;
    // SAFETY: SIOCGIFMTU reads the name and writes the union of `request`.
    unsafe { call(libc::SIOCGIFMTU, &mut request)? };
    // SAFETY: the call succeeded, so the union holds the MTU.
    let mtu = unsafe { request.ifr_ifru.ifru_mtu };
    u32::try_from(mtu).map_err(io::Error::other)
}

/// `struct ethtool_drvinfo`.
#[repr(C)]
struct DriverInfo {
    command: u32,
    driver: [u8; 32],
    rest: [u8; 160],
}

/// The name of the driver of an interface.
pub(crate) fn interface_driver(name: &str) -> io::Result<String> {
    let mut info = DriverInfo {
        command: GET_DRIVER_INFO,
        driver: [0; 32],
        rest: [0; 160],
    };
    let mut request = request(name)?;
    request.ifr_ifru.ifru_data = (&raw mut info).cast();
    // SAFETY: the call writes a `struct ethtool_drvinfo`, which `info` is as large as.
    unsafe { call(ETHTOOL, &mut request)? };
    let name = info.driver.split(|byte| *byte == 0).next();
    Ok(String::from_utf8_lossy(name.unwrap_or_default()).into_owned())
}

/// A request about an interface.
fn request(name: &str) -> io::Result<libc::ifreq> {
    // SAFETY: plain data; all zeros is a valid value.
    let mut request: libc::ifreq = unsafe { mem::zeroed() };
    if name.len() >= request.ifr_name.len() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    for (to, from) in request.ifr_name.iter_mut().zip(name.as_bytes()) {
        *to = from.cast_signed();
    }
    Ok(request)
}

/// # Safety
/// What the call reads and writes through the union of `request` must be there. (Its name ends with a NUL.)
unsafe fn call(number: libc::Ioctl, request: &mut libc::ifreq) -> io::Result<()> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    // SAFETY: the caller vouches for it.
    match unsafe { libc::ioctl(socket.as_raw_fd(), number, &raw mut *request) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loopback_interface_takes_large_packets() {
        assert!(interface_mtu("lo").unwrap() > 1500);
        assert!(interface_mtu("nosuchif0").is_err());
        assert!(interface_mtu("a name that is longer than any").is_err());
    }

    #[test]
    fn what_is_no_interface_has_no_driver() {
        assert!(interface_driver("nosuchif0").is_err());
        assert!(interface_driver("a name that is longer than any").is_err());
    }
}
