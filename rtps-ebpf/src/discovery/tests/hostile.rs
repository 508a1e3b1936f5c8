//! Whatever comes: no panic, no datagram beyond its size, no answer to who may not have one.

use std::vec::Vec;

use proptest::prelude::*;

use super::{
    message::{Message, announcement, setting},
    stage::{Host, peer, stranger},
};
use crate::{
    abi::Peer,
    discovery::{MAX_DATAGRAMS, Setting},
};

fn host() -> Host {
    Host::new()
        .with(0, (1..=300).filter(|number| number % 7 != 0), 400)
        .with(1, 5..=9, 1_408)
}

/// Numbers at all the edges.
fn numbers() -> impl Strategy<Value = u64> {
    prop_oneof![
        1..=400_u64,
        Just(i64::MAX as u64),
        Just(i64::MAX as u64 - 256),
        any::<u64>(),
        (0..63_u32).prop_map(|bit| 1 << bit),
    ]
}

fn members(base: u64, bits: &[bool]) -> Vec<u64> {
    let asked = (base..).zip(bits).filter(|(_, bit)| **bit);
    asked.map(|(number, _)| number).collect()
}

prop_compose! {
    fn messages()(
        little: bool,
        kinds in prop::collection::vec(
            (0..9_u8, 0..3_usize, numbers(), numbers(), any::<bool>(), prop::collection::vec(any::<bool>(), 0..256)),
            0..8,
        ),
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) -> Vec<u8> {
        let mut message = Message::to_us(little);
        for (kind, of, a, b, flag, bits) in kinds {
            let base = a.min(u64::MAX - 256);
            message = match kind {
                0 => message.data(of, a),
                1 => message.heartbeat(of, a, b, flag),
                2 => message.gap(of, b, base, &members(base, &bits)),
                3 => message.acknack(of, base, &members(base, &bits), flag),
                4 => message.announce(&announcement(little)),
                5 => message.farewell(),
                6 if flag => message.data_frag(of, a),
                7 if flag => message.heartbeat_frag(of, a),
                8 if flag => message.nack_frag(of, a),
                _ => message.acknack(of, a % 300, &members(a % 300, &bits), flag),
            };
        }
        let mut bytes = message.bytes;
        for (at, flip) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        bytes
    }
}

fn check(known: Option<&Peer>, setting: Setting, bytes: &[u8]) -> Result<(), TestCaseError> {
    let played = host().play_bytes(setting, known, bytes);
    let outcome = played.outcome;
    prop_assert!(played.datagrams.len() <= MAX_DATAGRAMS as usize);
    for datagram in &played.datagrams {
        prop_assert!(datagram.len() <= setting.datagram_size.min(1_472) as usize);
    }
    if outcome.unknown || !setting.may_answer || !outcome.answered {
        prop_assert!(played.datagrams.is_empty());
    }
    if outcome.unknown {
        prop_assert!(!outcome.news && !outcome.new);
    }
    Ok(())
}

proptest! {
    #[test]
    fn any_bytes(bytes: Vec<u8>, is_known: bool) {
        let known = peer();
        check(is_known.then_some(&known), setting(), &bytes)?;
    }

    #[test]
    fn messages_that_are_almost_valid(
        bytes in messages(),
        who in 0..3,
        may_answer: bool,
        datagram_size in prop_oneof![Just(1_472), 0..2_000_u32, any::<u32>()],
        next in numbers(),
        sent in numbers(),
    ) {
        let mut known = if who == 0 { peer() } else { stranger() };
        known.writers[0].next = next;
        known.readers[0].sent_from = sent;
        known.readers[0].sent_to = sent.saturating_add(9);
        known.readers[0].sent_ns = setting().now_ns;
        let setting = Setting { may_answer, datagram_size, ..setting() };
        check((who < 2).then_some(&known), setting, &bytes)?;
    }
}

#[test]
fn a_message_full_of_announcements_ends() {
    let mut parameters = announcement(true);
    parameters.extend((0..120).map(|_| (0x8001, [0; 4].to_vec())));
    let mut message = Message::new(true);
    while message.bytes.len() < 60_000 {
        message = message.announce(&parameters);
    }
    let played = host().play(setting(), Some(&stranger()), &message);
    assert!(played.outcome.news);
}
