//! Frames at the XDP hook.

use core::ffi::c_void;

use aya_ebpf::{
    bindings::xdp_md,
    helpers::{bpf_xdp_get_buff_len, bpf_xdp_load_bytes, bpf_xdp_store_bytes},
    programs::XdpContext,
};
use rtps_ebpf::Bytes;

use super::{
    Overwrite,
    message::{self, Message, Packet},
    succeed,
};

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
    pub(crate) fn message(&self, start: u32, len: u32) -> Message<*mut xdp_md> {
        Message::new(self.context, start, len)
    }
}

impl Overwrite for Frame {
    #[inline(always)]
    fn store_u16(&self, offset: u32, value: u16) -> Result<(), ()> {
        let mut bytes = value.to_be_bytes();
        // SAFETY: the helper reads the two bytes that it is given.
        succeed(unsafe { bpf_xdp_store_bytes(self.context, offset, (&raw mut bytes).cast(), 2) })
    }
}

impl Bytes for Frame {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        message::load(self.context, offset)
    }
}

impl Packet for *mut xdp_md {
    #[inline(always)]
    unsafe fn read(self, offset: u32, to: *mut c_void, len: u32) -> i64 {
        // SAFETY: as the caller vouches.
        unsafe { bpf_xdp_load_bytes(self, offset, to, len) }
    }
}
