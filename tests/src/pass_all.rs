//! An XDP program that passes every packet, for the remote end of a veth pair.
//!
//! What a program sends by XDP_TX on one end of a veth pair is silently lost unless the other end
//! has an XDP program, too.

use anyhow::Result;

use crate::bpf::{self, Hook, Link};
use crate::link::Interface;
use crate::netns::Netns;

const XDP_PASS: i32 = 2;

/// Every packet passes; dropping the value detaches the program.
pub struct PassAll(#[expect(dead_code, reason = "held for its drop")] Link);

impl PassAll {
    /// Attaches the program to an interface of `netns`, in native mode.
    pub fn attach(netns: &Netns, interface: &Interface) -> Result<Self> {
        let program = [bpf::move_immediate(0, XDP_PASS), bpf::exit()];
        bpf::attach(netns, &interface.name, Hook::NativeXdp, &program).map(Self)
    }
}
