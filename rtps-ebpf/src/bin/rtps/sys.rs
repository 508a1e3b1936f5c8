//! Packets and helper functions: with `maps`, the only unsafe code of the programs.

mod buffer;
mod egress;
mod frame;
mod message;

use core::{
    ffi::c_void,
    intrinsics::{AtomicOrdering, atomic_cxchg},
    ops::ControlFlow,
    ptr::NonNull,
};

use aya_ebpf::{
    check_bounds_signed,
    helpers::{bpf_csum_diff, bpf_ktime_get_ns, bpf_loop, generated::bpf_probe_read_kernel},
};
use rtps_ebpf::reply::fold;

pub(crate) use buffer::{LinkBuffer, SocketBuffer};
pub(crate) use frame::Frame;
pub(crate) use message::{Message, Packet};

/// A packet that can be changed in place.
pub(crate) trait Overwrite {
    /// Overwrites two bytes with a number in network order.
    fn store_u16(&self, offset: u32, value: u16) -> Result<(), ()>;
}

/// What a helper's result says.
#[inline(always)]
const fn succeed(result: i64) -> Result<(), ()> {
    if result == 0 { Ok(()) } else { Err(()) }
}

/// A loop's state and body.
pub(crate) trait Repeat {
    /// One turn.
    fn turn(&mut self) -> ControlFlow<()>;
}

/// Takes turns until one breaks, at most `limit`. The verifier looks at the body only a few times,
/// whatever the limit.
#[inline(always)]
pub(crate) fn repeat<R: Repeat>(limit: u32, state: &mut R) {
    // SAFETY: the callback gets the state back, which nobody else touches meanwhile.
    unsafe { bpf_loop(limit, turn::<R> as *mut c_void, (&raw mut *state).cast(), 0) };
}

unsafe extern "C" fn turn<R: Repeat>(_index: u32, state: *mut c_void) -> i64 {
    // SAFETY: `repeat` passed a unique reference to an `R`.
    let state = unsafe { &mut *state.cast::<R>() };
    match state.turn() {
        ControlFlow::Continue(()) => 0,
        ControlFlow::Break(()) => 1,
    }
}

/// CLOCK_MONOTONIC, in nanoseconds.
#[inline(always)]
pub(crate) fn now_ns() -> u64 {
    // SAFETY: takes nothing, changes nothing.
    unsafe { bpf_ktime_get_ns() }
}

/// Copies more bytes than the compiler would copy without calling a function that does not exist.
#[inline(always)]
pub(crate) fn copy<const N: usize>(from: &[u8; N], to: &mut [u8; N]) {
    // SAFETY: both have `N` bytes. The helper fails for addresses that are not the kernel's only.
    unsafe { bpf_probe_read_kernel(to.as_mut_ptr().cast(), N as u32, from.as_ptr().cast()) };
}

/// Replaces `before` by `after` in a map, unless there is something else by now.
#[inline(always)]
pub(crate) fn compare_exchange(value: NonNull<u64>, before: u64, after: u64) -> bool {
    const ORDER: AtomicOrdering = AtomicOrdering::SeqCst;
    // SAFETY: the caller got the pointer from a map, whose values are aligned and stay.
    unsafe { atomic_cxchg::<u64, ORDER, ORDER>(value.as_ptr(), before, after) }.1
}

/// The one's complement sum of the first `len` bytes, a multiple of 4, as words in network order.
#[inline(always)]
pub(crate) fn sum<const N: usize>(bytes: &[u8; N], len: u32) -> u16 {
    let mut summing = Summing {
        bytes,
        offset: 0,
        len,
        sum: 0,
    };
    repeat(N as u32 / SUMMED_AT_ONCE, &mut summing);
    fold(summing.sum).to_be()
}

/// What kernels before 6.13 take at once.
const SUMMED_AT_ONCE: u32 = 512;

struct Summing<'a, const N: usize> {
    bytes: &'a [u8; N],
    offset: u32,
    len: u32,
    /// Of words in host order.
    sum: u32,
}

impl<const N: usize> Repeat for Summing<'_, N> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let offset = self.offset;
        let len = self.len.saturating_sub(offset).min(SUMMED_AT_ONCE);
        let last = N as i64 - i64::from(SUMMED_AT_ONCE);
        if !check_bounds_signed(i64::from(len), 1, SUMMED_AT_ONCE.into())
            || !check_bounds_signed(i64::from(offset), 0, last)
        {
            return ControlFlow::Break(());
        }
        // SAFETY: offset and length lie within the bytes, which the helper reads.
        self.sum = unsafe {
            let from = self.bytes.as_ptr().add(offset as usize).cast_mut().cast();
            bpf_csum_diff(core::ptr::null_mut(), 0, from, len, self.sum)
        } as u32;
        self.offset = offset + SUMMED_AT_ONCE;
        ControlFlow::Continue(())
    }
}
