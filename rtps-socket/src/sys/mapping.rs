//! A range of memory that is mapped from a descriptor and unmapped when dropped.

use std::io;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::ptr::{self, NonNull};

/// Memory shared with whoever else maps the same descriptor, so all access goes through atomics or through
/// pointers to what the other side has published.
#[derive(Debug)]
pub(super) struct Mapping {
    start: NonNull<u8>,
    len: usize,
}

// SAFETY: the mapping is a plain range of memory; it belongs to no thread.
unsafe impl Send for Mapping {}
// SAFETY: shared references only give out pointers, whose users synchronize by themselves.
unsafe impl Sync for Mapping {}

/// Size of a page in bytes.
pub(super) fn page_size() -> usize {
    // SAFETY: no preconditions.
    let size = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
    usize::try_from(size).unwrap_or(4096)
}

impl Mapping {
    /// Maps `len` bytes of `fd` from `offset` on, readable and perhaps writable.
    pub(super) fn new(
        fd: BorrowedFd<'_>,
        offset: usize,
        len: usize,
        write: bool,
    ) -> io::Result<Self> {
        let protection = match write {
            false => libc::PROT_READ,
            true => libc::PROT_READ | libc::PROT_WRITE,
        };
        let offset = libc::off_t::try_from(offset).map_err(|_| io::ErrorKind::InvalidInput)?;
        let (fd, flags) = (fd.as_raw_fd(), libc::MAP_SHARED);
        // SAFETY: the kernel chooses a place where nothing is, and checks all else.
        let start = unsafe { libc::mmap(ptr::null_mut(), len, protection, flags, fd, offset) };
        match NonNull::new(start.cast::<u8>()) {
            Some(start) if start.as_ptr().cast() != libc::MAP_FAILED => Ok(Self { start, len }),
            _ => Err(io::Error::last_os_error()),
        }
    }

    /// Where the mapping begins.
    pub(super) fn start(&self) -> *const u8 {
        self.start.as_ptr()
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: the range was mapped by `new`, and nobody holds a reference into it beyond a borrow of `self`.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.len) };
    }
}
