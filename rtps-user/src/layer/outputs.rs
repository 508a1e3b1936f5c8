//! What the layer wants done by who drives it.

use std::net::IpAddr;

use rtps_ebpf::SlotSet;

use super::protocol::{FanOut, FromLayer};
use super::store::StoreChange;
use crate::Transmit;
use crate::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};

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
    /// Make a channel between the apps in these slots, and tell each of the other's by [`FromLayer::Channel`]; where
    /// that fails, call [`Layer::refuse_channel`](super::Layer::refuse_channel). Comes only with
    /// [`channels`](super::LayerConfig::channels).
    Channel([u8; 2]),
    /// Change what the low-level layer knows; the in-process layer ignores it.
    Kernel(KernelChange),
    /// Keep for a restart; the in-process layer ignores it.
    Store(StoreChange),
}

/// A wanted change of a kernel map.
///
/// Of discovery it says what the low-level layer needs to answer by itself, and only where the layer is started with
/// [`kernel_discovery`](super::LayerConfig::kernel_discovery).
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum KernelChange {
    /// Undirected messages of this writer go to the rings of these apps from now on; of none: forget the writer.
    Route {
        /// The writer, remote or of an app of this host.
        writer: Guid,
        /// Apps with a matched reader.
        slots: SlotSet,
    },
    /// Note the time of each message of this remote participant, and keep what else is known of it. Said again when
    /// something has changed. Where the low-level layer answers, a participant counts once it is proven.
    Peer {
        /// The participant.
        prefix: GuidPrefix,
        /// Where its datagrams may come from; empty where that is not checked.
        addresses: Vec<IpAddr>,
        /// An app waits for signs of life of one of its writers: its participant messages are wanted.
        supervised: bool,
    },
    /// The remote participant is gone, or has to make itself known again.
    ForgetPeer(GuidPrefix),
    /// Answer the announcements of unknown participants with this: INFO_TS and DATA(p). Empty where the layer has to
    /// answer.
    Announcement(Vec<u8>),
    /// Keep a sample of a built-in writer of ours for those that ask for it.
    Sample {
        /// The writer.
        writer: EntityId,
        /// The sample's number.
        sequence: SequenceNumber,
        /// Its source timestamp as it stands in a little-endian INFO_TS.
        timestamp: [u8; 8],
        /// The DATA, for the topic's built-in reader. Empty where it fits no datagram, so that the layer has to send
        /// it.
        submessage: Vec<u8>,
    },
    /// The sample is gone.
    ForgetSample {
        /// The writer.
        writer: EntityId,
        /// The sample's number.
        sequence: SequenceNumber,
    },
    /// What HEARTBEATs of a built-in writer of ours say. Comes after the samples, and before they are sent.
    Available {
        /// The writer.
        writer: EntityId,
        /// The first number; one above `last` where there is no sample.
        first: SequenceNumber,
        /// The last number; 0 before the first sample.
        last: SequenceNumber,
    },
    /// All samples of a remote built-in writer below `next` are dealt with.
    Progress {
        /// The writer.
        writer: Guid,
        /// The number.
        next: SequenceNumber,
        /// Go on from there even where the low-level layer has got further: what it took is not known here.
        exact: bool,
    },
    /// Send to all of these destinations what an app sends to its list, and tell the app to which
    /// ([`FromLayer::FanOut`]).
    FanOut {
        /// The app.
        slot: u8,
        /// The list.
        fan_out: FanOut,
    },
}
