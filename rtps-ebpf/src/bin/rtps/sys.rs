//! Packets and helper functions: with `maps`, the only unsafe code of the programs.

use core::{ffi::c_void, ops::ControlFlow};

use aya_ebpf::{
    EbpfContext as _,
    bindings::{__sk_buff, bpf_hdr_start_off::BPF_HDR_START_NET, xdp_md},
    check_bounds_signed,
    helpers::{
        bpf_ktime_get_ns, bpf_loop, bpf_skb_load_bytes, bpf_skb_load_bytes_relative,
        bpf_xdp_get_buff_len, bpf_xdp_load_bytes, bpf_xdp_store_bytes,
    },
    programs::{SkBuffContext, XdpContext},
};
use rtps_ebpf::{Bytes, frame::UDP_LEN};

/// Bytes that can be copied to where a helper may write.
pub(crate) trait Packet: Bytes {
    /// Copies the first `len` bytes, which must be at least 1 and at most `limit`, to `to`.
    ///
    /// # Safety
    /// `to` must be valid for writes of `limit` bytes.
    unsafe fn copy(&self, to: *mut u8, len: u32, limit: usize) -> Result<(), ()>;
}

/// An Ethernet frame at the XDP hook.
pub(crate) struct Frame {
    context: *mut xdp_md,
    len: u32,
}

impl Frame {
    #[inline(always)]
    pub(crate) fn new(context: &XdpContext) -> Self {
        // SAFETY: the context is the program's own.
        let len = unsafe { bpf_xdp_get_buff_len(context.ctx) } as u32;
        Self {
            context: context.ctx,
            len,
        }
    }

    #[inline(always)]
    pub(crate) fn ifindex(&self) -> u32 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).ingress_ifindex }
    }

    /// The part of the frame that holds an RTPS message.
    #[inline(always)]
    pub(crate) fn message(&self, start: u32, len: u32) -> FrameMessage {
        FrameMessage {
            context: self.context,
            start,
            len,
        }
    }

    /// Overwrites two bytes with a number in network order.
    #[inline(always)]
    pub(crate) fn store_u16(&self, offset: u32, value: u16) -> Result<(), ()> {
        let mut bytes = value.to_be_bytes();
        // SAFETY: the helper reads the two bytes that it is given.
        match unsafe { bpf_xdp_store_bytes(self.context, offset, (&raw mut bytes).cast(), 2) } {
            0 => Ok(()),
            _ => Err(()),
        }
    }
}

impl Bytes for Frame {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        load_frame(self.context, offset)
    }
}

/// An RTPS message in a frame.
pub(crate) struct FrameMessage {
    context: *mut xdp_md,
    start: u32,
    len: u32,
}

impl Bytes for FrameMessage {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        if !fits(offset, N, self.len) {
            return None;
        }
        load_frame(self.context, self.start + offset)
    }
}

impl Packet for FrameMessage {
    #[inline(always)]
    unsafe fn copy(&self, to: *mut u8, len: u32, limit: usize) -> Result<(), ()> {
        if !check_bounds_signed(i64::from(len), 1, limit as i64) {
            return Err(());
        }
        // SAFETY: `len` is at most `limit`, for which the caller vouches.
        match unsafe { bpf_xdp_load_bytes(self.context, self.start, to.cast(), len) } {
            0 => Ok(()),
            _ => Err(()),
        }
    }
}

#[inline(always)]
fn load_frame<const N: usize>(context: *mut xdp_md, offset: u32) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    // SAFETY: the helper writes `N` bytes at most, and fails beyond the frame.
    let result = unsafe { bpf_xdp_load_bytes(context, offset, (&raw mut bytes).cast(), N as u32) };
    (result == 0).then_some(bytes)
}

/// A datagram at a UDP socket: data begins at the UDP header, after reassembly.
pub(crate) struct SocketBuffer {
    context: *mut __sk_buff,
    len: u32,
}

impl SocketBuffer {
    #[inline(always)]
    pub(crate) fn new(context: &SkBuffContext) -> Self {
        Self {
            context: context.as_ptr().cast(),
            len: context.len(),
        }
    }

    #[inline(always)]
    pub(crate) fn ifindex(&self) -> u32 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).ifindex }
    }

    /// The ethertype, in host order.
    #[inline(always)]
    pub(crate) fn protocol(&self) -> u16 {
        // SAFETY: the context is the program's own.
        u16::from_be(unsafe { (*self.context).protocol } as u16)
    }

    /// Reads from the IP header.
    #[inline(always)]
    pub(crate) fn load_network<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        // SAFETY: the helper writes `N` bytes at most, and fails beyond the headers.
        let result = unsafe {
            bpf_skb_load_bytes_relative(
                self.context.cast(),
                offset,
                (&raw mut bytes).cast(),
                N as u32,
                BPF_HDR_START_NET,
            )
        };
        (result == 0).then_some(bytes)
    }

    /// The payload: an RTPS message.
    #[inline(always)]
    pub(crate) fn message(&self) -> SocketMessage {
        SocketMessage {
            context: self.context,
            len: self.len.saturating_sub(UDP_LEN),
        }
    }
}

impl Bytes for SocketBuffer {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        load_buffer(self.context, offset)
    }
}

/// An RTPS message at a UDP socket.
pub(crate) struct SocketMessage {
    context: *mut __sk_buff,
    len: u32,
}

impl Bytes for SocketMessage {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        if !fits(offset, N, self.len) {
            return None;
        }
        load_buffer(self.context, UDP_LEN + offset)
    }
}

impl Packet for SocketMessage {
    #[inline(always)]
    unsafe fn copy(&self, to: *mut u8, len: u32, limit: usize) -> Result<(), ()> {
        if !check_bounds_signed(i64::from(len), 1, limit as i64) {
            return Err(());
        }
        // SAFETY: `len` is at most `limit`, for which the caller vouches.
        match unsafe { bpf_skb_load_bytes(self.context.cast(), UDP_LEN, to.cast(), len) } {
            0 => Ok(()),
            _ => Err(()),
        }
    }
}

#[inline(always)]
fn load_buffer<const N: usize>(context: *mut __sk_buff, offset: u32) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    // SAFETY: the helper writes `N` bytes at most, and fails beyond the packet.
    let result =
        unsafe { bpf_skb_load_bytes(context.cast(), offset, (&raw mut bytes).cast(), N as u32) };
    (result == 0).then_some(bytes)
}

/// Whether `count` bytes at `offset` lie within `len`.
#[inline(always)]
fn fits(offset: u32, count: usize, len: u32) -> bool {
    u64::from(offset) + count as u64 <= u64::from(len)
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
