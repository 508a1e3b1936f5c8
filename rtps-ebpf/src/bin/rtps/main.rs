//! The kernel programs: one demultiplexer behind two hooks.
//!
//! `rtps_xdp` takes unicast, unfragmented datagrams that concern apps only. Whatever it passes
//! reaches the layer's own UDP sockets, where `rtps_filter` delivers to the apps in the same way
//! and lets into the socket only what concerns rtpsd. So exactly one hook delivers each datagram.
//!
//! Build with `cargo xtask build-ebpf`.
#![no_std]
#![no_main]
#![expect(
    unreachable_pub,
    missing_docs,
    reason = "the entries' macros make exported, undocumented functions of them"
)]

mod deliver;
mod filter;
mod maps;
mod message;
mod sys;
mod xdp;

use aya_ebpf::{
    macros::{socket_filter, xdp},
    programs::{SkBuffContext, XdpContext},
};

/// Hook 1: every frame of an interface.
#[xdp(frags)]
pub fn rtps_xdp(context: XdpContext) -> u32 {
    xdp::handle(&sys::Frame::new(&context))
}

/// Hook 2: every datagram for one of the layer's sockets. Returns how much of it the socket gets.
#[socket_filter]
pub fn rtps_filter(context: SkBuffContext) -> i64 {
    filter::handle(&sys::SocketBuffer::new(&context))
}

/// What the kernel reads as the programs' licence; GPL-compatible, as some helpers demand.
// SAFETY: the section is only read, and nothing else defines a symbol or section of these names.
#[unsafe(no_mangle)]
#[unsafe(link_section = "license")]
static LICENSE: [u8; 13] = *b"Dual MIT/GPL\0";

/// Unreachable: nothing in the programs can panic, and the verifier refuses what could.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}
