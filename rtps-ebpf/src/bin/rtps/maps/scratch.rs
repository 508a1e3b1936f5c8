//! What each CPU keeps of the message in hand.

use aya_ebpf::{btf_maps::PerCpuArray, macros::btf_map};
use rtps_ebpf::{Reason, SlotSet, Walk, abi::RecordHeader, discovery::Exchange, frame::Datagram};

use super::{Lookup, Progress};
use crate::{burst::Burst, emit::Reply};

#[btf_map(name = "scratch")]
static SCRATCH: PerCpuArray<Scratch, 1> = PerCpuArray::new();
#[btf_map(name = "exchange")]
static EXCHANGE: PerCpuArray<Exchange, 1> = PerCpuArray::new();
#[btf_map(name = "reply")]
static REPLY: PerCpuArray<Reply, 1> = PerCpuArray::new();

/// The state of the message in hand.
///
/// In a map and not on the stack, which has 512 bytes, and because the verifier forgets what it
/// knows of a map's contents: it would follow each possible content of the stack on its own. All
/// hooks run in softirq context, so that a CPU handles one message at a time.
#[repr(C)]
pub(crate) struct Scratch {
    /// Where the message lies in its frame.
    pub(crate) datagram: Datagram,
    pub(crate) lookup: Lookup,
    pub(crate) walk: Walk,
    pub(crate) header: RecordHeader,
    /// The apps that the message has still to be delivered to.
    pub(crate) targets: SlotSet,
    /// Of the first sleeping app that the datagram itself can wake, or 0.
    pub(crate) doorbell_port: u32,
    /// Not 0: at least one app has it.
    pub(crate) delivered: u32,
    pub(crate) malformed: Option<Reason>,
    /// Of the sender, before the message.
    pub(crate) progress: Progress,
    /// The sender was unknown before the message.
    pub(crate) is_new: bool,
    /// At the tc hook, where it delivers: the datagram is for the apps' port.
    pub(crate) is_for_apps: bool,
    /// At the tc hook: it is one that may be answered, and discovery is the kernel's.
    pub(crate) may_converse: bool,
    pub(crate) burst: Burst,
}

/// This CPU's scratch space.
#[inline(always)]
pub(crate) fn scratch() -> Option<&'static mut Scratch> {
    // SAFETY: the programs take it once for each message, and do not interrupt each other.
    SCRATCH
        .get_ptr_mut(0)
        .map(|scratch| unsafe { &mut *scratch })
}

/// This CPU's exchange.
#[inline(always)]
pub(crate) fn exchange() -> Option<&'static mut Exchange> {
    // SAFETY: as for the scratch space.
    EXCHANGE
        .get_ptr_mut(0)
        .map(|exchange| unsafe { &mut *exchange })
}

/// Where this CPU keeps a frame while it is used for answers.
#[inline(always)]
pub(crate) fn reply() -> Option<&'static mut Reply> {
    // SAFETY: as for the scratch space.
    REPLY.get_ptr_mut(0).map(|reply| unsafe { &mut *reply })
}
