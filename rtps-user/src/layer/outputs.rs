//! What the layer wants done by who drives it.

use rtps_ebpf::SlotSet;

use super::protocol::FromLayer;
use super::store::StoreChange;
use crate::Transmit;
use crate::wire::{Guid, GuidPrefix};

/// One thing to do. They are to be done in the order in which they come.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerOutput {
    /// Send the datagram in the buffer that was given to `poll_output`. Multicast destinations mean: on every
    /// interface of the layer.
    Transmit(Transmit),
    /// Tell an app.
    Reply {
        /// The app.
        slot: u8,
        /// What.
        message: FromLayer,
    },
    /// Change what the low-level layer knows; the in-process layer ignores it.
    Kernel(KernelChange),
    /// Keep for a restart; the in-process layer ignores it.
    Store(StoreChange),
}

/// A wanted change of a kernel map.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum KernelChange {
    /// Undirected messages of this writer go to the rings of these apps from now on; of none: forget the writer.
    Route {
        /// The writer, remote or of an app of this host.
        writer: Guid,
        /// Apps with a matched reader.
        slots: SlotSet,
    },
    /// Note the time of each message of this remote participant.
    Peer(GuidPrefix),
    /// The remote participant is gone.
    ForgetPeer(GuidPrefix),
}
