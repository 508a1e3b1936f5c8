//! What invented participants say.

use std::net::SocketAddr;

use crate::discovery::{EndpointData, ParticipantData};
use crate::layer::tests::WRITER;
use crate::layer::tests::messages::{disposal, sample};
use crate::layer::tests::sim::{prefix, reliable};
use crate::wire::{
    AckNack, EntityId, Guid, GuidPrefix, MessageWriter, SequenceNumber, SequenceNumberSet,
};

/// A participant that there is not.
pub(super) const STRANGER: GuidPrefix = GuidPrefix([0x99; 12]);

/// Where it says that it is.
pub(super) fn address() -> SocketAddr {
    ([10, 9, 9, 9], 7410).into()
}

pub(super) fn announcement() -> Vec<u8> {
    announcement_of(STRANGER, address())
}

pub(super) fn announcement_of(participant: GuidPrefix, address: SocketAddr) -> Vec<u8> {
    let mut data = ParticipantData::new(participant);
    data.metatraffic_unicast = vec![address];
    let mut payload = Vec::new();
    data.encode(&mut payload);
    sample(participant, EntityId::SPDP_WRITER, 1, &payload)
}

/// An ACKNACK of the stranger for the first host.
pub(super) fn acknack(count: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut message = MessageWriter::new(&mut bytes, STRANGER);
    message.info_destination(prefix(1));
    message.acknack(&AckNack {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        state: SequenceNumberSet::empty(SequenceNumber(1)),
        count,
        is_final: true,
    });
    bytes
}

/// What the stranger says of its one writer.
pub(super) fn publication() -> (Guid, Vec<u8>) {
    let guid = Guid::new(STRANGER, EntityId::of_app(1, 1, WRITER));
    let data = EndpointData {
        guid,
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: reliable(),
    };
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
    (guid, sample(STRANGER, writer, 1, &payload))
}

/// A participant's last word, the sample of its announcements with this number.
pub(super) fn farewell(participant: GuidPrefix, sequence: i64) -> Vec<u8> {
    let participant = Guid::new(participant, EntityId::PARTICIPANT);
    disposal(participant, EntityId::SPDP_WRITER, sequence)
}
