//! The only unsafe room of rtpsd: system calls for which neither nix nor aya has a safe function.
#![expect(
    unsafe_code,
    reason = "system calls that no dependency wraps; each block states why it is sound"
)]

use std::ffi::CString;
use std::io;
use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::ptr;
use std::sync::atomic::{AtomicU64, Ordering};

/// BPF_MAP_DELETE_ELEM of `enum bpf_cmd`.
const BPF_MAP_DELETE_ELEM: libc::c_long = 3;

/// The part of `union bpf_attr` that the element commands use.
#[repr(C)]
struct ElementAttr {
    map_fd: u32,
    reserved: u32,
    key: u64,
    value: u64,
    flags: u64,
}

/// Takes the inner map out of slot `index` of an array of maps, which aya cannot do. Waits for an RCU grace
/// period. An empty slot is no error.
pub(crate) fn clear_inner_map(outer: BorrowedFd<'_>, index: u32) -> io::Result<()> {
    let attr = ElementAttr {
        map_fd: outer.as_raw_fd().cast_unsigned(),
        reserved: 0,
        key: ptr::from_ref(&index).addr() as u64,
        value: 0,
        flags: 0,
    };
    // SAFETY: the kernel reads `attr` and the four bytes of `index`, which both outlive the call.
    let result = unsafe {
        libc::syscall(
            libc::SYS_bpf,
            BPF_MAP_DELETE_ELEM,
            ptr::from_ref(&attr),
            size_of::<ElementAttr>(),
        )
    };
    match io::Error::last_os_error() {
        _ if result == 0 => Ok(()),
        error if error.kind() == io::ErrorKind::NotFound => Ok(()),
        error => Err(error),
    }
}

/// The bytes in a BPF ring buffer that its consumer has not read yet.
pub(crate) fn ring_fill(ring: BorrowedFd<'_>) -> io::Result<u64> {
    let page = page_size();
    // SAFETY: a new shared read-only mapping of the ring's first two pages, at an address that the kernel picks.
    let base = unsafe {
        libc::mmap(
            ptr::null_mut(),
            2 * page,
            libc::PROT_READ,
            libc::MAP_SHARED,
            ring.as_raw_fd(),
            0,
        )
    };
    if base == libc::MAP_FAILED {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: a ring buffer's first page begins with the consumer's position and its second with the producer's;
    // both are eight bytes that only ever change atomically, and the mapping is two pages long.
    let fill = unsafe {
        let consumer = (*base.cast::<AtomicU64>()).load(Ordering::Acquire);
        let producer = (*base.byte_add(page).cast::<AtomicU64>()).load(Ordering::Acquire);
        producer.wrapping_sub(consumer)
    };
    // SAFETY: exactly the mapping made above, to which no reference is left.
    unsafe { libc::munmap(base, 2 * page) };
    Ok(fill)
}

/// The size of a memory page, in bytes.
pub(crate) fn page_size() -> usize {
    // SAFETY: sysconf reads no memory of ours.
    let size = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
    usize::try_from(size).unwrap_or(4096)
}

/// The largest IP packet that an interface sends in one piece, in bytes.
pub(crate) fn interface_mtu(socket: BorrowedFd<'_>, name: &str) -> io::Result<u32> {
    let name = CString::new(name)?;
    let name = name.as_bytes_with_nul();
    // SAFETY: all zeros is a valid `ifreq`.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    if name.len() > request.ifr_name.len() {
        return Err(io::Error::from_raw_os_error(libc::ENODEV));
    }
    for (to, from) in request.ifr_name.iter_mut().zip(name) {
        *to = libc::c_char::from_ne_bytes([*from]);
    }
    // SAFETY: SIOCGIFMTU reads the name in `request` and writes its union.
    if unsafe { libc::ioctl(socket.as_raw_fd(), libc::SIOCGIFMTU, &raw mut request) } != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the call succeeded, so the union holds the MTU.
    let mtu = unsafe { request.ifr_ifru.ifru_mtu };
    u32::try_from(mtu).map_err(io::Error::other)
}

/// A copy of the descriptor whose number came on the command line, which may be that of standard output; `None` when
/// nothing is open under it.
pub(crate) fn inherited_fd(fd: RawFd) -> Option<OwnedFd> {
    const ABOVE_STANDARD: RawFd = 3;
    // SAFETY: takes numbers only, and refuses one under which nothing is open.
    let copy = unsafe { libc::fcntl(fd, libc::F_DUPFD_CLOEXEC, ABOVE_STANDARD) };
    // SAFETY: what is not negative is a new descriptor that nobody else owns.
    (copy >= 0).then(|| unsafe { OwnedFd::from_raw_fd(copy) })
}

/// Owns a descriptor that `accept4` just returned, for which nix has a plain number only.
pub(crate) fn accepted_fd(fd: RawFd) -> OwnedFd {
    // SAFETY: `accept4` made it for its caller, who passes it on here and nowhere else.
    unsafe { OwnedFd::from_raw_fd(fd) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_output_can_be_told_and_a_closed_descriptor_is_none() {
        let copy = inherited_fd(1).unwrap();
        assert!(copy.as_raw_fd() > 2);
        assert!(inherited_fd(-1).is_none());
        assert!(inherited_fd(RawFd::MAX).is_none());
    }
}
