//! Frames at the XDP hook.

use core::mem::MaybeUninit;

use aya_ebpf::{
    bindings::xdp_md,
    check_bounds_signed,
    helpers::{bpf_xdp_get_buff_len, bpf_xdp_load_bytes, bpf_xdp_store_bytes},
    programs::XdpContext,
};
use rtps_ebpf::Bytes;

use super::{Overwrite, Packet, fits};

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
}

impl Overwrite for Frame {
    #[inline(always)]
    fn store_u16(&self, offset: u32, value: u16) -> Result<(), ()> {
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
    let mut bytes = MaybeUninit::<[u8; N]>::uninit();
    let to = bytes.as_mut_ptr().cast();
    // SAFETY: the helper writes all `N` bytes, or fails, which is asked first.
    unsafe {
        let result = bpf_xdp_load_bytes(context, offset, to, N as u32);
        (result == 0).then(|| bytes.assume_init())
    }
}
