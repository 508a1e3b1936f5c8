//! The app's bell: one flag in a page that the kernel's programs read.

use std::io;
use std::os::fd::BorrowedFd;
use std::sync::atomic::{AtomicU32, Ordering, fence};

use super::mapping::{Mapping, page_size};

/// Says whether the app sleeps ([`rtps_ebpf::abi::Bell`]).
#[derive(Debug)]
pub(crate) struct Bell {
    mapping: Mapping,
}

impl Bell {
    /// Maps the bell that the layer passed.
    pub(crate) fn map(fd: BorrowedFd<'_>) -> io::Result<Self> {
        let mapping = Mapping::new(fd, 0, page_size(), true)?;
        Ok(Self { mapping })
    }

    /// Asks to be woken. The ring has to be looked at once more after this: whatever is not there then will ring.
    pub(crate) fn arm(&self) {
        self.need_wakeup().store(1, Ordering::SeqCst);
        fence(Ordering::SeqCst);
    }

    /// Awake: no wake-ups, please.
    pub(crate) fn disarm(&self) {
        self.need_wakeup().store(0, Ordering::Relaxed);
    }

    fn need_wakeup(&self) -> &AtomicU32 {
        // SAFETY: a page-aligned, writable page that lives as long as `self`; the kernel side only reads the word.
        unsafe { &*self.mapping.start().cast() }
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;
    use std::os::unix::fs::FileExt;

    use super::*;
    use crate::sys::ring::tests::memory_file;

    #[test]
    fn the_other_side_sees_the_flag() {
        let file = memory_file(page_size());
        let bell = Bell::map(file.as_fd()).unwrap();
        let mut seen = [9; 4];
        bell.arm();
        file.read_exact_at(&mut seen, 0).unwrap();
        assert_eq!(u32::from_ne_bytes(seen), 1);
        bell.disarm();
        file.read_exact_at(&mut seen, 0).unwrap();
        assert_eq!(u32::from_ne_bytes(seen), 0);
    }
}
