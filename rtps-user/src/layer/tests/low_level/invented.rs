//! What invented participants say.

use std::net::SocketAddr;

use crate::discovery::{EndpointData, ParticipantData};
use crate::layer::tests::WRITER;
use crate::layer::tests::sim::{prefix, reliable};
use crate::wire::{
    AckNack, Data, EntityId, Guid, GuidPrefix, InlineQos, KeyHash, MessageWriter, PayloadKind,
    SequenceNumber, SequenceNumberSet, StatusInfo,
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
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, participant).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sequence: SequenceNumber(1),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload: &payload,
    });
    bytes
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
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, STRANGER).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        sequence: SequenceNumber(1),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload: &payload,
    });
    (guid, bytes)
}

/// A participant's last word, the sample of its announcements with this number.
pub(super) fn farewell(participant: GuidPrefix, sequence: i64) -> Vec<u8> {
    let key = Guid::new(participant, EntityId::PARTICIPANT);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, participant).data(&Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sequence: SequenceNumber(sequence),
        inline_qos: InlineQos {
            key_hash: Some(KeyHash(key.to_bytes())),
            status: StatusInfo {
                disposed: true,
                unregistered: true,
                filtered: false,
            },
            ..InlineQos::default()
        },
        filters: None,
        kind: PayloadKind::None,
        payload: &[],
    });
    bytes
}
