//! What discovery tells who uses it.

use crate::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};
use crate::xtypes::TypeHash;
use crate::xtypes::lookup::Request;

/// Something has happened.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum DiscoveryEvent {
    /// A remote participant is there, or what it says of itself has changed.
    ParticipantFound {
        /// The participant.
        prefix: GuidPrefix,
        /// It was not known before.
        is_new: bool,
    },
    /// A remote participant has gone, and its endpoints with it.
    ParticipantLost {
        /// The participant.
        prefix: GuidPrefix,
        /// Its endpoints.
        endpoints: Vec<Guid>,
    },
    /// A remote endpoint is there, or what it says of itself has changed.
    EndpointFound(Guid),
    /// A remote endpoint has gone.
    EndpointLost(Guid),
    /// A remote participant asserted that its AUTOMATIC or MANUAL_BY_PARTICIPANT writers are alive.
    Liveliness {
        /// The participant.
        participant: GuidPrefix,
        /// The latter.
        manual: bool,
    },
    /// A remote participant asks for types: to be answered by
    /// [`reply_to_lookup`](super::Discovery::reply_to_lookup).
    TypesRequested(Box<Request>),
    /// TypeObjects that were asked for, serialized, with the hashes that they are said to have.
    TypesFound(Vec<(TypeHash, Vec<u8>)>),
    /// We asserted the same of our own, with a sample of that number.
    Asserted {
        /// The number.
        sequence: SequenceNumber,
        /// For MANUAL_BY_PARTICIPANT writers.
        manual: bool,
    },
    /// Everything below this number has been received of a remote built-in writer.
    Progress {
        /// The writer.
        writer: Guid,
        /// The number.
        next: SequenceNumber,
    },
    /// The same, where the low-level layer does not know it.
    Overtaken {
        /// The writer.
        writer: Guid,
        /// The number.
        next: SequenceNumber,
    },
    /// The low-level layer knows a participant that is not known here: it has to make itself known again.
    Disowned(GuidPrefix),
    /// Everybody knows that an endpoint of ours was withdrawn.
    WithdrawalDone {
        /// The built-in writer that said so.
        announcer: EntityId,
        /// With this sample.
        sequence: SequenceNumber,
    },
}

/// Counts of what was not taken.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Refused {
    /// Announcements of participants that the table had no room for.
    pub participants: u64,
    /// Endpoints that the table had no room for.
    pub endpoints: u64,
    /// Discovery samples that could not be read.
    pub malformed: u64,
    /// Submessages that came from an address that is not their participant's.
    pub foreign: u64,
}
