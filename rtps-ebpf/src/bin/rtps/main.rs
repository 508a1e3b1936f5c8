//! The kernel programs: one demultiplexer behind three hooks, and a fan-out behind a fourth.
//!
//! `rtps_xdp` takes unicast, unfragmented datagrams that concern apps only. `rtps_ingress` takes what
//! concerns the built-in endpoints, and does their work: it remembers, answers, and tells rtpsd the
//! news. Whatever both pass reaches the layer's own UDP sockets, where `rtps_filter` does the same but
//! for answers. So exactly one hook delivers each datagram.
//!
//! In the other direction, `rtps_fan_out` sends to several destinations what an app has sent once.
//!
//! Build with `cargo xtask build-ebpf`.
#![no_std]
#![no_main]
#![feature(core_intrinsics)]
#![expect(
    unreachable_pub,
    missing_docs,
    reason = "the entries' macros make exported, undocumented functions of them"
)]
#![expect(
    internal_features,
    reason = "the target has a compare-and-exchange, but `core` no atomic type for it"
)]

mod burst;
mod deliver;
mod emit;
mod exchange;
mod fan_out;
mod filter;
mod ingress;
mod maps;
mod message;
mod sys;
mod xdp;

use aya_ebpf::{
    macros::{classifier, socket_filter, xdp},
    programs::{SkBuffContext, TcContext, XdpContext},
};

/// Hook 1: every frame of an interface.
#[xdp(frags)]
pub fn rtps_xdp(context: XdpContext) -> u32 {
    xdp::handle(&sys::Frame::new(&context))
}

/// Hook 2: every frame of an interface that XDP has passed.
#[classifier]
pub fn rtps_ingress(context: TcContext) -> i32 {
    ingress::handle(&sys::LinkBuffer::new(&context))
}

/// Hook 3: every datagram for one of the layer's sockets. Returns how much of it the socket gets.
#[socket_filter]
pub fn rtps_filter(context: SkBuffContext) -> i64 {
    filter::handle(&sys::SocketBuffer::new(&context))
}

/// Hook 4: every packet that a process sends over the loopback interface.
#[classifier]
pub fn rtps_fan_out(context: TcContext) -> i32 {
    fan_out::handle(&sys::LinkBuffer::new(&context))
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
