//! What the exchange looks up.

use crate::abi::{Announcement, BuiltinWriter, SUBMESSAGE_BYTES, Sample};

/// What the host has to say in the domain of the message: maps in the kernel, anything in user space.
pub trait World {
    /// A built-in writer of ours, by its number.
    fn writer(&self, writer: u32) -> Option<&BuiltinWriter>;

    /// A sample of that writer.
    fn sample(&self, writer: u32, sequence: u64) -> Option<&Sample>;

    /// The announcement of our participant.
    fn announcement(&self) -> Option<&Announcement>;

    /// Copies submessages. The kernel needs a helper for that many bytes.
    #[inline(always)]
    fn copy(&self, from: &[u8; SUBMESSAGE_BYTES], to: &mut [u8; SUBMESSAGE_BYTES]) {
        *to = *from;
    }
}
