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
        Self::map(
            ptr::null_mut(),
            Some((fd, offset)),
            len,
            write,
            libc::MAP_SHARED,
        )
    }

    /// Reserves `len` bytes of addresses without access.
    pub(super) fn reserve(len: usize) -> io::Result<Self> {
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;
        Self::map(ptr::null_mut(), None, len, false, flags)
    }

    /// Replaces the part of this mapping at `at` by `len` bytes of `fd` from `offset` on, readable and perhaps
    /// writable.
    pub(super) fn overlay(
        &self,
        at: usize,
        (fd, offset): (BorrowedFd<'_>, usize),
        len: usize,
        write: bool,
    ) -> io::Result<()> {
        if at.checked_add(len).is_none_or(|end| end > self.len) {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        let place = self.start.as_ptr().wrapping_add(at).cast();
        let flags = libc::MAP_SHARED | libc::MAP_FIXED;
        // The range belongs to `self`, which unmaps all of it.
        let part = Self::map(place, Some((fd, offset)), len, write, flags)?;
        std::mem::forget(part);
        Ok(())
    }

    fn map(
        place: *mut libc::c_void,
        file: Option<(BorrowedFd<'_>, usize)>,
        len: usize,
        write: bool,
        flags: libc::c_int,
    ) -> io::Result<Self> {
        let protection = match (file.is_some(), write) {
            (false, _) => libc::PROT_NONE,
            (true, false) => libc::PROT_READ,
            (true, true) => libc::PROT_READ | libc::PROT_WRITE,
        };
        let (fd, offset) = match file {
            Some((fd, offset)) => (fd.as_raw_fd(), offset),
            None => (-1, 0),
        };
        let offset = libc::off_t::try_from(offset).map_err(|_| io::ErrorKind::InvalidInput)?;
        // SAFETY: `place` is null, or a range that the caller of `overlay` owns; all else is checked by the kernel.
        let start = unsafe { libc::mmap(place, len, protection, flags, fd, offset) };
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
        // SAFETY: the range was mapped by `map`, and nobody holds a reference into it beyond a borrow of `self`.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.len) };
    }
}
