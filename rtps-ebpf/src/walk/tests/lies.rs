//! Submessages whose fields contradict each other, or the message.

use super::*;

#[test]
fn headers_that_lie() {
    for len in 0..20 {
        assert_eq!(
            examine(&Message::new(true).bytes[..len], OWN, &Matched).malformed,
            Some(Reason::TooShort)
        );
    }
    let header = |index: usize, value: u8| {
        let mut message = Message::new(true).data(reader_of(1), WRITER);
        message.bytes[index] = value;
        message.examine().malformed
    };
    assert_eq!(header(3, b'X'), Some(Reason::BadMagic));
    assert_eq!(header(4, 1), Some(Reason::BadVersion));
    assert_eq!(header(4, 3), Some(Reason::BadVersion));
    assert_eq!(header(5, 99), None);
    assert_malformed(Reason::SubmessageLength, |m| {
        m.lying(INFO_TS, 0, |_| 60_000, |b| b.raw(&[0; 8]))
    });
    let mut trailing = Message::new(true).data(reader_of(1), WRITER);
    trailing.bytes.extend_from_slice(&[1, 1, 0]);
    assert_eq!(
        trailing.examine(),
        Findings {
            malformed: Some(Reason::SubmessageHeader),
            ..found(&[1])
        }
    );
}

#[test]
fn number_sets_that_lie() {
    let acknack = |base: i64, bits: u32, words: usize| {
        move |m: Message| {
            m.submessage(ACKNACK, 0, |b| {
                b.raw(&WRITER)
                    .raw(&writer_of(4))
                    .i64(base)
                    .u32(bits)
                    .raw(&vec![0xff; words * 4])
                    .u32(1)
            })
        }
    };
    assert_found(acknack(0, 0, 0), found(&[4]));
    assert_found(acknack(1, 256, 8), found(&[4]));
    assert_malformed(Reason::NumberSetBits, acknack(1, 257, 9));
    assert_malformed(Reason::NumberSetBits, acknack(1, u32::MAX, 8));
    assert_malformed(Reason::NumberSetBitmap, acknack(1, 256, 7));
    assert_malformed(Reason::NumberSetBitmap, acknack(1, 1, 0));
    assert_malformed(Reason::NumberSetBase, acknack(-1, 0, 0));
    assert_malformed(Reason::NumberSetBase, acknack(i64::MAX, 32, 1));
    let gap = |start: i64, base: i64, bits: u32| {
        move |m: Message| {
            m.submessage(GAP, 0, |b| {
                b.raw(&reader_of(4))
                    .raw(&WRITER)
                    .i64(start)
                    .i64(base)
                    .u32(bits)
            })
        }
    };
    assert_found(gap(1, 1 << 40, 0), found(&[4]));
    assert_malformed(Reason::GapStart, gap(0, 5, 0));
    assert_malformed(Reason::GapStart, gap(-5, 5, 0));
    assert_malformed(Reason::NumberSetBase, gap(1, 0, 0));
    assert_malformed(Reason::NumberSetBitmap, gap(1, 5, 1));
    assert_malformed(Reason::NumberSetBase, |m| {
        m.submessage(NACK_FRAG, 0, |b| {
            b.raw(&WRITER)
                .raw(&writer_of(6))
                .i64(1)
                .u32(0)
                .u32(0)
                .u32(1)
        })
    });
}

#[test]
fn heartbeats_that_lie() {
    let heartbeat = |first: i64, last: i64| {
        move |m: Message| {
            m.submessage(HEARTBEAT, 0, |b| {
                b.raw(&reader_of(4))
                    .raw(&WRITER)
                    .i64(first)
                    .i64(last)
                    .u32(1)
            })
        }
    };
    assert_found(heartbeat(1, 0), found(&[4]));
    assert_found(heartbeat(1, i64::MAX), found(&[4]));
    assert_malformed(Reason::HeartbeatRange, heartbeat(0, 5));
    assert_malformed(Reason::HeartbeatRange, heartbeat(-3, 5));
    assert_malformed(Reason::HeartbeatRange, heartbeat(7, 5));
    assert_malformed(Reason::HeartbeatRange, heartbeat(i64::MIN, i64::MIN));
    let heartbeat_frag = |number: i64, last: u32| {
        move |m: Message| {
            m.submessage(HEARTBEAT_FRAG, 0, |b| {
                b.raw(&reader_of(4))
                    .raw(&WRITER)
                    .i64(number)
                    .u32(last)
                    .u32(1)
            })
        }
    };
    assert_found(heartbeat_frag(1, 1), found(&[4]));
    assert_malformed(Reason::SequenceNumber, heartbeat_frag(0, 1));
    assert_malformed(Reason::FragmentStart, heartbeat_frag(1, 0));
}

#[test]
fn data_that_lies() {
    let with = |flags: u8, octets: u16, number: i64, payload: usize| {
        move |m: Message| {
            m.submessage(DATA, flags, |b| {
                b.u16(0)
                    .u16(octets)
                    .raw(&reader_of(4))
                    .raw(&WRITER)
                    .i64(number)
                    .raw(&vec![0; payload])
            })
        }
    };
    assert_found(with(0, 16, 1, 0), found(&[4]));
    assert_found(with(4, 16, 1, 4), found(&[4]));
    assert_found(with(6, 24, 1, 16), found(&[4]));
    assert_malformed(Reason::SequenceNumber, with(4, 16, 0, 8));
    assert_malformed(Reason::SequenceNumber, with(4, 16, -1 << 32, 8));
    assert_malformed(Reason::InlineQosOffset, with(4, 15, 1, 8));
    assert_malformed(Reason::InlineQosOffset, with(4, 25, 1, 8));
    assert_malformed(Reason::InlineQosOffset, with(4, u16::MAX, 1, 8));
    assert_malformed(Reason::Payload, with(4, 16, 1, 0));
    assert_malformed(Reason::Payload, with(2, 16, 1, 0));
    assert_malformed(Reason::Payload, with(6, 16, 1, 4));
    assert_malformed(Reason::Payload, with(4 | 8, 16, 1, 8));
}

#[test]
fn fragments_that_lie() {
    let with = |start, count, size, sample, payload| {
        move |m: Message| {
            m.submessage(DATA_FRAG, 0, |b| {
                let fragments = Fragments {
                    start,
                    count,
                    size,
                    sample,
                };
                data_frag(b, &fragments, payload)
            })
        }
    };
    assert_found(with(1, 1, 100, 250, 100), found(&[3]));
    assert_found(with(1, 3, 100, 250, 250), found(&[3]));
    assert_found(with(3, 1, 100, 250, 50), found(&[3]));
    assert_found(with(3, 1, 100, 250, 52), found(&[3]));
    assert_malformed(Reason::FragmentSize, with(1, 1, 0, 250, 0));
    assert_malformed(Reason::FragmentSize, with(1, 1, 300, 250, 250));
    assert_malformed(Reason::FragmentCount, with(1, 0, 100, 250, 0));
    assert_malformed(Reason::FragmentStart, with(0, 1, 100, 250, 100));
    assert_malformed(Reason::FragmentRange, with(4, 1, 100, 250, 100));
    assert_malformed(Reason::FragmentRange, with(3, 2, 100, 250, 150));
    assert_malformed(
        Reason::FragmentRange,
        with(u32::MAX, u16::MAX, u16::MAX, u32::MAX, 0),
    );
    assert_malformed(Reason::FragmentBytes, with(1, 1, 100, 250, 99));
    assert_malformed(Reason::FragmentBytes, with(1, 1, 100, 250, 104));
}

#[test]
fn lists_that_lie() {
    for count in [2, 1 << 27, u32::MAX] {
        assert_malformed(Reason::LocatorList, |m| {
            m.submessage(INFO_REPLY, 0, |b| b.u32(count).raw(&[0; 24]))
        });
    }
    assert_malformed(Reason::SubmessageTooShort, |m| {
        m.submessage(INFO_REPLY, 2, |b| b.u32(1).raw(&[0; 24]))
    });
}

#[test]
fn bodies_shorter_than_their_fields() {
    let fields = [
        (ACKNACK, 20),
        (HEARTBEAT, 28),
        (GAP, 28),
        (INFO_TS, 8),
        (INFO_SRC, 20),
        (INFO_REPLY_IP4, 8),
        (INFO_DST, 12),
        (INFO_REPLY, 4),
        (NACK_FRAG, 24),
        (HEARTBEAT_FRAG, 24),
        (DATA, 20),
        (DATA_FRAG, 32),
    ];
    for (id, len) in fields {
        for short in 1..len {
            assert_malformed(Reason::SubmessageTooShort, |m| {
                m.submessage(id, 0, |b| b.raw(&vec![0; short]))
            });
        }
    }
    assert_malformed(Reason::SubmessageTooShort, |m| {
        m.submessage(INFO_TS, 0, |b| b)
    });
}
