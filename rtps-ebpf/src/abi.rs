//! What kernel and user space share: map names, keys, values, and the records in the rings.
//!
//! All structs are `repr(C)` without padding. Integers are in the host's byte order, except for
//! addresses and GUIDs, which are byte arrays in network order. Who writes which map stands in
//! `docs/abi.md`. A change of anything here raises [`ABI_VERSION`], which is part of the name of
//! the folder where maps and programs are pinned, so that two versions never share a map.

mod discovery;
mod fan_out;

pub use discovery::{
    Announcement, AnnouncementKey, BUDGET_ALL, BUDGET_NEW, BUDGET_NEWS, BUDGET_STRANGERS, BUDGETS,
    BUILTIN_WRITERS, BuiltinWriter, INTERFACE_ANSWERS, INTERFACE_DELIVERS, Interface,
    PARTICIPANT_MESSAGES, PEER_ADDRESSES, PEER_ANY_ADDRESS, PEER_PROVEN, PEER_SUPERVISED,
    PUBLICATIONS, Peer, RemoteReader, RemoteWriter, SUBMESSAGE_BYTES, SUBSCRIPTIONS, Sample,
    SampleKey, WRITER_FRAGMENTED, WRITER_INCOMPLETE,
};
pub use fan_out::{
    Destination, FAN_OUT_ADDRESS, FAN_OUT_DESTINATIONS, FAN_OUTS, FAN_OUTS_PER_APP, FanOut,
    FanOutKey, Sender,
};

use crate::entity::GuidPrefix;

/// The version of everything in this module.
pub const ABI_VERSION: u32 = 7;

/// Names of maps and programs, the same in the object and under the pin folder.
pub mod name {
    /// `Array[1]` of [`Config`](super::Config).
    pub const CONFIG: &str = "config";
    /// `Array[DOMAINS]` of [`Domain`](super::Domain).
    pub const DOMAINS: &str = "domains";
    /// `Array[PORTS]` of [`PortConfig`](super::PortConfig), by UDP port: each UDP datagram of the host is looked up here.
    pub const PORTS: &str = "ports";
    /// `Hash` from this host's own unicast addresses (16 bytes, IPv4 mapped) to `u32` (any value).
    pub const ADDRESSES: &str = "addresses";
    /// `Hash` from writer [`Guid`](crate::entity::Guid) to [`SlotSet`](crate::SlotSet).
    pub const ROUTES: &str = "routes";
    /// `Array[SLOTS]` of [`App`](super::App).
    pub const APPS: &str = "apps";
    /// `ArrayOfMaps[SLOTS]`; each inner map is an mmapable `Array[1]` of [`Bell`](super::Bell).
    pub const BELLS: &str = "bells";
    /// `ArrayOfMaps[SLOTS]`; each inner map is a ring buffer of any size.
    pub const RINGS: &str = "rings";
    /// `Hash` from [`GuidPrefix`](crate::entity::GuidPrefix) to [`Peer`](super::Peer): the remote
    /// participants that rtpsd has accepted.
    pub const PEERS: &str = "peers";
    /// `LruHash` of the same shape: those that only the kernel knows, so that a flood of inventions
    /// pushes out nothing but inventions.
    pub const STRANGERS: &str = "strangers";
    /// `LruHash` from source address (16 bytes, IPv4 mapped) to the time (`u64`) until which its
    /// budget of strangers is spent.
    pub const SOURCES: &str = "sources";
    /// `Array[BUDGETS]` of `u64`: until when each common budget is spent.
    pub const BUDGETS: &str = "budgets";
    /// `Hash` from interface index (`u32`) to [`Interface`](super::Interface): where the kernel may
    /// answer.
    pub const INTERFACES: &str = "interfaces";
    /// `Hash` from [`AnnouncementKey`](super::AnnouncementKey) to [`Announcement`](super::Announcement).
    pub const ANNOUNCEMENTS: &str = "announcements";
    /// `Array[DOMAINS * BUILTIN_WRITERS]` of [`BuiltinWriter`](super::BuiltinWriter).
    pub const WRITERS: &str = "writers";
    /// `Hash` from [`SampleKey`](super::SampleKey) to [`Sample`](super::Sample).
    pub const SAMPLES: &str = "samples";
    /// `Hash` from socket cookie (`u64`) to [`Sender`](super::Sender).
    pub const SENDERS: &str = "senders";
    /// `Hash` from [`FanOutKey`](super::FanOutKey) to [`FanOut`](super::FanOut).
    pub const FAN_OUTS: &str = "fan_outs";
    /// `RingBuf`: what rtpsd has to know of discovery, as records like those of the apps' rings.
    pub const NEWS: &str = "news";
    /// `PerCpuHash` from interface index (`u32`) to `[u64; Counter::COUNT]`; key 0 takes the rest.
    pub const COUNTERS: &str = "counters";
    /// Every map, in the order above.
    pub const MAPS: [&str; 20] = [
        CONFIG,
        DOMAINS,
        PORTS,
        ADDRESSES,
        ROUTES,
        APPS,
        BELLS,
        RINGS,
        PEERS,
        STRANGERS,
        SOURCES,
        BUDGETS,
        INTERFACES,
        ANNOUNCEMENTS,
        WRITERS,
        SAMPLES,
        SENDERS,
        FAN_OUTS,
        NEWS,
        COUNTERS,
    ];
    /// The XDP program.
    pub const XDP_PROGRAM: &str = "rtps_xdp";
    /// The filter for the layer's own UDP sockets.
    pub const FILTER_PROGRAM: &str = "rtps_filter";
    /// The tc program on ingress, which decides on discovery messages and answers them.
    pub const INGRESS_PROGRAM: &str = "rtps_ingress";
    /// The tc program on egress of the loopback interface, which sends to several destinations what an app sends
    /// once.
    pub const FAN_OUT_PROGRAM: &str = "rtps_fan_out";
}

/// Slots of apps; slot 0 stands for rtpsd and the built-in entities.
pub const SLOTS: u32 = 256;
/// RTPS domains that one layer serves at the same time.
pub const DOMAINS: u32 = 16;
/// UDP ports in the `ports` map: all that there are.
pub const PORTS: u32 = 1 << 16;
/// Own addresses in the `addresses` map.
pub const ADDRESSES: u32 = 1024;
/// Remote writers in the `routes` map.
pub const ROUTES: u32 = 65_536;
/// Remote participants in the `peers` map.
pub const PEERS: u32 = 8_192;
/// Participants that only the kernel knows.
pub const STRANGERS: u32 = 4_096;
/// Addresses that strangers come from.
pub const SOURCES: u32 = 4_096;
/// Interfaces with counters of their own, and interfaces where the kernel may answer.
pub const INTERFACES: u32 = 64;
/// Announcements: one for each domain and interface.
pub const ANNOUNCEMENTS: u32 = DOMAINS * INTERFACES;
/// Samples of the built-in writers of all domains.
pub const SAMPLES: u32 = 65_536;
/// Bytes of the ring with the news for rtpsd.
pub const NEWS_BYTES: usize = 4 << 20;
/// Submessages that the layer looks at in one message. A datagram has room for some 16,000 empty
/// ones; real senders pack a few hundred.
pub const MAX_SUBMESSAGES: u32 = 4_096;

/// The first bytes of every ring record; the RTPS message follows at once, then unused bytes up
/// to the record's size, which is one of a few constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordHeader {
    /// Length of the RTPS message in bytes, or of all of them.
    pub message_len: u32,
    /// Index of the interface that the message came in on.
    pub ifindex: u32,
    /// Index into `domains`, not the domain id.
    pub domain_index: u16,
    /// Where the record holds several messages that came together: the length of each but the last, which may be
    /// shorter. 0 where it holds one.
    pub segment: u16,
    /// Who delivered: [`HOOK_XDP`], [`HOOK_FILTER`] or [`HOOK_INGRESS`].
    pub hook: u8,
    /// [`RECORD_ANSWERED`] or 0.
    pub flags: u8,
    /// UDP port that the message came from.
    pub source_port: u16,
    /// Address that the message came from, IPv4 as `::ffff:a.b.c.d`.
    pub source_address: [u8; 16],
    /// CLOCK_MONOTONIC, in nanoseconds, when the kernel handled the message.
    pub received_ns: u64,
}

/// [`RecordHeader::hook`]: delivered by the XDP program.
pub const HOOK_XDP: u8 = 1;
/// [`RecordHeader::hook`]: delivered by the socket filter.
pub const HOOK_FILTER: u8 = 2;
/// [`RecordHeader::hook`]: delivered by the tc program on ingress.
pub const HOOK_INGRESS: u8 = 3;

/// [`RecordHeader::flags`]: the kernel has answered what the message asks of the built-in endpoints
/// (HEARTBEAT, ACKNACK, the announcement of an unknown participant), or need not.
pub const RECORD_ANSWERED: u8 = 1;

/// `config`: first written by rtpsd when everything else is in place, then now and then as a sign of
/// its life. The programs leave every packet alone until it holds their own version.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Config {
    /// [`ABI_VERSION`].
    pub abi_version: u32,
    /// [`DOORBELL_RING`] or [`DOORBELL_PACKET`].
    pub doorbell: u32,
    /// [`DISCOVERY_USER`] or [`DISCOVERY_KERNEL`].
    pub discovery: u32,
    /// Not 0: what names a known participant as its sender is taken from any address.
    pub any_source: u32,
    /// CLOCK_MONOTONIC, in nanoseconds, until when the kernel may answer in rtpsd's name: half a
    /// lease after rtpsd's last sign of life, for a dead host must not look alive.
    pub answer_until_ns: u64,
}

/// [`Config::discovery`]: rtpsd reads all discovery messages from its sockets, and answers them.
pub const DISCOVERY_USER: u32 = 0;
/// [`Config::discovery`]: the kernel keeps what is known, answers, and tells rtpsd the news.
pub const DISCOVERY_KERNEL: u32 = 1;

/// [`Config::doorbell`]: a sleeping app is always woken by its ring's own notification.
pub const DOORBELL_RING: u32 = 0;
/// [`Config::doorbell`]: XDP turns the datagram itself into the doorbell where it can, which
/// saves an inter-processor interrupt. Needs a firewall that lets it reach the apps' ports.
pub const DOORBELL_PACKET: u32 = 1;

/// `domains`: a domain that the layer serves.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Domain {
    /// The GUID prefix of this host's one participant in the domain.
    pub guid_prefix: GuidPrefix,
    /// The domain id.
    pub domain_id: u32,
    /// CLOCK_MONOTONIC, in nanoseconds, that counts in HEARTBEATs and ACKNACKs begin at.
    pub count_base_ns: u64,
    /// The most bytes of UDP payload in an answer.
    pub datagram_size: u32,
    /// The host's metatraffic unicast port, where answers come from.
    pub metatraffic_port: u32,
}

/// `ports`: what a UDP port is to the layer in this network namespace.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortConfig {
    /// Index into `domains`, not the domain id.
    pub domain_index: u16,
    /// [`PORT_FOREIGN`], [`PORT_UNICAST`], [`PORT_MULTICAST`] or [`PORT_METATRAFFIC`].
    pub kind: u16,
}

/// [`PortConfig::kind`]: the port is not the layer's.
pub const PORT_FOREIGN: u16 = 0;
/// [`PortConfig::kind`]: the port is the layer's alone, so XDP may take what is sent to it.
pub const PORT_UNICAST: u16 = 1;
/// [`PortConfig::kind`]: shared with other DDS stacks of this host; only the socket filter, which
/// sees the layer's own copy, acts on it.
pub const PORT_MULTICAST: u16 = 2;
/// [`PortConfig::kind`]: as [`PORT_UNICAST`], for discovery: XDP leaves it to the tc program.
pub const PORT_METATRAFFIC: u16 = 3;

/// `apps`: an attached app.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct App {
    /// [`APP_FREE`] or [`APP_ATTACHED`].
    pub state: u32,
    /// Index into `domains`; the app gets messages of this domain only.
    pub domain_index: u32,
    /// UDP port (host order) of the app's own socket, or 0 when it has none to ring at.
    pub doorbell_port: u32,
    /// Zero.
    pub reserved: u32,
}

/// [`App::state`]: the slot is free, nothing is delivered.
pub const APP_FREE: u32 = 0;
/// [`App::state`]: the slot's ring takes messages.
pub const APP_ATTACHED: u32 = 1;

/// An app's bell: a cache line that the app maps and writes, and that the kernel reads right
/// after it submitted a record.
///
/// Before it sleeps, the app stores 1, issues a sequentially consistent fence and looks at the
/// ring once more; awake again, it stores 0. The kernel's submit is a full barrier too, so either
/// the app sees the record or the kernel sees the 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bell {
    /// 1: the app sleeps or is about to.
    pub need_wakeup: u32,
    /// Zero; keeps the flag on a line of its own.
    pub reserved: [u32; 15],
}

const _: () = {
    assert!(size_of::<RecordHeader>() == 40 && align_of::<RecordHeader>() == 8);
    assert!(size_of::<Config>() == 24);
    assert!(size_of::<Domain>() == 32);
    assert!(size_of::<PortConfig>() == 4);
    assert!(size_of::<App>() == 16);
    assert!(size_of::<Bell>() == 64);
};

/// Sizes of ring records, header included: the verifier wants constants, so a message takes the
/// smallest that holds it. The last one holds the largest UDP datagram.
pub const RECORD_SIZES: [usize; 7] = [256, 512, 1024, 2048, 9216, 16_384, 66_560];

const _: () = assert!(RECORD_SIZES[6] >= size_of::<RecordHeader>() + 65_507 + 512);
