//! Writing of messages: a header, then submessages, all little endian.

use super::{
    AckNack, Data, DataFrag, EntityId, Gap, GuidPrefix, Header, Heartbeat, HeartbeatFrag,
    InlineQos, NackFrag, PayloadKind, SequenceNumber, SubmessageKind, Timestamp,
};

const FLAG_LITTLE_ENDIAN: u8 = 0x01;

/// Appends submessages to one message in a buffer.
#[derive(Debug)]
pub struct MessageWriter<'a> {
    out: &'a mut Vec<u8>,
    /// Where the message begins in the buffer.
    start: usize,
    /// Inline QoS of each DATA and DATA_FRAG beside their own, without sentinel.
    parameters: &'a [u8],
}

/// Fragments of a change, to be cut out of the whole payload.
#[derive(Clone, Copy, Debug)]
pub struct DataFragment<'a> {
    /// The reader that it is for; unknown means all.
    pub reader: EntityId,
    /// The writer.
    pub writer: EntityId,
    /// The change's number.
    pub sequence: SequenceNumber,
    /// The fragment's number, from 1.
    pub fragment: u32,
    /// Bytes of each fragment but the last.
    pub fragment_size: u16,
    /// What is said beside the payload.
    pub inline_qos: InlineQos,
    /// What the payload is.
    pub kind: PayloadKind,
    /// The whole serialized payload of the change.
    pub sample: &'a [u8],
}

impl<'a> MessageWriter<'a> {
    /// Begins a message of `prefix` behind what is in `out`.
    pub fn new(out: &'a mut Vec<u8>, prefix: GuidPrefix) -> Self {
        let start = out.len();
        Header::encode(prefix, out);
        Self {
            out,
            start,
            parameters: &[],
        }
    }

    /// Goes on with the message that begins at the start of `out`.
    pub fn resume(out: &'a mut Vec<u8>) -> Self {
        Self {
            out,
            start: 0,
            parameters: &[],
        }
    }

    /// With parameters, written already and without sentinel, for the inline QoS of each DATA and DATA_FRAG.
    #[must_use]
    pub fn with_parameters(self, parameters: &'a [u8]) -> Self {
        Self { parameters, ..self }
    }

    /// Bytes of the message so far.
    pub fn len(&self) -> usize {
        self.out.len() - self.start
    }

    /// Whether the message has no submessage yet.
    pub fn is_empty(&self) -> bool {
        self.len() <= super::HEADER_LEN
    }

    /// Takes the message back, so that `out` is as before.
    pub fn discard(self) {
        self.out.truncate(self.start);
    }

    /// INFO_DST: what follows is for `prefix`.
    pub fn info_destination(&mut self, prefix: GuidPrefix) {
        self.submessage(SubmessageKind::INFO_DST, 0, |out| {
            out.extend_from_slice(&prefix.0)
        });
    }

    /// INFO_TS: what follows happened at `timestamp`.
    pub fn info_timestamp(&mut self, timestamp: Timestamp) {
        self.submessage(SubmessageKind::INFO_TS, 0, |out| timestamp.encode(out));
    }

    /// DATA.
    pub fn data(&mut self, data: &Data<'_>) {
        let more = self.parameters;
        let flags = data.flags(!more.is_empty());
        self.submessage(SubmessageKind::DATA, flags, |out| data.encode(more, out));
    }

    /// DATA with parameters of its own, written already and without sentinel.
    pub fn data_with(&mut self, data: &Data<'_>, own: &[u8]) {
        let more = [self.parameters, own].concat();
        let flags = data.flags(!more.is_empty());
        self.submessage(SubmessageKind::DATA, flags, |out| data.encode(&more, out));
    }

    /// DATA_FRAG with one fragment; nothing where the sample has no such fragment.
    pub fn data_fragment(&mut self, fragment: &DataFragment<'_>) {
        let size = usize::from(fragment.fragment_size);
        let Some(start) = (fragment.fragment as usize)
            .checked_sub(1)
            .and_then(|index| index.checked_mul(size))
        else {
            return;
        };
        let end = start.saturating_add(size).min(fragment.sample.len());
        let (Some(payload), Ok(sample_size)) = (
            fragment.sample.get(start..end),
            u32::try_from(fragment.sample.len()),
        ) else {
            return;
        };
        let data = DataFrag {
            reader: fragment.reader,
            writer: fragment.writer,
            sequence: fragment.sequence,
            first_fragment: fragment.fragment,
            fragment_count: 1,
            fragment_size: fragment.fragment_size,
            sample_size,
            inline_qos: fragment.inline_qos,
            kind: fragment.kind,
            payload,
        };
        let more = self.parameters;
        let flags = data.flags(!more.is_empty());
        self.submessage(SubmessageKind::DATA_FRAG, flags, |out| {
            data.encode(more, out)
        });
    }

    /// HEARTBEAT.
    pub fn heartbeat(&mut self, heartbeat: &Heartbeat) {
        self.submessage(SubmessageKind::HEARTBEAT, heartbeat.flags(), |out| {
            heartbeat.encode(out)
        });
    }

    /// HEARTBEAT_FRAG.
    pub fn heartbeat_frag(&mut self, heartbeat: &HeartbeatFrag) {
        self.submessage(SubmessageKind::HEARTBEAT_FRAG, 0, |out| {
            heartbeat.encode(out)
        });
    }

    /// ACKNACK.
    pub fn acknack(&mut self, acknack: &AckNack) {
        self.submessage(SubmessageKind::ACKNACK, acknack.flags(), |out| {
            acknack.encode(out)
        });
    }

    /// NACK_FRAG.
    pub fn nack_frag(&mut self, nack: &NackFrag) {
        self.submessage(SubmessageKind::NACK_FRAG, 0, |out| nack.encode(out));
    }

    /// GAP.
    pub fn gap(&mut self, gap: &Gap) {
        self.submessage(SubmessageKind::GAP, 0, |out| gap.encode(out));
    }

    /// Writes header and body; the body is padded to 4 bytes, as each submessage must start aligned (9.4.1). A
    /// length that 16 bits cannot say becomes 0, "to the end of the message": only the last may be that long.
    fn submessage(&mut self, kind: SubmessageKind, flags: u8, body: impl FnOnce(&mut Vec<u8>)) {
        self.out
            .extend_from_slice(&[kind.0, flags | FLAG_LITTLE_ENDIAN, 0, 0]);
        let start = self.out.len();
        body(self.out);
        let padded = (self.out.len() - start).next_multiple_of(4);
        self.out.resize(start + padded, 0);
        let length = u16::try_from(padded).unwrap_or(0);
        self.out[start - 2..start].copy_from_slice(&length.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{
        Duration, FragmentNumberSet, GroupDigest, HeartbeatGroup, KeyHash, MessageReceiver,
        Received, SequenceNumberSet, StatusInfo, Submessage, WireError,
    };

    const OURS: GuidPrefix = GuidPrefix([1; 12]);
    const THEIRS: GuidPrefix = GuidPrefix([2; 12]);
    const READER: EntityId = EntityId([1, 0, 1, 7]);
    const WRITER: EntityId = EntityId([2, 0, 1, 2]);
    const SEQUENCE: SequenceNumber = SequenceNumber(5_000_000_000);

    fn data() -> Data<'static> {
        let status = StatusInfo {
            disposed: true,
            ..StatusInfo::default()
        };
        let key_hash = Some(KeyHash([9; 16]));
        Data {
            reader: READER,
            writer: WRITER,
            sequence: SEQUENCE,
            inline_qos: InlineQos {
                key_hash,
                status,
                coherent_set: Some(SEQUENCE),
                group_sequence: Some(SEQUENCE.next()),
                group_coherent_set: Some(SequenceNumber::UNKNOWN),
                writer_group: Some(GroupDigest([1, 2, 3, 4])),
                lifespan: Some(Duration::INFINITE),
            },
            filters: None,
            kind: PayloadKind::Key,
            payload: &[0, 1, 0, 0, 1, 2, 3, 4],
        }
    }

    fn submessages() -> Vec<Submessage<'static>> {
        let state = SequenceNumberSet::from_members(SEQUENCE, [SEQUENCE, SEQUENCE.plus(200)]);
        let missing = FragmentNumberSet::from_members(3, [3, 5]);
        vec![
            Submessage::Data(data()),
            Submessage::Heartbeat(Heartbeat {
                reader: READER,
                writer: WRITER,
                first: SequenceNumber(1),
                last: SEQUENCE,
                count: 3,
                is_final: true,
                liveliness: true,
                group: Some(HeartbeatGroup {
                    current: SequenceNumber(9),
                    first: SequenceNumber(3),
                    last: SequenceNumber(7),
                    writers: GroupDigest([5, 6, 7, 8]),
                    secure_writers: GroupDigest::default(),
                }),
            }),
            Submessage::AckNack(AckNack {
                reader: READER,
                writer: WRITER,
                state,
                count: -1,
                is_final: true,
            }),
            Submessage::Gap(Gap {
                reader: READER,
                writer: WRITER,
                start: SequenceNumber(7),
                list: state,
            }),
            Submessage::NackFrag(NackFrag {
                reader: READER,
                writer: WRITER,
                sequence: SEQUENCE,
                missing,
                count: 8,
            }),
            Submessage::HeartbeatFrag(HeartbeatFrag {
                reader: READER,
                writer: WRITER,
                sequence: SEQUENCE,
                last_fragment: 4,
                count: 9,
            }),
        ]
    }

    fn message() -> Vec<u8> {
        let mut out = Vec::new();
        let mut writer = MessageWriter::new(&mut out, THEIRS);
        writer.info_destination(OURS);
        writer.info_timestamp(Timestamp {
            seconds: 1,
            fraction: 2,
        });
        for submessage in submessages() {
            match submessage {
                Submessage::Data(data) => writer.data(&data),
                Submessage::Heartbeat(heartbeat) => writer.heartbeat(&heartbeat),
                Submessage::AckNack(acknack) => writer.acknack(&acknack),
                Submessage::Gap(gap) => writer.gap(&gap),
                Submessage::NackFrag(nack) => writer.nack_frag(&nack),
                Submessage::HeartbeatFrag(heartbeat) => writer.heartbeat_frag(&heartbeat),
                other => panic!("{other:?} is not written here"),
            }
        }
        out
    }

    #[test]
    fn what_is_written_is_read_again() {
        let message = message();
        let received: Vec<_> = MessageReceiver::new(OURS, &message)
            .unwrap()
            .collect::<Result<_, _>>()
            .unwrap();
        let expected: Vec<_> = submessages()
            .into_iter()
            .map(|submessage| Received {
                is_directed: true,
                source: THEIRS,
                timestamp: Some(Timestamp {
                    seconds: 1,
                    fraction: 2,
                }),
                submessage,
            })
            .collect();
        assert_eq!(received, expected);
    }

    #[test]
    fn what_is_for_others_is_skipped() {
        let message = message();
        assert_eq!(MessageReceiver::new(THEIRS, &message).unwrap().count(), 0);
    }

    #[test]
    fn truncated_messages_keep_what_was_whole() {
        let message = message();
        let whole = submessages().len();
        for length in 0..message.len() {
            let Ok(receiver) = MessageReceiver::new(OURS, &message[..length]) else {
                continue;
            };
            assert!(
                receiver.filter(|received| received.is_ok()).count() < whole,
                "{length}"
            );
        }
    }

    #[test]
    fn fragments_are_cut_and_checked() {
        let sample: Vec<u8> = (0..=249).collect();
        let mut out = Vec::new();
        let mut writer = MessageWriter::new(&mut out, THEIRS);
        for fragment in 0..=4 {
            writer.data_fragment(&DataFragment {
                reader: READER,
                writer: WRITER,
                sequence: SEQUENCE,
                fragment,
                fragment_size: 100,
                inline_qos: InlineQos::default(),
                kind: PayloadKind::Data,
                sample: &sample,
            });
        }
        let mut assembled = Vec::new();
        for received in MessageReceiver::new(OURS, &out).unwrap() {
            let Submessage::DataFrag(fragment) = received.unwrap().submessage else {
                panic!()
            };
            assert_eq!(fragment.offset(), assembled.len());
            assembled.extend_from_slice(fragment.payload);
        }
        assert_eq!(assembled, sample);
    }

    #[test]
    fn fragments_that_lie_are_refused() {
        let mut out = Vec::new();
        MessageWriter::new(&mut out, THEIRS).data_fragment(&DataFragment {
            reader: READER,
            writer: WRITER,
            sequence: SEQUENCE,
            fragment: 1,
            fragment_size: 100,
            inline_qos: InlineQos::default(),
            kind: PayloadKind::Data,
            sample: &[0; 250],
        });
        // Offsets in the message of: fragment number, count, size, sample size.
        for (offset, bytes) in [
            (44, &[0u8; 4][..]),
            (44, &[0xff; 4]),
            (48, &[0; 2]),
            (48, &[9, 0]),
            (50, &[0; 2]),
            (52, &[0; 4]),
        ] {
            let mut message = out.clone();
            message[offset..offset + bytes.len()].copy_from_slice(bytes);
            let received = MessageReceiver::new(OURS, &message).unwrap().next();
            assert_eq!(
                received,
                Some(Err(WireError::InvalidFragment)),
                "{offset} {bytes:?}"
            );
        }
    }
}
