//! The RTPS message in a packet.

use core::{ffi::c_void, mem::MaybeUninit};

use aya_ebpf::check_bounds_signed;
use rtps_ebpf::Bytes;

use super::succeed;

/// A packet as its program gets it: a context that a helper reads it through.
pub(crate) trait Packet: Copy {
    /// Copies `len` bytes from `offset` to `to`; fails with a result that is not 0.
    ///
    /// # Safety
    /// The context must be the program's own, and `to` valid for writes of `len` bytes.
    unsafe fn read(self, offset: u32, to: *mut c_void, len: u32) -> i64;
}

/// An RTPS message in a packet.
pub(crate) struct Message<P> {
    packet: P,
    start: u32,
    len: u32,
}

impl<P: Packet> Message<P> {
    #[inline(always)]
    pub(super) const fn new(packet: P, start: u32, len: u32) -> Self {
        Self { packet, start, len }
    }

    /// Copies the first `len` bytes, which must be at least 1 and at most `limit`, to where a helper may write.
    ///
    /// # Safety
    /// `to` must be valid for writes of `limit` bytes.
    #[inline(always)]
    pub(crate) unsafe fn copy(&self, to: *mut u8, len: u32, limit: usize) -> Result<(), ()> {
        if !check_bounds_signed(i64::from(len), 1, limit as i64) {
            return Err(());
        }
        // SAFETY: the context is the program's own; `len` is at most `limit`, for which the caller vouches.
        succeed(unsafe { self.packet.read(self.start, to.cast(), len) })
    }
}

impl<P: Packet> Bytes for Message<P> {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        if u64::from(offset) + N as u64 > u64::from(self.len) {
            return None;
        }
        load(self.packet, self.start + offset)
    }
}

/// Reads `N` bytes of a packet; `None` where fewer are left.
#[inline(always)]
pub(super) fn load<const N: usize>(packet: impl Packet, offset: u32) -> Option<[u8; N]> {
    let mut bytes = MaybeUninit::<[u8; N]>::uninit();
    let to = bytes.as_mut_ptr().cast();
    // SAFETY: the context is the program's own. The helper writes all `N` bytes, or fails, which is asked first.
    unsafe {
        let result = packet.read(offset, to, N as u32);
        (result == 0).then(|| bytes.assume_init())
    }
}
