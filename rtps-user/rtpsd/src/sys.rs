//! The only unsafe room of rtpsd: system calls for which neither nix nor aya has a safe function.
#![expect(
    unsafe_code,
    reason = "system calls that no dependency wraps; each block states why it is sound"
)]

use std::io;
use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::ptr;
use std::sync::atomic::{AtomicU64, Ordering};

/// BPF_MAP_UPDATE_BATCH of `enum bpf_cmd`.
const BPF_MAP_UPDATE_BATCH: libc::c_long = 26;

/// The part of `union bpf_attr` that the batch commands use.
#[repr(C)]
struct BatchAttr {
    in_batch: u64,
    out_batch: u64,
    keys: u64,
    values: u64,
    count: u32,
    map_fd: u32,
    element_flags: u64,
    flags: u64,
}

/// Puts inner maps into an array of maps, one at each index, which aya can do only one by one. Waits for an RCU grace
/// period.
pub(crate) fn set_inner_maps(
    outer: BorrowedFd<'_>,
    indices: &[u32],
    inner: &[BorrowedFd<'_>],
) -> io::Result<()> {
    let descriptors: Vec<RawFd> = inner.iter().map(AsRawFd::as_raw_fd).collect();
    let count = indices.len().min(descriptors.len());
    let mut attr = BatchAttr {
        in_batch: 0,
        out_batch: 0,
        keys: indices.as_ptr().addr() as u64,
        values: descriptors.as_ptr().addr() as u64,
        count: u32::try_from(count).map_err(io::Error::other)?,
        map_fd: outer.as_raw_fd().cast_unsigned(),
        element_flags: 0,
        flags: 0,
    };
    // SAFETY: the kernel reads `count` keys and values, four bytes each, which outlive the call, and writes to `attr`,
    // which nothing else refers to, how many it has handled.
    let result = unsafe {
        libc::syscall(
            libc::SYS_bpf,
            BPF_MAP_UPDATE_BATCH,
            ptr::from_mut(&mut attr),
            size_of::<BatchAttr>(),
        )
    };
    match result {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
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

/// Has an IPv6 socket send from lasting addresses, where the system would take temporary ones (RFC 5014).
pub(crate) fn prefer_public_addresses(socket: BorrowedFd<'_>) -> io::Result<()> {
    /// IPV6_PREFER_SRC_PUBLIC of `linux/in6.h`.
    const PREFER_PUBLIC: libc::c_int = 2;
    // SAFETY: the kernel reads the option's four bytes, which outlive the call.
    let result = unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            libc::IPPROTO_IPV6,
            libc::IPV6_ADDR_PREFERENCES,
            ptr::from_ref(&PREFER_PUBLIC).cast(),
            size_of::<libc::c_int>() as libc::socklen_t,
        )
    };
    match result {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
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
