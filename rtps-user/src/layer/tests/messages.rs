//! Messages of participants that are not simulated.

use crate::wire::{
    Data, EntityId, Guid, GuidPrefix, InlineQos, KeyHash, MessageWriter, PayloadKind,
    SequenceNumber, StatusInfo,
};

/// A sample of a writer for whoever reads it.
pub(super) fn sample(
    source: GuidPrefix,
    writer: EntityId,
    sequence: i64,
    payload: &[u8],
) -> Vec<u8> {
    from(
        source,
        &Data {
            reader: EntityId::UNKNOWN,
            writer,
            sequence: SequenceNumber(sequence),
            inline_qos: InlineQos::default(),
            filters: None,
            kind: PayloadKind::Data,
            payload,
        },
    )
}

/// What a writer says of an entity of its participant that is gone.
pub(super) fn disposal(gone: Guid, writer: EntityId, sequence: i64) -> Vec<u8> {
    from(
        gone.prefix,
        &Data {
            reader: EntityId::UNKNOWN,
            writer,
            sequence: SequenceNumber(sequence),
            inline_qos: InlineQos {
                key_hash: Some(KeyHash(gone.to_bytes())),
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
        },
    )
}

fn from(source: GuidPrefix, data: &Data<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, source).data(data);
    bytes
}
