//! The layer protocol: what an app and the layer that it uses say to each other.
//!
//! The same values travel whatever carries them: a Unix `SOCK_SEQPACKET` socket to rtpsd (one postcard-encoded
//! value a packet, descriptors beside [`FromLayer::Welcome`] and [`FromLayer::Channel`]) or a function call to the
//! in-process layer. Samples never take this way.

use std::net::SocketAddrV4;

use serde::{Deserialize, Serialize};

use crate::RemoteEndpoint;
use crate::discovery::ParticipantData;
use crate::qos::{ContentFilter, PolicyId, Qos};
use crate::wire::{EntityId, Guid, GuidPrefix};

/// Changes with every incompatible change of this file.
pub const LAYER_PROTOCOL_VERSION: u32 = 6;

/// The longest encoded value, in bytes; longer ones are refused before they are read.
pub const MAX_PROTOCOL_MESSAGE: usize = 128 * 1024;

/// The most bytes of USER_DATA of a participant, so that its announcement fits in one datagram.
pub const MAX_USER_DATA: usize = 256;

/// What an app says.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub enum ToLayer {
    /// The first message: who wants to use the layer.
    Hello(Hello),
    /// A new endpoint, or a declared one with changed policies.
    Declare(Box<Endpoint>),
    /// An endpoint is gone.
    Withdraw(EntityId),
    /// The app asserts the liveliness of its MANUAL_BY_PARTICIPANT writers.
    AssertLiveliness,
    /// The app often sends the same to these destinations, and asks for help.
    FanOut(FanOut),
    /// USER_DATA of the participant, at most [`MAX_USER_DATA`] bytes. On the wire all apps of the host are one
    /// participant: the app that has said so last speaks for all, as long as it is there.
    Describe(Vec<u8>),
    /// The app wants to know of all participants and endpoints, from now on: first of those that are there, endpoints
    /// after the given one.
    Browse {
        /// The last that the app has been told of, where it goes on.
        after: Option<Guid>,
    },
}

/// What the layer says.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub enum FromLayer {
    /// The answer to a hello.
    Welcome(Welcome),
    /// The hello, or a declaration, was refused, with a sentence for the user.
    Refused {
        /// Why, and what can be done.
        reason: String,
    },
    /// A local endpoint has a new remote one, or the policies or locators of a matched one changed.
    Matched {
        /// The app's endpoint.
        local: EntityId,
        /// The other one; it may be of another app of the same layer.
        remote: Box<RemoteEndpoint>,
    },
    /// A match is over.
    Unmatched {
        /// The app's endpoint.
        local: EntityId,
        /// The other one.
        remote: Guid,
    },
    /// Topic and type fit, but a policy does not.
    IncompatibleQos {
        /// The app's endpoint.
        local: EntityId,
        /// The other one.
        remote: Guid,
        /// The first policy that does not fit.
        policy: PolicyId,
    },
    /// Topic names are the same, but the types' names are not.
    InconsistentTopic {
        /// The app's endpoint.
        local: EntityId,
        /// The other one.
        remote: Guid,
    },
    /// A remote participant asserted the liveliness of its writers of one kind (RTPS 8.4.13).
    Liveliness {
        /// The participant.
        participant: GuidPrefix,
        /// Whether it was for MANUAL_BY_PARTICIPANT writers; else for AUTOMATIC ones.
        manual: bool,
    },
    /// The app is connected by shared memory with another one of this host, which is at the slot's
    /// [`local::address`](crate::local::address) from now on. Takes the place of an earlier channel with the same app.
    /// Comes before the matches that need it.
    Channel {
        /// The other app.
        slot: u8,
    },
    /// The other app of a channel is gone.
    ChannelClosed {
        /// The other app.
        slot: u8,
    },
    /// The answer to [`ToLayer::FanOut`], and told again when it changes.
    FanOut {
        /// The list's number.
        number: u8,
        /// Those of its destinations that get what the app sends to the list; the rest, or all, are left to the app.
        destinations: Vec<SocketAddrV4>,
    },
    /// For an app that browses.
    Discovered(Discovered),
}

/// What an app is told that wants to know of all participants and endpoints (DDS 1.4 section 2.2.5). Its own endpoints
/// are not among them.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub enum Discovered {
    /// What follows is all that there is: what was told before is void.
    Begin,
    /// A remote participant, new or changed.
    Participant(Box<ParticipantData>),
    /// A remote participant is gone.
    ParticipantGone(GuidPrefix),
    /// An endpoint of a remote participant or of another app of the same layer, new or changed.
    Endpoint(Box<RemoteEndpoint>),
    /// An endpoint is gone.
    EndpointGone(Guid),
    /// There are more endpoints after this one, to be asked for.
    More(Guid),
    /// These were all.
    Complete,
}

/// How many descriptors come beside a [`FromLayer::Channel`]: the ring that the app fills, the pipe that wakes the other
/// app, the ring that the other app fills, the pipe that wakes this one.
pub const CHANNEL_DESCRIPTORS: usize = 4;

/// Who wants to use the layer.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Hello {
    /// [`LAYER_PROTOCOL_VERSION`] of the app.
    pub version: u32,
    /// The DDS domain.
    pub domain: u32,
    /// The app's name, for people who look at the layer's status.
    pub name: String,
    /// The UDP port of the app's own socket, which serves as doorbell; 0 without.
    pub doorbell_port: u16,
    /// How large a ring the app wants, in bytes; rounded and capped by the layer.
    pub ring_bytes: u32,
    /// The slot that the app had before the layer's process was restarted.
    pub resume: Option<Resume>,
}

/// Proves that a slot is the app's own.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Resume {
    /// The slot.
    pub slot: u8,
    /// What the welcome said.
    pub token: [u8; 16],
}

/// The layer takes the app.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Welcome {
    /// The app's number: the first byte of the keys of its entities.
    pub slot: u8,
    /// To be shown when the app comes back after a restart of the layer.
    pub token: [u8; 16],
    /// The GUID prefix of the host's participant, which the app's entities belong to.
    pub prefix: GuidPrefix,
    /// The most bytes of UDP payload that the app should send in one datagram, so that none is fragmented.
    pub datagram_size: u16,
}

/// A list of destinations.
#[derive(Clone, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct FanOut {
    /// The cookie (SO_COOKIE) of the socket that the app will send to the list from, the same for all of its lists.
    pub cookie: u64,
    /// From 1; what was the list of this number is forgotten.
    pub number: u8,
    /// Where what is sent to the list is to go.
    pub destinations: Vec<SocketAddrV4>,
}

/// An endpoint of an app.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Endpoint {
    /// Its id; the first byte of the key is the app's slot, and the kind says writer or reader, with key or not.
    pub entity: EntityId,
    /// The topic's name.
    pub topic: String,
    /// The registered name of the topic's type.
    pub type_name: String,
    /// TypeInformation of the type, serialized (XTypes 1.3 section 7.6.3.2.1); may be empty.
    pub type_information: Vec<u8>,
    /// TypeMapping of the type, serialized: the TypeObjects that the TypeInformation names. The layer serves them to
    /// others, and does not tell them again.
    pub type_objects: Vec<u8>,
    /// What a reader wants of the topic, if not all.
    pub content_filter: Option<ContentFilter>,
    /// Its policies.
    pub qos: Qos,
}
