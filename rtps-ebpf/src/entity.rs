//! GUIDs and entity ids as they stand on the wire (RTPS 2.5, 9.3.1).

use crate::abi::{PARTICIPANT_MESSAGES, PUBLICATIONS, SUBSCRIPTIONS};

/// The 12 bytes that all entities of one participant share.
pub type GuidPrefix = [u8; 12];

/// entityKey (3 bytes) and entityKind (1 byte).
pub type EntityId = [u8; 4];

/// GUID prefix and entity id; the key of the route map.
pub type Guid = [u8; 16];

/// No entity in particular: every matched one.
pub const ENTITY_ID_UNKNOWN: EntityId = [0; 4];

/// SPDPbuiltinParticipantWriter.
pub const SPDP_WRITER: EntityId = [0, 1, 0, 0xc2];
/// SEDPbuiltinPublicationsWriter.
pub const SEDP_PUBLICATIONS_WRITER: EntityId = [0, 0, 3, 0xc2];
/// SEDPbuiltinPublicationsReader.
pub const SEDP_PUBLICATIONS_READER: EntityId = [0, 0, 3, 0xc7];
/// SEDPbuiltinSubscriptionsWriter.
pub const SEDP_SUBSCRIPTIONS_WRITER: EntityId = [0, 0, 4, 0xc2];
/// SEDPbuiltinSubscriptionsReader.
pub const SEDP_SUBSCRIPTIONS_READER: EntityId = [0, 0, 4, 0xc7];
/// BuiltinParticipantMessageWriter.
pub const PARTICIPANT_MESSAGE_WRITER: EntityId = [0, 2, 0, 0xc2];
/// BuiltinParticipantMessageReader.
pub const PARTICIPANT_MESSAGE_READER: EntityId = [0, 2, 0, 0xc7];

/// Whether it is a writer of the TypeLookup service, of requests or replies (XTypes 1.3 section 7.6.3.3.4).
#[inline(always)]
pub const fn is_type_lookup_writer(entity: EntityId) -> bool {
    matches!(entity, [0, 3, 0 | 1, 0xc3])
}

/// The number of a reliable built-in writer.
#[inline(always)]
pub const fn builtin_writer(entity: EntityId) -> Option<u32> {
    match entity {
        SEDP_PUBLICATIONS_WRITER => Some(PUBLICATIONS),
        SEDP_SUBSCRIPTIONS_WRITER => Some(SUBSCRIPTIONS),
        PARTICIPANT_MESSAGE_WRITER => Some(PARTICIPANT_MESSAGES),
        _ => None,
    }
}

/// The number of the writer whose topic a built-in reader reads.
#[inline(always)]
pub const fn builtin_reader(entity: EntityId) -> Option<u32> {
    match entity {
        SEDP_PUBLICATIONS_READER => Some(PUBLICATIONS),
        SEDP_SUBSCRIPTIONS_READER => Some(SUBSCRIPTIONS),
        PARTICIPANT_MESSAGE_READER => Some(PARTICIPANT_MESSAGES),
        _ => None,
    }
}

/// Both bits set in an entityKind: an entity that the standard defines.
const BUILT_IN_KIND: u8 = 0xc0;

/// Whether the standard defines this entity, so that it belongs to discovery and not to an app.
#[inline(always)]
pub const fn is_built_in(entity: EntityId) -> bool {
    entity[3] & BUILT_IN_KIND == BUILT_IN_KIND
}

/// The slot of the app that owns one of this host's entities: the first byte of its key.
#[inline(always)]
pub const fn slot(entity: EntityId) -> u8 {
    entity[0]
}

/// Joins a prefix and an entity id.
#[inline(always)]
pub const fn guid(prefix: &GuidPrefix, entity: EntityId) -> Guid {
    let [a, b, c, d, e, f, g, h, i, j, k, l] = *prefix;
    let [m, n, o, p] = entity;
    [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p]
}
