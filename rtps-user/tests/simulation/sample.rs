//! What the tests write: a running number and an instance, in a payload of any size whose every byte is checked.

use bytes::Bytes;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::wire::{KeyHash, Timestamp};

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Encapsulation header and number.
pub(crate) const MIN_SIZE: usize = 8;

pub(crate) fn instance(number: u8) -> KeyHash {
    KeyHash([number; 16])
}

/// Sample `number` of an instance, `size` bytes long.
pub(crate) fn sample(number: u32, key: u8, size: usize) -> NewChange {
    NewChange {
        kind: ChangeKind::Alive,
        instance: instance(key),
        payload: payload(number, size),
        timestamp: Timestamp {
            seconds: number,
            fraction: 0,
        },
    }
}

/// A change that is no sample.
pub(crate) fn not_alive(kind: ChangeKind, key: u8) -> NewChange {
    NewChange {
        kind,
        payload: Bytes::from_iter(ENCAPSULATION.into_iter().chain([key; 16])),
        ..sample(0, key, MIN_SIZE)
    }
}

/// The number in a payload; panics where any byte of it is not what was written. Submessages are padded to 4
/// bytes, so up to 3 more may have come.
pub(crate) fn number(payload: &Bytes) -> u32 {
    let number = u32::from_le_bytes(payload[4..8].try_into().unwrap());
    let is_whole = (0..4).any(|padding| {
        let (written, padding) = payload.split_at(payload.len() - padding);
        *written == self::payload(number, written.len()) && padding.iter().all(|byte| *byte == 0)
    });
    assert!(is_whole, "sample {number} is corrupt");
    number
}

fn payload(number: u32, size: usize) -> Bytes {
    let mut bytes = Vec::with_capacity(size);
    bytes.extend_from_slice(&ENCAPSULATION);
    bytes.extend_from_slice(&number.to_le_bytes());
    let filler = (MIN_SIZE..size).map(|index| (index as u32).wrapping_mul(number | 1) as u8);
    bytes.extend(filler);
    bytes.into()
}

/// Checks received numbers against the expected ones; says only where they differ.
pub(crate) fn assert_numbers(received: &[u32], expected: impl IntoIterator<Item = u32>) {
    let expected: Vec<u32> = expected.into_iter().collect();
    let differ = |(a, b): (&u32, &u32)| a != b;
    let at = received.iter().zip(&expected).position(differ);
    let at = at.unwrap_or_else(|| received.len().min(expected.len()));
    assert!(
        received == expected,
        "number {at} is {:?} instead of {:?}; {} of {}",
        received.get(at),
        expected.get(at),
        received.len(),
        expected.len(),
    );
}
