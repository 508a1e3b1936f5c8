//! What an answer says.

use std::{vec, vec::Vec};

use super::message::{OWN, READERS, REMOTE, WRITERS};

/// A submessage of an answer; `of` is the number of its topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Said {
    Announcement,
    Timestamp(u64),
    Data {
        of: u8,
        number: u64,
    },
    Heartbeat {
        of: usize,
        first: u64,
        last: u64,
        is_final: bool,
        count: u32,
    },
    Acknack {
        of: usize,
        base: u64,
        missing: Vec<u64>,
        is_final: bool,
        count: u32,
    },
    Gap {
        of: usize,
        start: u64,
        base: u64,
        list: Vec<u64>,
    },
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn number_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) << 32 | u64::from(u32_at(bytes, at + 4))
}

/// Base, members, and where the set ends.
fn set_at(bytes: &[u8], at: usize) -> (u64, Vec<u64>, usize) {
    let (base, bits) = (number_at(bytes, at), u32_at(bytes, at + 8));
    let word = |bit: u32| u32_at(bytes, at + 12 + 4 * (bit / 32) as usize);
    let members = (0..bits).filter(|bit| word(*bit) & 1 << (31 - bit % 32) != 0);
    let members = members.map(|bit| base + u64::from(bit)).collect();
    (base, members, at + 12 + 4 * bits.div_ceil(32) as usize)
}

/// The topic of a submessage that begins with reader and writer.
fn topic(body: &[u8], ours: &[[u8; 4]; 3], theirs: &[[u8; 4]; 3], ours_at: usize) -> usize {
    let theirs_at = 4 - ours_at;
    let of = ours.iter().position(|id| body[ours_at..ours_at + 4] == *id);
    let of = of.expect("an endpoint of ours");
    assert_eq!(body[theirs_at..theirs_at + 4], theirs[of]);
    of
}

/// Reads a datagram to [`REMOTE`]: its header, INFO_DST, and what follows.
pub(super) fn listen(datagram: &[u8]) -> Vec<Said> {
    assert_eq!(datagram[..8], *b"RTPS\x02\x05\x00\x00");
    assert_eq!(datagram[8..20], OWN);
    assert_eq!(datagram[20..24], [0x0e, 1, 12, 0]);
    assert_eq!(datagram[24..36], REMOTE);
    let mut rest = &datagram[36..];
    let mut said = vec![];
    while let [id, flags, a, b, after @ ..] = rest {
        let (body, next) = after.split_at(usize::from(u16::from_le_bytes([*a, *b])));
        assert_eq!(flags & 1, 1, "little-endian");
        said.push(submessage(*id, flags & 2 != 0, body));
        rest = next;
    }
    said
}

fn submessage(id: u8, is_final: bool, body: &[u8]) -> Said {
    match id {
        0x80 => Said::Announcement,
        0x09 => Said::Timestamp(u64::from_le_bytes(body.try_into().unwrap())),
        0x15 => Said::Data {
            of: body[20],
            number: number_at(body, 12),
        },
        0x07 => Said::Heartbeat {
            of: topic(body, &WRITERS, &READERS, 4),
            first: number_at(body, 8),
            last: number_at(body, 16),
            is_final,
            count: u32_at(body, 24),
        },
        0x06 => {
            let (base, missing, end) = set_at(body, 8);
            assert_eq!(body.len(), end + 4);
            Said::Acknack {
                of: topic(body, &READERS, &WRITERS, 0),
                base,
                missing,
                is_final,
                count: u32_at(body, end),
            }
        }
        0x08 => {
            let (base, list, end) = set_at(body, 16);
            assert_eq!(body.len(), end);
            Said::Gap {
                of: topic(body, &WRITERS, &READERS, 4),
                start: number_at(body, 8),
                base,
                list,
            }
        }
        id => panic!("submessage {id:#x}"),
    }
}

/// A HEARTBEAT, but for its count.
pub(super) fn heartbeat(of: usize, first: u64, last: u64, is_final: bool) -> Said {
    Said::Heartbeat {
        of,
        first,
        last,
        is_final,
        count: 0,
    }
}

/// An ACKNACK, but for its count.
pub(super) fn acknack(of: usize, base: u64, missing: impl IntoIterator<Item = u64>) -> Said {
    let missing: Vec<_> = missing.into_iter().collect();
    Said::Acknack {
        of,
        base,
        is_final: missing.is_empty(),
        missing,
        count: 0,
    }
}

/// The same without counts.
pub(super) fn uncounted(mut said: Vec<Said>) -> Vec<Said> {
    for one in &mut said {
        if let Said::Heartbeat { count, .. } | Said::Acknack { count, .. } = one {
            assert_ne!(*count, 0, "counts begin at 1");
            *count = 0;
        }
    }
    said
}
