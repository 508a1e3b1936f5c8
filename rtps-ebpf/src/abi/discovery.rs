//! What the kernel answers discovery from: what it knows of remote participants, and what the host says
//! of itself.

/// The built-in writers of a participant that are reliable, and their number in `writers`,
/// [`SampleKey::writer`], [`Peer::writers`] and [`Peer::readers`].
pub const BUILTIN_WRITERS: u32 = 3;
/// SEDPbuiltinPublicationsWriter.
pub const PUBLICATIONS: u32 = 0;
/// SEDPbuiltinSubscriptionsWriter.
pub const SUBSCRIPTIONS: u32 = 1;
/// BuiltinParticipantMessageWriter.
pub const PARTICIPANT_MESSAGES: u32 = 2;

/// Addresses of one peer.
pub const PEER_ADDRESSES: usize = 8;

/// `peers`, `strangers`: a remote participant.
///
/// The kernel changes it in place. rtpsd inserts and removes peers, and replaces one as a whole when
/// what it owns changes (`addresses`, `flags`, [`RemoteWriter::next`]): what the kernel writes at the
/// same moment may be lost, which costs a repetition and no more.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Peer {
    /// CLOCK_MONOTONIC, in nanoseconds, of the last valid message that named this prefix as its
    /// sender and came from one of its addresses.
    pub last_seen_ns: u64,
    /// Hash of the last announcement that rtpsd was given; 0 for none.
    pub announcement_hash: u64,
    /// Until when its budget of answers is spent (CLOCK_MONOTONIC, nanoseconds).
    pub spent_until_ns: u64,
    /// Where its datagrams may come from, IPv4 mapped; unused ones are zero.
    pub addresses: [[u8; 16]; PEER_ADDRESSES],
    /// The port of the metatraffic unicast locator that it announces at the address that its
    /// announcement came from; 0 for none, so that the kernel cannot answer.
    pub reply_port: u32,
    /// [`PEER_SUPERVISED`], [`PEER_ANY_ADDRESS`], [`PEER_PROVEN`].
    pub flags: u32,
    /// Its built-in writers.
    pub writers: [RemoteWriter; BUILTIN_WRITERS as usize],
    /// Its built-in readers.
    pub readers: [RemoteReader; BUILTIN_WRITERS as usize],
}

/// [`Peer::flags`]: rtpsd wants its participant messages, because an app waits for signs of life.
pub const PEER_SUPERVISED: u32 = 1;
/// [`Peer::flags`]: it has more addresses than fit; the kernel does not check them.
pub const PEER_ANY_ADDRESS: u32 = 1 << 1;
/// [`Peer::flags`]: it has sent something directed at us, and rtpsd was told.
pub const PEER_PROVEN: u32 = 1 << 2;

/// What a built-in reader of ours knows of its remote writer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RemoteWriter {
    /// All below has been handed to rtpsd, or will not come; at least 1.
    pub next: u64,
    /// Of the last ACKNACK.
    pub acknack_count: u32,
    /// [`WRITER_FRAGMENTED`] or 0.
    pub flags: u32,
}

/// [`RemoteWriter::flags`]: a sample comes in fragments, which rtpsd collects; until it has set
/// `next` beyond, the kernel leaves the writer's HEARTBEATs to it.
pub const WRITER_FRAGMENTED: u32 = 1;

/// What a built-in writer of ours knows of its remote reader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RemoteReader {
    /// Base of its last ACKNACK: it has all below.
    pub acknowledged: u64,
    /// All from `sent_from` to below `sent_to` was sent at `sent_ns`: what is asked for again within a moment is
    /// on its way.
    pub sent_from: u64,
    /// See `sent_from`.
    pub sent_to: u64,
    /// CLOCK_MONOTONIC, in nanoseconds.
    pub sent_ns: u64,
    /// Of the last HEARTBEAT of the kernel.
    pub heartbeat_count: u32,
    /// Zero.
    pub reserved: u32,
}

/// In [`Interface::tasks`]: the tc program answers discovery messages.
pub const INTERFACE_ANSWERS: u16 = 1;
/// In [`Interface::tasks`]: the tc program delivers to apps, as there is no XDP.
pub const INTERFACE_DELIVERS: u16 = 2;

/// `interfaces`: who the host is on an Ethernet, and what the tc program does there.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Its hardware address.
    pub mac: [u8; 6],
    /// [`INTERFACE_ANSWERS`] and [`INTERFACE_DELIVERS`], or 0.
    pub tasks: u16,
    /// Source of answers over IPv4; zero for none.
    pub ipv4: [u8; 4],
    /// Source of answers to global and unique local IPv6 addresses; zero for none.
    pub ipv6: [u8; 16],
    /// Source of answers to link-local IPv6 addresses; zero for none.
    pub ipv6_link_local: [u8; 16],
}

/// Bytes of submessages in an [`Announcement`] or a [`Sample`].
pub const SUBMESSAGE_BYTES: usize = 1_408;

/// Key of `announcements`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct AnnouncementKey {
    /// Index into `domains`.
    pub domain_index: u32,
    /// Of the interface that it is asked for on: each hears the addresses first that can be reached on it.
    pub ifindex: u32,
}

/// `announcements`: what the host says of its participant on one interface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Announcement {
    /// INFO_TS and DATA(p), ready to be sent.
    pub bytes: [u8; SUBMESSAGE_BYTES],
    /// How many of them; a multiple of 4. 0: rtpsd has to answer.
    pub len: u32,
    /// Zero.
    pub reserved: u32,
}

/// `writers`: a reliable built-in writer of ours; the index is `domain_index * BUILTIN_WRITERS` and
/// its number.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuiltinWriter {
    /// The first sequence number for HEARTBEATs; `last + 1` when there is no sample.
    pub first: u64,
    /// The last one; 0 before the first sample. What lies between and is not in `samples` is gone.
    pub last: u64,
    /// [`WRITER_INCOMPLETE`] or 0.
    pub flags: u32,
    /// Zero.
    pub reserved: u32,
}

/// [`BuiltinWriter::flags`]: `samples` has no room for all; rtpsd has to answer.
pub const WRITER_INCOMPLETE: u32 = 1;

/// Key of `samples`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SampleKey {
    /// Index into `domains`.
    pub domain_index: u32,
    /// [`PUBLICATIONS`], [`SUBSCRIPTIONS`] or [`PARTICIPANT_MESSAGES`].
    pub writer: u32,
    /// The sequence number.
    pub sequence: u64,
}

/// `samples`: a sample of a built-in writer of ours.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// The DATA, ready to be sent to any participant: its readerId is the topic's built-in reader.
    pub bytes: [u8; SUBMESSAGE_BYTES],
    /// How many of them; a multiple of 4. 0: it does not fit, rtpsd has to send it.
    pub len: u32,
    /// Zero.
    pub reserved: u32,
    /// Its source timestamp as in INFO_TS, little-endian.
    pub timestamp: [u8; 8],
}

/// Budgets in `budgets`.
pub const BUDGETS: u32 = 4;
/// Bytes of all answers.
pub const BUDGET_ALL: u32 = 0;
/// Bytes of answers to strangers.
pub const BUDGET_STRANGERS: u32 = 1;
/// Strangers that are remembered, told and answered.
pub const BUDGET_NEW: u32 = 2;
/// Messages of strangers that rtpsd is given.
pub const BUDGET_NEWS: u32 = 3;

const _: () = {
    assert!(size_of::<RemoteWriter>() == 16);
    assert!(size_of::<RemoteReader>() == 40);
    assert!(size_of::<Peer>() == 328);
    assert!(size_of::<Interface>() == 44);
    assert!(size_of::<AnnouncementKey>() == 8);
    assert!(size_of::<Announcement>() == 1_416);
    assert!(size_of::<BuiltinWriter>() == 24);
    assert!(size_of::<SampleKey>() == 16);
    assert!(size_of::<Sample>() == 1_424);
};
