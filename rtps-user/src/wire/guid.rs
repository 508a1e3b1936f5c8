//! Who is who: GUID prefix, entity id, vendor id (RTPS 2.5 sections 8.2.4 and 9.3.1).

use std::fmt;
use std::hash::{Hash, Hasher};

use serde::{Deserialize, Serialize};

/// The first 12 bytes of every GUID of one participant.
#[derive(
    Clone, Copy, Debug, Default, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize,
)]
pub struct GuidPrefix(pub [u8; 12]);

impl GuidPrefix {
    /// GUIDPREFIX_UNKNOWN: nobody in particular.
    pub const UNKNOWN: Self = Self([0; 12]);
}

/// Which entity of a participant: a key of 3 bytes and a kind (RTPS 9.3.1.2).
///
/// For entities of apps the first byte of the key is the app's slot, by which the low-level layer routes.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub struct EntityId(pub [u8; 4]);

/// One word, for hashers to deal with at once.
impl Hash for EntityId {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u32(u32::from_ne_bytes(self.0));
    }
}

/// The kind of an entity that an app can create: the last byte of its [`EntityId`] (RTPS table 9.1).
#[derive(Clone, Copy, Debug, Deserialize, Eq, Hash, PartialEq, Serialize)]
pub enum EntityKind {
    /// A writer of a topic with keys, 0x02.
    WriterWithKey,
    /// A writer of a topic without key, 0x03.
    WriterNoKey,
    /// A reader of a topic without key, 0x04.
    ReaderNoKey,
    /// A reader of a topic with keys, 0x07.
    ReaderWithKey,
}

impl EntityKind {
    fn octet(self) -> u8 {
        match self {
            Self::WriterWithKey => 0x02,
            Self::WriterNoKey => 0x03,
            Self::ReaderNoKey => 0x04,
            Self::ReaderWithKey => 0x07,
        }
    }
}

impl EntityId {
    /// ENTITYID_UNKNOWN: every entity that it concerns.
    pub const UNKNOWN: Self = Self([0, 0, 0, 0]);
    /// The participant itself.
    pub const PARTICIPANT: Self = Self([0, 0, 1, 0xc1]);
    /// SPDPbuiltinParticipantWriter.
    pub const SPDP_WRITER: Self = Self([0, 1, 0, 0xc2]);
    /// SPDPbuiltinParticipantReader.
    pub const SPDP_READER: Self = Self([0, 1, 0, 0xc7]);
    /// SEDPbuiltinPublicationsWriter.
    pub const SEDP_PUBLICATIONS_WRITER: Self = Self([0, 0, 3, 0xc2]);
    /// SEDPbuiltinPublicationsReader.
    pub const SEDP_PUBLICATIONS_READER: Self = Self([0, 0, 3, 0xc7]);
    /// SEDPbuiltinSubscriptionsWriter.
    pub const SEDP_SUBSCRIPTIONS_WRITER: Self = Self([0, 0, 4, 0xc2]);
    /// SEDPbuiltinSubscriptionsReader.
    pub const SEDP_SUBSCRIPTIONS_READER: Self = Self([0, 0, 4, 0xc7]);
    /// BuiltinParticipantMessageWriter.
    pub const PARTICIPANT_MESSAGE_WRITER: Self = Self([0, 2, 0, 0xc2]);
    /// BuiltinParticipantMessageReader.
    pub const PARTICIPANT_MESSAGE_READER: Self = Self([0, 2, 0, 0xc7]);

    /// TypeLookupServiceRequestDataWriter.
    pub const TYPE_LOOKUP_REQUEST_WRITER: Self = Self([0, 3, 0, 0xc3]);
    /// TypeLookupServiceRequestDataReader.
    pub const TYPE_LOOKUP_REQUEST_READER: Self = Self([0, 3, 0, 0xc4]);
    /// TypeLookupServiceReplyDataWriter.
    pub const TYPE_LOOKUP_REPLY_WRITER: Self = Self([0, 3, 1, 0xc3]);
    /// TypeLookupServiceReplyDataReader.
    pub const TYPE_LOOKUP_REPLY_READER: Self = Self([0, 3, 1, 0xc4]);

    /// The `serial`-th entity of the app in `slot`.
    pub fn of_app(slot: u8, serial: u16, kind: EntityKind) -> Self {
        let [high, low] = serial.to_be_bytes();
        Self([slot, high, low, kind.octet()])
    }

    /// The app that the entity belongs to; 0 for the layer's own.
    pub fn slot(self) -> u8 {
        self.0[0]
    }

    /// Whether the standard defines the entity (kind bits 0xc0).
    pub fn is_builtin(self) -> bool {
        self.0[3] & 0xc0 == 0xc0
    }

    /// The readers that are concerned by what a writer has for all: of a built-in topic all have one id, which differs from
    /// the writer's in its kind (RTPS 2.5 section 9.3.1.3, table 9.5); those of other topics are not known.
    pub fn readers_of_all(self) -> Self {
        let [a, b, c, kind] = self.0;
        match kind {
            0xc2 => Self([a, b, c, 0xc7]),
            0xc3 => Self([a, b, c, 0xc4]),
            _ => Self::UNKNOWN,
        }
    }

    /// Whether the entity is a writer, of whatever origin.
    pub fn is_writer(self) -> bool {
        matches!(self.0[3] & 0x3f, 0x02 | 0x03)
    }

    /// Whether the entity is a reader, of whatever origin.
    pub fn is_reader(self) -> bool {
        matches!(self.0[3] & 0x3f, 0x04 | 0x07)
    }

    /// Whether the entity's topic has keys.
    pub fn has_key(self) -> bool {
        matches!(self.0[3] & 0x3f, 0x02 | 0x07)
    }
}

/// A globally unique entity name: the participant and one of its entities.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub struct Guid {
    /// The participant.
    pub prefix: GuidPrefix,
    /// The entity in it.
    pub entity: EntityId,
}

/// All 16 bytes at once.
impl Hash for Guid {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let mut bytes = [0; 16];
        bytes[..12].copy_from_slice(&self.prefix.0);
        bytes[12..].copy_from_slice(&self.entity.0);
        state.write_u128(u128::from_ne_bytes(bytes));
    }
}

impl Guid {
    /// GUID_UNKNOWN.
    pub const UNKNOWN: Self = Self {
        prefix: GuidPrefix::UNKNOWN,
        entity: EntityId::UNKNOWN,
    };

    /// Joins the two parts.
    pub fn new(prefix: GuidPrefix, entity: EntityId) -> Self {
        Self { prefix, entity }
    }

    /// The 16 bytes as they stand on the wire.
    pub fn to_bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..12].copy_from_slice(&self.prefix.0);
        bytes[12..].copy_from_slice(&self.entity.0);
        bytes
    }

    /// Reads what [`to_bytes`](Self::to_bytes) wrote.
    pub fn from_bytes(bytes: [u8; 16]) -> Self {
        let [p @ .., a, b, c, d] = bytes;
        Self {
            prefix: GuidPrefix(p),
            entity: EntityId([a, b, c, d]),
        }
    }
}

fn write_hex(f: &mut fmt::Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
}

impl fmt::Display for GuidPrefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_hex(f, &self.0)
    }
}

impl fmt::Display for EntityId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_hex(f, &self.0)
    }
}

impl fmt::Display for Guid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.prefix, self.entity)
    }
}

/// Who wrote the implementation that sent a message (assigned by the OMG).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct VendorId(pub [u8; 2]);

impl VendorId {
    /// VENDORID_UNKNOWN; we have no number of our own yet.
    pub const UNKNOWN: Self = Self([0, 0]);
    /// Eclipse Cyclone DDS.
    pub const CYCLONE_DDS: Self = Self([1, 16]);
}
