//! Content filters: what a writer says of them, and what the reader has to find out.

use std::sync::Arc;

use super::*;
use crate::wire::{FilterSignature, MessageWriter, ParameterId, ParameterWriter};

const OWN: FilterSignature = FilterSignature([1; 16]);
const OTHER: FilterSignature = FilterSignature([2; 16]);

/// Of a reader that wants what begins with a 1.
fn bench() -> Bench {
    let mut bench = Bench::started(reliable(), reliable());
    let filter: PayloadFilter = Arc::new(|_, payload: &[u8]| payload.first() == Some(&1));
    bench.reader.set_content_filter(Some(filter), Some(OWN));
    bench
}

/// The value of PID_CONTENT_FILTER_INFO for one filter.
fn info(FilterSignature(signature): FilterSignature, has_passed: bool) -> Vec<u8> {
    let words = [1, u32::from(has_passed) << 31, 1];
    let mut value: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    value.extend_from_slice(&signature);
    value
}

impl Bench {
    /// A change with what its writer says of filters.
    fn judged(&mut self, sequence: i64, kind: PayloadKind, first: u8, info: &[u8]) {
        let status = match kind {
            PayloadKind::Data => ALIVE,
            PayloadKind::Key | PayloadKind::None => DISPOSED,
        };
        let data = Data {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(sequence),
            inline_qos: InlineQos {
                key_hash: Some(key(0)),
                status,
                ..InlineQos::default()
            },
            filters: None,
            kind,
            payload: &[first, 0, 0, 0],
        };
        let (mut own, mut message) = (Vec::new(), Vec::new());
        ParameterWriter::new(&mut own).parameter(ParameterId::CONTENT_FILTER_INFO, |value| {
            value.extend_from_slice(info);
        });
        MessageWriter::new(&mut message, self.writer.prefix).data_with(&data, &own);
        let mut received = MessageReceiver::new(READER_PREFIX, &message).unwrap();
        let Submessage::Data(data) = received.next().unwrap().unwrap().submessage else {
            panic!("a DATA");
        };
        self.reader.handle_data(self.now, self.writer, None, &data);
    }
}

#[test]
fn what_the_writer_says_of_this_filter_is_believed() {
    let mut bench = bench();
    bench.judged(1, PayloadKind::Data, 0, &info(OWN, true));
    bench.judged(2, PayloadKind::Data, 1, &info(OWN, false));
    assert_eq!(bench.taken(), [1]);
    assert_eq!(bench.progress(), 3, "it is not missing");
}

#[test]
fn the_reader_judges_for_itself_where_the_writer_does_not_say() {
    let mut bench = bench();
    let mut sequence = 0;
    let two_words = [&[2, 0, 0, 0], &info(OWN, false)[4..]].concat();
    for said in [&info(OTHER, false), &info(OTHER, true), &two_words, &vec![]] {
        for first in [0, 1] {
            sequence += 1;
            bench.judged(sequence, PayloadKind::Data, first, said);
        }
        assert_eq!(bench.taken(), [sequence]);
    }
    // A filter is about samples; what ends an instance is judged by its key.
    bench.judged(9, PayloadKind::Key, 1, &info(OWN, false));
    assert_eq!(bench.taken(), [9]);
}

#[test]
fn another_filter_has_another_signature() {
    let mut bench = bench();
    let filter: PayloadFilter = Arc::new(|_, payload: &[u8]| payload.first() == Some(&2));
    bench.reader.set_content_filter(Some(filter), Some(OTHER));
    bench.judged(1, PayloadKind::Data, 1, &info(OWN, true));
    bench.judged(2, PayloadKind::Data, 2, &info(OWN, false));
    bench.judged(3, PayloadKind::Data, 3, &info(OTHER, true));
    assert_eq!(bench.taken(), [2, 3]);
    bench.reader.set_content_filter(None, None);
    bench.judged(4, PayloadKind::Data, 1, &info(OTHER, false));
    assert_eq!(bench.taken(), [4], "it has none");
}
