use std::{vec, vec::Vec};

use proptest::prelude::*;

use super::*;

mod lies;

const OWN: GuidPrefix = *b"own-prefix--";
const REMOTE: GuidPrefix = *b"remote------";
const RELAYED: GuidPrefix = *b"relayed-----";
const WRITER: EntityId = [0, 0, 1, 0x03];
const SPDP_WRITER: EntityId = [0, 1, 0, 0xc2];
const SPDP_READER: EntityId = [0, 1, 0, 0xc7];

const PAD: u8 = 0x01;
const ACKNACK: u8 = 0x06;
const HEARTBEAT: u8 = 0x07;
const GAP: u8 = 0x08;
const INFO_TS: u8 = 0x09;
const INFO_SRC: u8 = 0x0c;
const INFO_REPLY_IP4: u8 = 0x0d;
const INFO_DST: u8 = 0x0e;
const INFO_REPLY: u8 = 0x0f;
const NACK_FRAG: u8 = 0x12;
const HEARTBEAT_FRAG: u8 = 0x13;
const DATA: u8 = 0x15;
const DATA_FRAG: u8 = 0x16;

/// Slots 2 and 9 read from the remote's [`WRITER`], slot 5 from the relayed one.
struct Matched;

impl Routes for Matched {
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        if *writer == guid(&REMOTE, WRITER) {
            slots.insert(2);
            slots.insert(9);
        }
        if *writer == guid(&RELAYED, WRITER) {
            slots.insert(5);
        }
    }
}

/// Remembers which writers' readers were asked for.
#[derive(Default)]
struct Asked(core::cell::RefCell<Vec<Guid>>);

impl Routes for Asked {
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        self.0.borrow_mut().push(*writer);
        Matched.add_readers(writer, slots);
    }
}

/// Puts a body together in the byte order of the test.
struct Body {
    little: bool,
    bytes: Vec<u8>,
}

impl Body {
    fn raw(mut self, bytes: &[u8]) -> Self {
        self.bytes.extend_from_slice(bytes);
        self
    }

    fn u16(self, value: u16) -> Self {
        let bytes = if self.little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        };
        self.raw(&bytes)
    }

    fn u32(self, value: u32) -> Self {
        let bytes = if self.little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        };
        self.raw(&bytes)
    }

    fn i64(self, value: i64) -> Self {
        self.u32((value >> 32) as u32).u32(value as u32)
    }
}

/// Builds a message.
struct Message {
    little: bool,
    bytes: Vec<u8>,
}

impl Message {
    fn new(little: bool) -> Self {
        let mut bytes = b"RTPS\x02\x05\x01\x10".to_vec();
        bytes.extend_from_slice(&REMOTE);
        Self { little, bytes }
    }

    fn submessage(self, id: u8, flags: u8, body: impl FnOnce(Body) -> Body) -> Self {
        let len = |body: &[u8]| body.len() as u16;
        self.lying(id, flags, len, body)
    }

    /// The same with any length in the header.
    fn lying(
        mut self,
        id: u8,
        flags: u8,
        len: impl FnOnce(&[u8]) -> u16,
        body: impl FnOnce(Body) -> Body,
    ) -> Self {
        let little = self.little;
        let body = body(Body {
            little,
            bytes: vec![],
        });
        let head = Body {
            little,
            bytes: vec![id, flags | u8::from(little)],
        };
        self.bytes.extend(head.u16(len(&body.bytes)).bytes);
        self.bytes.extend(body.bytes);
        self
    }

    fn destination(self, prefix: GuidPrefix) -> Self {
        self.submessage(INFO_DST, 0, |body| body.raw(&prefix))
    }

    fn source(self, prefix: GuidPrefix) -> Self {
        self.submessage(INFO_SRC, 0, |body| {
            body.u32(0).raw(&[2, 5, 1, 16]).raw(&prefix)
        })
    }

    fn data(self, reader: EntityId, writer: EntityId) -> Self {
        self.submessage(DATA, 4, |body| data(body, reader, writer, 1).raw(PAYLOAD))
    }

    fn examine(&self) -> Findings {
        examine(&self.bytes[..], OWN, &Matched)
    }
}

const PAYLOAD: &[u8] = &[0, 1, 0, 0, 42, 0, 0, 0];

fn reader_of(slot: u8) -> EntityId {
    [slot, 0, 7, 0x04]
}

fn writer_of(slot: u8) -> EntityId {
    [slot, 0, 8, 0x03]
}

fn data(body: Body, reader: EntityId, writer: EntityId, number: i64) -> Body {
    body.u16(0).u16(16).raw(&reader).raw(&writer).i64(number)
}

struct Fragments {
    start: u32,
    count: u16,
    size: u16,
    sample: u32,
}

fn data_frag(body: Body, fragments: &Fragments, payload: usize) -> Body {
    body.u16(0)
        .u16(28)
        .raw(&reader_of(3))
        .raw(&WRITER)
        .i64(1)
        .u32(fragments.start)
        .u16(fragments.count)
        .u16(fragments.size)
        .u32(fragments.sample)
        .raw(&vec![0; payload])
}

fn slots(slots: &[u8]) -> SlotSet {
    slots.iter().copied().collect()
}

fn found(targets: &[u8]) -> Findings {
    Findings {
        targets: slots(targets),
        built_in: false,
        skipped_foreign: false,
        foreign_source: false,
        malformed: None,
    }
}

/// The same in both byte orders.
fn assert_found(build: impl Fn(Message) -> Message, expected: Findings) {
    for little in [true, false] {
        assert_eq!(
            build(Message::new(little)).examine(),
            expected,
            "little endian: {little}"
        );
    }
}

fn assert_malformed(reason: Reason, build: impl Fn(Message) -> Message) {
    let expected = Findings {
        malformed: Some(reason),
        ..found(&[2, 9])
    };
    // Behind a valid submessage, which still counts, and before one that does not.
    assert_found(
        |message| build(message.data(ENTITY_ID_UNKNOWN, WRITER)).data(reader_of(1), WRITER),
        expected,
    );
}

#[test]
fn directed_submessages_reach_the_slot_in_the_key() {
    assert_found(|m| m.data(reader_of(7), WRITER), found(&[7]));
    assert_found(|m| m.data(reader_of(255), WRITER), found(&[255]));
    assert_found(
        |m| {
            m.submessage(ACKNACK, 0, |b| {
                b.raw(&WRITER).raw(&writer_of(4)).i64(1).u32(0).u32(1)
            })
        },
        found(&[4]),
    );
    assert_found(
        |m| {
            m.submessage(NACK_FRAG, 0, |b| {
                b.raw(&WRITER)
                    .raw(&writer_of(6))
                    .i64(1)
                    .u32(1)
                    .u32(1)
                    .u32(0)
                    .u32(1)
            })
        },
        found(&[6]),
    );
}

#[test]
fn undirected_submessages_reach_the_matched_readers() {
    let undirected = [(HEARTBEAT, 28), (HEARTBEAT_FRAG, 24)];
    assert_found(|m| m.data(ENTITY_ID_UNKNOWN, WRITER), found(&[2, 9]));
    for (id, len) in undirected {
        assert_found(
            |m| {
                m.submessage(id, 0, |b| {
                    let body = b.raw(&ENTITY_ID_UNKNOWN).raw(&WRITER).i64(1).u32(1);
                    let rest = len - body.bytes.len();
                    body.raw(&vec![1; rest])
                })
            },
            found(&[2, 9]),
        );
    }
    assert_found(
        |m| {
            m.submessage(GAP, 0, |b| {
                b.raw(&ENTITY_ID_UNKNOWN).raw(&WRITER).i64(1).i64(9).u32(0)
            })
        },
        found(&[2, 9]),
    );
    assert_found(|m| m.data(ENTITY_ID_UNKNOWN, [9, 9, 9, 3]), found(&[]));
}

#[test]
fn built_in_entities_and_slot_0_concern_rtpsd() {
    let daemon = Findings {
        built_in: true,
        ..found(&[])
    };
    assert_found(|m| m.data(ENTITY_ID_UNKNOWN, SPDP_WRITER), daemon);
    assert_found(|m| m.data(SPDP_READER, SPDP_WRITER), daemon);
    assert_found(|m| m.data(reader_of(0), WRITER), daemon);
    assert_found(
        |m| m.data(SPDP_READER, SPDP_WRITER).data(reader_of(1), WRITER),
        Findings {
            built_in: true,
            ..found(&[1])
        },
    );
}

#[test]
fn info_dst_and_info_src_hold_until_the_next_one() {
    let foreign = Findings {
        skipped_foreign: true,
        ..found(&[])
    };
    assert_found(
        |m| m.destination(RELAYED).data(reader_of(1), WRITER),
        foreign,
    );
    assert_found(
        |m| {
            m.destination(RELAYED)
                .data(reader_of(1), WRITER)
                .destination(OWN)
                .data(reader_of(2), WRITER)
        },
        Findings {
            targets: slots(&[2]),
            ..foreign
        },
    );
    assert_found(
        |m| {
            m.destination(RELAYED)
                .destination([0; 12])
                .data(reader_of(3), WRITER)
        },
        found(&[3]),
    );
    assert_found(
        |m| m.source(RELAYED).data(ENTITY_ID_UNKNOWN, WRITER),
        found(&[5]),
    );
}

#[test]
fn a_writers_readers_are_looked_up_once() {
    let to_all = |m: Message| m.data(ENTITY_ID_UNKNOWN, WRITER);
    let twice = |m: Message| to_all(to_all(m));
    let message = twice(twice(Message::new(true)).source(RELAYED)).source(REMOTE);
    let asked = Asked::default();
    let findings = examine(&to_all(message).bytes[..], OWN, &asked);
    let relayed = guid(&RELAYED, WRITER);
    let remote = guid(&REMOTE, WRITER);
    assert_eq!(*asked.0.borrow(), [remote, relayed, remote]);
    assert!(
        [2, 5, 9]
            .iter()
            .all(|&slot| findings.targets.contains(slot))
    );
}

/// [`RELAYED`] does not send from here.
struct Bound;

impl Routes for Bound {
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet) {
        Matched.add_readers(writer, slots);
    }

    fn may_send(&self, participant: &GuidPrefix) -> bool {
        *participant != RELAYED
    }
}

#[test]
fn nobody_sends_in_the_name_of_who_is_elsewhere() {
    let verdict = |message: &[u8]| examine(message, OWN, &Bound).concerned();
    let honest = Message::new(true).data(reader_of(1), WRITER);
    assert!(verdict(&honest.bytes).is_ok());
    let mut header = honest.bytes.clone();
    header[8..20].copy_from_slice(&RELAYED);
    assert_eq!(verdict(&header), Err(Counter::DropForeignSource));
    let source = honest.source(RELAYED).data(SPDP_READER, SPDP_WRITER);
    assert_eq!(verdict(&source.bytes), Err(Counter::DropForeignSource));
}

#[test]
fn foreign_and_unroutable_messages_have_counters_of_their_own() {
    let verdict = |message: Message| message.examine().concerned();
    assert_eq!(verdict(Message::new(true)), Err(Counter::DropUnroutable));
    assert_eq!(
        verdict(
            Message::new(true)
                .destination(RELAYED)
                .data(reader_of(1), WRITER)
        ),
        Err(Counter::DropForeignDestination)
    );
    assert_eq!(
        verdict(Message::new(true).submessage(INFO_DST, 0, |b| b)),
        Err(Counter::DropMalformed)
    );
}

#[test]
fn what_carries_nothing_for_us_is_skipped() {
    assert_found(
        |m| {
            m.submessage(PAD, 0, |b| b)
                .submessage(INFO_TS, 2, |b| b)
                .submessage(INFO_TS, 0, |b| b.raw(&[0; 8]))
                .submessage(INFO_REPLY, 2, |b| {
                    b.u32(1).raw(&[0; 24]).u32(2).raw(&[0; 48])
                })
                .submessage(INFO_REPLY_IP4, 2, |b| b.raw(&[0; 16]))
                .submessage(0x80, 0, |b| b.raw(&[0; 12]))
                .submessage(0x33, 0, |b| b)
                .data(reader_of(1), WRITER)
        },
        // 0x33 is unknown, and its length of 0 makes it the last.
        found(&[]),
    );
    assert_found(
        |m| {
            m.submessage(0x80, 0, |b| b.raw(&[0; 5]))
                .data(reader_of(1), WRITER)
        },
        found(&[1]),
    );
}

#[test]
fn length_0_is_the_rest_of_the_message() {
    assert_found(
        |m| {
            m.lying(
                DATA,
                4,
                |_| 0,
                |b| data(b, reader_of(1), WRITER, 1).raw(&[0; 70]),
            )
        },
        found(&[1]),
    );
    assert_malformed(Reason::ZeroLength, |m| {
        m.lying(INFO_DST, 0, |_| 0, |b| b.raw(&OWN))
    });
    assert_malformed(Reason::ZeroLength, |m| {
        m.lying(
            ACKNACK,
            0,
            |_| 0,
            |b| b.raw(&WRITER).raw(&writer_of(4)).i64(1).u32(0).u32(1),
        )
    });
}

#[test]
fn the_number_of_submessages_is_bounded() {
    let pads = |count: u32| {
        (0..count)
            .fold(Message::new(true), |m, _| m.submessage(PAD, 0, |b| b))
            .examine()
            .malformed
    };
    assert_eq!(pads(MAX_SUBMESSAGES), None);
    assert_eq!(pads(MAX_SUBMESSAGES + 1), Some(Reason::TooManySubmessages));
}

/// A message with one of each.
fn corpus(little: bool) -> Message {
    Message::new(little)
        .destination(OWN)
        .submessage(INFO_TS, 0, |b| b.raw(&[0; 8]))
        .data(reader_of(1), WRITER)
        .submessage(HEARTBEAT, 0, |b| {
            b.raw(&reader_of(1)).raw(&WRITER).i64(1).i64(3).u32(1)
        })
        .submessage(ACKNACK, 0, |b| {
            b.raw(&WRITER)
                .raw(&writer_of(2))
                .i64(1)
                .u32(3)
                .u32(5)
                .u32(1)
        })
        .submessage(GAP, 0, |b| {
            b.raw(&reader_of(3))
                .raw(&WRITER)
                .i64(1)
                .i64(4)
                .u32(33)
                .u32(1)
                .u32(1)
        })
        .source(RELAYED)
        .submessage(DATA_FRAG, 0, |b| {
            let fragments = Fragments {
                start: 2,
                count: 1,
                size: 8,
                sample: 20,
            };
            data_frag(b, &fragments, 8)
        })
        .submessage(INFO_REPLY, 0, |b| b.u32(1).raw(&[0; 24]))
        .data(ENTITY_ID_UNKNOWN, WRITER)
}

#[test]
fn truncation_never_adds_a_target() {
    for little in [true, false] {
        let message = corpus(little);
        let whole = message.examine();
        assert_eq!(whole, found(&[1, 2, 3, 5]));
        let mut before = SlotSet::EMPTY;
        for len in 0..message.bytes.len() {
            let findings = examine(&message.bytes[..len], OWN, &Matched);
            let mut union = findings.targets;
            union.union(&before);
            assert_eq!(
                union, findings.targets,
                "a longer prefix has no fewer targets"
            );
            before = findings.targets;
        }
    }
}

proptest! {
    #[test]
    fn any_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        examine(&bytes[..], OWN, &Matched);
        let mut message = Message::new(true).bytes;
        message.extend(bytes);
        examine(&message[..], OWN, &Matched);
    }

    #[test]
    fn any_flipped_bytes_end(
        little: bool,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut message = corpus(little).bytes;
        for (index, value) in flips {
            let index = index.index(message.len());
            message[index] = value;
        }
        let findings = examine(&message[..], OWN, &Matched);
        prop_assert!(findings.targets.iter().count() <= 9);
    }
}
