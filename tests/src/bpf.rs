//! Hand-assembled BPF programs: just what a lossy link and a pass-all program need.
//!
//! An instruction is 64 bits: opcode, destination and source register, 16-bit offset, 32-bit
//! immediate (RFC 9669, section 3). Programs and links are file descriptors: dropping a
//! [`Link`] detaches its program.

use std::os::fd::{AsRawFd, OwnedFd};

use anyhow::{Context, Result};

use crate::netns::Netns;
use crate::sys::{self, BpfCommand};

/// A register of the BPF machine, r0 to r10.
pub(crate) type Register = u8;

/// Opcodes (RFC 9669, appendix A) that the programs of this crate use.
mod opcode {
    pub(super) const LOAD_64_IMMEDIATE: u8 = 0x18;
    pub(super) const LOAD_PACKET_BYTE: u8 = 0x30;
    pub(super) const LOAD_32: u8 = 0x61;
    pub(super) const STORE_32_IMMEDIATE: u8 = 0x62;
    pub(super) const ATOMIC_64: u8 = 0xdb;
    pub(super) const MOVE_64_IMMEDIATE: u8 = 0xb7;
    pub(super) const MOVE_64: u8 = 0xbf;
    pub(super) const ADD_64_IMMEDIATE: u8 = 0x07;
    pub(super) const MODULO_64_IMMEDIATE: u8 = 0x97;
    pub(super) const JUMP_EQUAL_IMMEDIATE: u8 = 0x15;
    pub(super) const JUMP_NOT_EQUAL_IMMEDIATE: u8 = 0x55;
    pub(super) const JUMP_32_GREATER_OR_EQUAL_IMMEDIATE: u8 = 0x36;
    pub(super) const CALL: u8 = 0x85;
    pub(super) const EXIT: u8 = 0x95;
}

/// `BPF_ADD | BPF_FETCH`: the register receives the value from before the addition.
const FETCH_ADD: i32 = 0x01;
/// Source register of a 64-bit load that names a map by its descriptor.
const PSEUDO_MAP_FD: Register = 1;

/// A helper function by its number (`enum bpf_func_id`).
#[derive(Clone, Copy)]
pub(crate) enum Helper {
    MapLookup = 1,
    RandomU32 = 7,
}

fn encode(opcode: u8, destination: Register, source: Register, offset: i16, immediate: i32) -> u64 {
    let mut bytes = [0; 8];
    bytes[0] = opcode;
    bytes[1] = source << 4 | destination;
    bytes[2..4].copy_from_slice(&offset.to_ne_bytes());
    bytes[4..].copy_from_slice(&immediate.to_ne_bytes());
    u64::from_ne_bytes(bytes)
}

pub(crate) fn move_immediate(destination: Register, value: i32) -> u64 {
    encode(opcode::MOVE_64_IMMEDIATE, destination, 0, 0, value)
}

pub(crate) fn move_register(destination: Register, source: Register) -> u64 {
    encode(opcode::MOVE_64, destination, source, 0, 0)
}

pub(crate) fn add_immediate(destination: Register, value: i32) -> u64 {
    encode(opcode::ADD_64_IMMEDIATE, destination, 0, 0, value)
}

pub(crate) fn modulo_immediate(destination: Register, value: i32) -> u64 {
    encode(opcode::MODULO_64_IMMEDIATE, destination, 0, 0, value)
}

pub(crate) fn load_u32(destination: Register, base: Register, offset: i16) -> u64 {
    encode(opcode::LOAD_32, destination, base, offset, 0)
}

/// Loads the byte at this offset of the packet into r0; ends the program with 0 when the packet is shorter. The context
/// is in r6, and r1 to r5 are lost.
pub(crate) fn load_packet_byte(offset: i32) -> u64 {
    encode(opcode::LOAD_PACKET_BYTE, 0, 0, 0, offset)
}

pub(crate) fn store_u32_immediate(base: Register, offset: i16, value: i32) -> u64 {
    encode(opcode::STORE_32_IMMEDIATE, base, 0, offset, value)
}

pub(crate) fn fetch_add_u64(base: Register, offset: i16, register: Register) -> u64 {
    encode(opcode::ATOMIC_64, base, register, offset, FETCH_ADD)
}

/// The two instructions that load the address of a map.
pub(crate) fn load_map(destination: Register, map: &OwnedFd) -> [u64; 2] {
    let first = encode(
        opcode::LOAD_64_IMMEDIATE,
        destination,
        PSEUDO_MAP_FD,
        0,
        map.as_raw_fd(),
    );
    [first, 0]
}

/// Skips `count` instructions when the register equals `value`.
pub(crate) fn skip_if_equal(register: Register, value: i32, count: i16) -> u64 {
    encode(opcode::JUMP_EQUAL_IMMEDIATE, register, 0, count, value)
}

/// Skips `count` instructions when the register differs from `value`.
pub(crate) fn skip_if_not_equal(register: Register, value: i32, count: i16) -> u64 {
    encode(opcode::JUMP_NOT_EQUAL_IMMEDIATE, register, 0, count, value)
}

/// Skips `count` instructions when the low half of the register is at least `value`, unsigned.
pub(crate) fn skip_if_at_least_u32(register: Register, value: u32, count: i16) -> u64 {
    encode(
        opcode::JUMP_32_GREATER_OR_EQUAL_IMMEDIATE,
        register,
        0,
        count,
        value.cast_signed(),
    )
}

pub(crate) fn call(helper: Helper) -> u64 {
    encode(opcode::CALL, 0, 0, 0, helper as i32)
}

pub(crate) fn exit() -> u64 {
    encode(opcode::EXIT, 0, 0, 0, 0)
}

/// Where a program is attached (`enum bpf_attach_type`).
#[derive(Clone, Copy)]
pub(crate) enum Hook {
    /// Native XDP: the driver's own, never the generic one.
    NativeXdp,
    /// tcx, packets that the interface has received (kernel >= 6.6).
    TcIngress,
    /// tcx, packets that the interface is about to send (kernel >= 6.6).
    TcEgress,
}

impl Hook {
    fn program_type(self) -> u32 {
        match self {
            Self::TcIngress | Self::TcEgress => 3,
            Self::NativeXdp => 6,
        }
    }

    fn attach_type(self) -> u32 {
        match self {
            Self::NativeXdp => 37,
            Self::TcIngress => 46,
            Self::TcEgress => 47,
        }
    }

    fn flags(self) -> u32 {
        const XDP_FLAGS_DRV_MODE: u32 = 1 << 2;
        match self {
            Self::NativeXdp => XDP_FLAGS_DRV_MODE,
            Self::TcIngress | Self::TcEgress => 0,
        }
    }
}

/// An attached program; dropping it detaches the program.
pub(crate) struct Link(#[expect(dead_code, reason = "held for its drop")] OwnedFd);

/// An array map with one element of `N` 64-bit counters.
pub(crate) struct Counters<const N: usize>(OwnedFd);

impl<const N: usize> Counters<N> {
    pub(crate) fn new() -> Result<Self> {
        let value_size = u32::try_from(N * size_of::<u64>())?;
        let map = sys::bpf(BpfCommand::CreateArray { value_size }).context("making a BPF map")?;
        Ok(Self(map))
    }

    pub(crate) fn fd(&self) -> &OwnedFd {
        &self.0
    }

    pub(crate) fn read(&self) -> Result<[u64; N]> {
        sys::bpf_read_array(self.0.as_raw_fd()).context("reading a BPF map")
    }
}

/// Loads a program and attaches it to an interface of `netns`.
pub(crate) fn attach(
    netns: &Netns,
    interface: &str,
    hook: Hook,
    instructions: &[u64],
) -> Result<Link> {
    let program = sys::bpf(BpfCommand::LoadProgram {
        program_type: hook.program_type(),
        instructions,
    })
    .context("loading a BPF program (root and kernel >= 6.6 needed)")?;
    let attached = netns.enter(|| {
        sys::bpf(BpfCommand::Attach {
            program: program.as_raw_fd(),
            interface: nix::net::if_::if_nametoindex(interface)?,
            attach_type: hook.attach_type(),
            flags: hook.flags(),
        })
    });
    let link = attached.with_context(|| format!("attaching a BPF program to {interface}"))?;
    Ok(Link(link))
}
