//! What our built-in readers take and answer.

use std::vec::Vec;

use super::{
    message::{Message, OTHER, OWN, setting},
    speech::{Said, acknack, heartbeat, listen, uncounted},
    stage::{ANSWERED, Host, NEWS, PASSED_ON, QUIET, UNKNOWN, peer, stranger},
};
use crate::{
    abi::{PEER_PROVEN, PEER_SUPERVISED, Peer, WRITER_FRAGMENTED},
    discovery::{Outcome, Setting, count_at},
};

/// A peer that has delivered all below `next` of writer 0.
fn delivered(next: u64) -> Peer {
    let mut known = peer();
    known.writers[0].next = next;
    known
}

/// What becomes of a message of that peer, and what it has delivered then.
fn take(next: u64, message: &Message) -> (Outcome, u64) {
    let played = Host::new().play(setting(), Some(&delivered(next)), message);
    (played.outcome, played.peer.writers[0].next)
}

#[test]
fn samples_are_taken_in_order() {
    for little in [false, true] {
        let data = |number| Message::to_us(little).data(0, number);
        assert_eq!(take(5, &data(4)), (QUIET, 5), "a duplicate");
        assert_eq!(take(5, &data(5)), (NEWS, 6));
        assert_eq!(take(5, &data(6)), (QUIET, 5), "will be asked for");
        assert_eq!(take(5, &data(5).data(0, 6).data(0, 8)), (NEWS, 7));
        assert_eq!(take(1 << 40, &data(1 << 40)), (NEWS, (1 << 40) + 1));
    }
    assert_eq!(take(0, &Message::to_us(true).data(0, 1)), (NEWS, 2));
}

#[test]
fn participant_messages_wake_nobody_who_does_not_wait_for_them() {
    let mut known = peer();
    let message = Message::to_us(true).data(2, 7);
    let played = Host::new().play(setting(), Some(&known), &message);
    assert_eq!((played.outcome, played.peer.writers[2].next), (QUIET, 8));
    known.flags |= PEER_SUPERVISED;
    let played = Host::new().play(setting(), Some(&known), &message);
    assert_eq!((played.outcome, played.peer.writers[2].next), (NEWS, 8));
    let again = Host::new().play(setting(), Some(&played.peer), &message);
    assert_eq!(again.outcome, QUIET);
    // Replaced by later ones: not worth a question.
    let message = Message::to_us(true).heartbeat(2, 9, 9, true);
    let (played, said) = Host::new().hear(&known, &message);
    assert_eq!(played.outcome, ANSWERED);
    assert_eq!(uncounted(said), [acknack(2, 9, [9])]);
}

#[test]
fn fragments_are_for_rtpsd() {
    let of_others = Message::to_us(true).data_frag(0, 4).heartbeat_frag(0, 4);
    assert_eq!(take(5, &of_others), (QUIET, 5));
    for message in [
        Message::to_us(true).heartbeat_frag(0, 5),
        Message::to_us(true).nack_frag(0, 1),
    ] {
        assert_eq!(take(5, &message), (PASSED_ON, 5));
    }
    let played = Host::new().play(
        setting(),
        Some(&delivered(5)),
        &Message::to_us(true).data_frag(0, 6),
    );
    assert_eq!(played.outcome, PASSED_ON);
    assert_eq!(played.peer.writers[0].flags, WRITER_FRAGMENTED);
    let heartbeat = Message::to_us(true).heartbeat(0, 1, 9, false);
    let next = Host::new().play(setting(), Some(&played.peer), &heartbeat);
    assert_eq!(next.outcome, PASSED_ON);
}

#[test]
fn gaps() {
    let gap = |start, base, members: &[u64]| Message::to_us(true).gap(0, start, base, members);
    assert_eq!(take(5, &gap(5, 9, &[])), (NEWS, 9));
    assert_eq!(take(5, &gap(1, 9, &[])), (NEWS, 9));
    assert_eq!(take(5, &gap(1, 5, &[])), (QUIET, 5), "known");
    assert_eq!(take(5, &gap(1, 4, &[4])), (QUIET, 5), "known");
    assert_eq!(take(5, &gap(7, 9, &[])), (NEWS, 5), "later numbers");
    assert_eq!(take(5, &gap(3, 4, &[4, 8])), (NEWS, 5), "later numbers");
    assert_eq!(take(5, &gap(5, 1 << 40, &[])), (NEWS, 5), "incredible");
    assert_eq!(
        take(5, &gap(5, i64::MAX as u64 - 256, &[])),
        (NEWS, 5),
        "incredible"
    );
}

#[test]
fn heartbeats_are_answered() {
    let host = Host::new();
    let answer = |first, last, is_final| {
        let message = Message::to_us(false).heartbeat(0, first, last, is_final);
        let (played, said) = host.hear(&delivered(5), &message);
        (played.outcome, uncounted(said))
    };
    let missing = |last| [acknack(0, 5, 5..=last)].to_vec();
    assert_eq!(answer(1, 9, false), (ANSWERED, missing(9)));
    assert_eq!(answer(5, 5, true), (ANSWERED, missing(5)));
    assert_eq!(answer(1, 1000, true), (ANSWERED, missing(5 + 255)));
    assert_eq!(answer(1, 36, true), (ANSWERED, missing(36)));
    assert_eq!(answer(1, 37, true), (ANSWERED, missing(37)));
    assert_eq!(answer(1, i64::MAX as u64, true), (ANSWERED, missing(260)));
    assert_eq!(
        answer(1, 4, false),
        (ANSWERED, [acknack(0, 5, [])].to_vec())
    );
    assert_eq!(answer(1, 4, true), (QUIET, [].to_vec()));
    assert_eq!(answer(6, 9, false), (PASSED_ON, [].to_vec()), "lost");
}

#[test]
fn an_answer_knows_what_else_is_in_the_message() {
    let message = Message::to_us(true)
        .heartbeat(0, 1, 7, false)
        .data(0, 5)
        .heartbeat(1, 1, 2, true);
    let (played, said) = Host::new().hear(&delivered(5), &message);
    assert_eq!(
        played.outcome,
        Outcome {
            speaks: true,
            ..NEWS
        }
    );
    assert_eq!(
        uncounted(said),
        [acknack(0, 6, [6, 7]), acknack(1, 1, [1, 2])]
    );
}

#[test]
fn counts_grow() {
    let mut known = delivered(5);
    let message = Message::to_us(true).heartbeat(0, 1, 9, false);
    let mut counts = [0; 3];
    for count in &mut counts {
        let (played, said) = Host::new().hear(&known, &message);
        known = played.peer;
        let [Said::Acknack { count: said, .. }] = said[..] else {
            panic!("{said:?}");
        };
        *count = said;
    }
    let first = count_at(setting().age_ns);
    assert_eq!(counts, [first, first + 1, first + 2]);
}

#[test]
fn who_names_us_is_proven() {
    let host = Host::new();
    let named = Message::to_us(true).data(0, 1);
    let played = host.play(setting(), Some(&stranger()), &named);
    let proof = Outcome {
        speaks: true,
        ..NEWS
    };
    assert_eq!(played.outcome, proof);
    assert_eq!(played.peer.flags, PEER_PROVEN);
    assert_eq!(played.peer.writers[0].next, 2);
    // It may have known us before, and be silent: its writers are greeted.
    let mut said = uncounted(listen(&played.datagrams[0]));
    // It may not have known ours when we announced ourselves.
    let heartbeats: Vec<_> = said.drain(..3).collect();
    assert_eq!(heartbeats, [0, 1, 2].map(|of| heartbeat(of, 1, 0, false)));
    let greetings = [(0, 2), (1, 1), (2, 1)].map(|(of, base)| Said::Acknack {
        of,
        base,
        missing: std::vec![],
        is_final: false,
        count: 0,
    });
    assert_eq!(said, greetings);
    let heartbeat = Message::to_us(true).heartbeat(0, 1, 0, true);
    let played = host.play(setting(), Some(&stranger()), &heartbeat);
    assert_eq!(played.outcome, proof);
    assert_eq!(listen(&played.datagrams[0]).len(), 5, "this one has spoken");
    // What it says to everybody is not taken until then, but it is asked to say it to us.
    let everybody = Message::new(true).data(0, 1).heartbeat(0, 1, 1, false);
    let played = host.play(setting(), Some(&stranger()), &everybody);
    assert_eq!(played.outcome, ANSWERED);
    assert_eq!(played.peer.flags, 0);
    assert_eq!(played.peer.writers[0].next, 1);
    let beyond = Message::new(true).heartbeat(0, 9, 9, false);
    let played = host.play(setting(), Some(&stranger()), &beyond);
    assert_eq!(played.outcome, QUIET);
    let known = host.play(setting(), Some(&peer()), &everybody);
    assert!(known.outcome.news && known.outcome.speaks);
}

#[test]
fn so_is_who_acknowledges_without_naming_us() {
    let host = Host::new();
    let acknack = Message::new(true).acknack(0, 1, &[], true);
    let played = host.play(setting(), Some(&stranger()), &acknack);
    assert!(played.outcome.news && played.outcome.speaks);
    assert_eq!(played.peer.flags, PEER_PROVEN);
    let foreign = Message::new(true).destination(OTHER);
    let foreign = foreign.acknack(0, 1, &[], true);
    let played = host.play(setting(), Some(&stranger()), &foreign);
    assert_eq!((played.outcome, played.peer.flags), (QUIET, 0));
}

#[test]
fn the_unknown_count_for_nothing() {
    let message = Message::to_us(true)
        .data(0, 1)
        .heartbeat(0, 1, 9, false)
        .acknack(0, 1, &[1], false)
        .data_frag(0, 1);
    let played = Host::new().play(setting(), None, &message);
    assert!(played.outcome.unknown && !played.outcome.news && !played.outcome.speaks);
    assert_eq!(
        Host::new()
            .play(setting(), None, &Message::to_us(true).data(0, 1))
            .outcome,
        UNKNOWN
    );
}

#[test]
fn what_is_for_others_or_relayed() {
    let foreign = Message::new(true).destination(OTHER).data(0, 5);
    assert_eq!(take(5, &foreign), (QUIET, 5));
    let foreign = foreign.destination(OWN).data(0, 5);
    assert_eq!(take(5, &foreign), (NEWS, 6));
    let relayed = Message::to_us(true).source(OTHER).data(0, 5);
    assert_eq!(take(5, &relayed), (PASSED_ON, 5));
    let same = Message::to_us(true)
        .source(super::message::REMOTE)
        .data(0, 5);
    assert_eq!(take(5, &same), (NEWS, 6));
}

#[test]
fn questions_about_types_are_for_rtpsd() {
    let host = Host::new();
    let played = |writer: [u8; 4]| {
        let message = Message::to_us(true);
        let body = message.body().raw(&[0; 4]).raw(&writer);
        let body = body.number(1).number(1).u32(1);
        let message = message.submessage(0x07, 1, body);
        host.play(setting(), Some(&delivered(5)), &message).outcome
    };
    assert_eq!(played([0, 3, 0, 0xc3]), NEWS);
    assert_eq!(played([0, 3, 1, 0xc3]), NEWS);
    assert_eq!(played([0, 3, 2, 0xc3]), QUIET);
}

#[test]
fn what_the_kernel_may_not_answer_is_passed_on() {
    let message = Message::to_us(true).heartbeat(0, 1, 9, false);
    let mute = Setting {
        may_answer: false,
        ..setting()
    };
    let host = Host::new();
    let played = host.play(mute, Some(&delivered(5)), &message);
    assert_eq!(played.outcome, PASSED_ON);
    let data = Message::to_us(true).data(0, 5);
    assert_eq!(host.play(mute, Some(&delivered(5)), &data).outcome, NEWS);
    let mut unreachable = delivered(5);
    unreachable.reply_port = 0;
    let played = host.play(setting(), Some(&unreachable), &message);
    assert_eq!(played.outcome, PASSED_ON);
}
