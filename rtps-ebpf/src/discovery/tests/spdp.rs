//! Announcements of participants.

use std::vec;

use super::{
    message::{
        DOMAIN, Message, OTHER, PORT, SOURCE, announcement, guid, locator, parameter_list, setting,
    },
    speech::{Said, heartbeat, listen, uncounted},
    stage::{ANSWERED, Host, NEWS, PASSED_ON, QUIET, UNKNOWN, peer, stranger},
};
use crate::{
    abi::{PEER_PROVEN, WRITER_FRAGMENTED},
    discovery::{Outcome, Setting},
};

const FOUND: Outcome = Outcome {
    new: true,
    speaks: true,
    ..NEWS
};

fn announced(little: bool) -> Message {
    Message::new(little).announce(&announcement(little))
}

#[test]
fn a_stranger_is_remembered_told_and_answered() {
    let host = Host::new().with(0, 1..=4, 100).with(1, [7], 100);
    for little in [false, true] {
        let played = host.play(setting(), None, &announced(little));
        assert_eq!(played.outcome, FOUND);
        assert_eq!(played.peer.reply_port, PORT);
        assert_eq!(played.peer.addresses[0], SOURCE);
        assert_eq!(played.peer.flags, 0);
        assert_ne!(played.peer.announcement_hash, 0);
        assert!(played.peer.writers.iter().all(|writer| writer.next == 1));
        assert_eq!(played.datagrams.len(), 1);
        assert_eq!(
            uncounted(listen(&played.datagrams[0])),
            [
                Said::Announcement,
                heartbeat(0, 1, 4, false),
                heartbeat(1, 7, 7, false),
                heartbeat(2, 1, 0, false)
            ]
        );
    }
}

#[test]
fn who_says_the_same_again_is_answered_until_proven() {
    let host = Host::new();
    let message = announced(true);
    let mut known = host.play(setting(), None, &message).peer;
    let again = host.play(setting(), Some(&known), &message);
    assert_eq!(again.outcome, ANSWERED);
    assert_eq!(again.datagrams.len(), 1);
    let to_us = Message::to_us(true).announce(&announcement(true));
    assert_eq!(host.play(setting(), Some(&known), &to_us).outcome, QUIET);
    assert_eq!(host.play(setting(), None, &to_us).outcome, FOUND);
    known.flags |= PEER_PROVEN;
    assert_eq!(host.play(setting(), Some(&known), &message).outcome, QUIET);
}

#[test]
fn the_sequence_number_alone_is_no_change() {
    let host = Host::new();
    let message = announced(true);
    let mut known = host.play(setting(), None, &message).peer;
    known.flags |= PEER_PROVEN;
    let mut renumbered = message.clone();
    renumbered.bytes[20 + 4 + 16] = 9;
    assert_eq!(
        host.play(setting(), Some(&known), &renumbered).outcome,
        QUIET
    );
}

#[test]
fn every_byte_of_an_announcement_counts() {
    let host = Host::new();
    let mut parameters = announcement(true);
    parameters.push((0x8001, vec![0; 75 * 4]));
    let mut message = Message::new(true).announce(&parameters);
    let mut known = host.play(setting(), None, &message).peer;
    known.flags |= PEER_PROVEN;
    let value = message.bytes.len() - 4 - 300;
    for at in value..value + 300 {
        message.bytes[at] ^= 0x40;
        assert_eq!(host.play(setting(), Some(&known), &message).outcome, NEWS);
        message.bytes[at] ^= 0x40;
    }
    assert_eq!(host.play(setting(), Some(&known), &message).outcome, QUIET);
}

#[test]
fn the_order_of_parameters_is_no_change() {
    let host = Host::new();
    for little in [false, true] {
        let mut parameters = announcement(little);
        parameters.push(locator(!little, [10, 0, 1, 9], PORT));
        let message = |parameters: &[_]| Message::new(little).announce(parameters);
        let mut known = host.play(setting(), None, &message(&parameters)).peer;
        known.flags |= PEER_PROVEN;
        let outcome = |parameters: &[_]| {
            let played = host.play(setting(), Some(&known), &message(parameters));
            played.outcome
        };
        for _ in 0..parameters.len() {
            parameters.rotate_left(1);
            assert_eq!(outcome(&parameters), QUIET);
        }
        let [version, .., domain, _] = &parameters[..] else {
            panic!("{parameters:?}");
        };
        let exchanged = [(version.0, domain.1.clone()), (domain.0, version.1.clone())];
        let exchanged = [&parameters[1..4], &parameters[5..], &exchanged].concat();
        assert_eq!(outcome(&exchanged), NEWS, "values exchanged");
        let twice = [&parameters[..], &parameters[..1]].concat();
        assert_eq!(outcome(&twice), NEWS, "one more");
        assert_eq!(outcome(&parameters[1..]), NEWS, "one less");
    }
}

#[test]
fn announcements_that_are_too_long_to_compare_are_always_news() {
    let host = Host::new();
    let mut parameters = announcement(true);
    parameters.push((0x8001, vec![0; 5_000]));
    let message = Message::new(true).announce(&parameters);
    let mut known = host.play(setting(), None, &message).peer;
    known.flags |= PEER_PROVEN;
    assert_eq!(host.play(setting(), Some(&known), &message).outcome, NEWS);
}

#[test]
fn a_farewell_is_told_once_and_all_begins_anew() {
    let host = Host::new();
    let mut known = peer();
    known.writers[0].next = 9;
    known.writers[0].flags = WRITER_FRAGMENTED;
    known.readers[1].acknowledged = 5;
    let farewell = Message::new(true).farewell();
    let played = host.play(setting(), Some(&known), &farewell);
    assert_eq!(played.outcome, NEWS);
    let gone = played.peer;
    assert_eq!((gone.flags, gone.reply_port), (0, 0));
    assert_eq!((gone.writers[0].next, gone.writers[0].flags), (1, 0));
    assert_eq!(gone.readers[1].acknowledged, 0);
    assert_eq!(host.play(setting(), Some(&gone), &farewell).outcome, QUIET);
    assert_eq!(host.play(setting(), None, &farewell).outcome, UNKNOWN);
    let back = host.play(setting(), Some(&gone), &announced(true));
    assert_eq!(
        back.outcome,
        Outcome {
            speaks: true,
            ..NEWS
        }
    );
    assert_eq!(back.peer.reply_port, PORT);
}

#[test]
fn nobody_speaks_for_others() {
    let host = Host::new();
    for parameters in [
        vec![guid(OTHER), locator(false, [10, 0, 0, 9], PORT)],
        vec![locator(false, [10, 0, 0, 9], PORT)],
        vec![(0x50, vec![0; 12])],
    ] {
        let message = Message::new(true).announce(&parameters);
        assert_eq!(host.play(setting(), None, &message).outcome, UNKNOWN);
        let known = host.play(setting(), Some(&stranger()), &message);
        assert_eq!(known.outcome, QUIET);
        assert_eq!(known.peer.announcement_hash, 1);
    }
}

#[test]
fn other_domains_are_told_once_and_never_answered() {
    let host = Host::new();
    let domain = (0x0f, (DOMAIN + 1).to_be_bytes().to_vec());
    let tag = (0x4014, vec![0, 0, 0, 2, b'x', 0, 0, 0]);
    for elsewhere in [domain, tag] {
        let mut parameters = announcement(true);
        parameters.truncate(4);
        parameters.push(elsewhere);
        let message = Message::new(true).announce(&parameters);
        let played = host.play(setting(), None, &message);
        assert_eq!(played.outcome, Outcome { new: true, ..NEWS });
        assert_eq!(played.peer.reply_port, 0);
        let again = host.play(setting(), Some(&played.peer), &message);
        assert_eq!(again.outcome, QUIET);
    }
    let mut parameters = announcement(true);
    parameters.push((0x4014, vec![0, 0, 0, 1, 0, 0, 0, 0]));
    let message = Message::new(true).announce(&parameters);
    assert_eq!(host.play(setting(), None, &message).outcome, FOUND);
}

#[test]
fn answers_go_only_to_where_the_announcement_came_from() {
    let host = Host::new();
    let elsewhere = [
        locator(false, [10, 0, 1, 9], PORT),
        locator(false, [10, 0, 0, 9], 0),
        locator(false, [10, 0, 0, 9], 1 << 16),
        (0x32, [&[0, 0, 0, 9][..], &[0; 4], &SOURCE].concat()),
    ];
    for elsewhere in elsewhere {
        let message = Message::new(true).announce(&[guid(super::message::REMOTE), elsewhere]);
        let played = host.play(setting(), None, &message);
        assert_eq!(
            played.outcome,
            Outcome {
                new: true,
                ..PASSED_ON
            }
        );
        let again = host.play(setting(), Some(&played.peer), &message);
        assert_eq!(again.outcome, QUIET);
    }
}

#[test]
fn a_locator_over_ipv6() {
    let host = Host::new();
    let address = *b"\xfd\x00 some address.";
    let value = [&[0, 0, 0, 2][..], &PORT.to_be_bytes(), &address].concat();
    let message = Message::new(true).announce(&[guid(super::message::REMOTE), (0x32, value)]);
    let setting = Setting {
        source: address,
        ..setting()
    };
    let played = host.play(setting, None, &message);
    assert_eq!(played.outcome, FOUND);
    assert_eq!(played.peer.reply_port, PORT);
}

#[test]
fn what_the_kernel_may_not_answer_is_passed_on() {
    let mute = Setting {
        may_answer: false,
        ..setting()
    };
    let host = Host::new();
    let found = host.play(mute, None, &announced(true));
    assert_eq!(
        found.outcome,
        Outcome {
            new: true,
            ..PASSED_ON
        }
    );
    let again = host.play(mute, Some(&found.peer), &announced(true));
    assert_eq!(again.outcome, QUIET);

    let mut silent = Host::new();
    silent.announcement.len = 0;
    let played = silent.play(setting(), None, &announced(true));
    assert!(!played.outcome.answered && played.datagrams.is_empty());
    let narrow = Setting {
        datagram_size: 200,
        ..setting()
    };
    assert!(!host.play(narrow, None, &announced(true)).outcome.answered);
}

#[test]
fn more_parameters_than_the_kernel_reads() {
    let host = Host::new();
    let mut parameters = announcement(true);
    parameters.extend((0..200).map(|_| (0x8001, vec![0; 4])));
    let message = Message::new(true).announce(&parameters);
    let played = host.play(setting(), Some(&stranger()), &message);
    assert_eq!(played.outcome, PASSED_ON);
    let found = host.play(setting(), None, &message);
    let new = Outcome {
        new: true,
        ..PASSED_ON
    };
    assert_eq!(found.outcome, new);
    let again = host.play(setting(), Some(&found.peer), &message);
    assert_eq!(again.outcome, ANSWERED, "told once");
}

#[test]
fn lists_that_are_broken_are_nothing() {
    let host = Host::new();
    let whole = parameter_list(true, &announcement(false));
    let message = |payload: &[u8]| Message::new(true).announce_raw(4, payload);
    assert_eq!(host.play(setting(), None, &message(&whole)).outcome, FOUND);
    for len in (4..whole.len()).step_by(4) {
        let outcome = host.play(setting(), None, &message(&whole[..len])).outcome;
        assert_eq!(outcome, UNKNOWN, "{len}");
    }
    for (at, byte) in [(1, 9), (6, 3), (7, 0xff)] {
        let mut broken = whole.clone();
        broken[at] = byte;
        let outcome = host.play(setting(), None, &message(&broken)).outcome;
        assert_eq!(outcome, UNKNOWN, "{at}");
    }
    let key = Message::new(true).announce_raw(8, &whole);
    assert_eq!(host.play(setting(), None, &key).outcome, UNKNOWN);
}
