//! What our built-in writers answer.

use std::{vec, vec::Vec};

use super::{
    message::{Message, NOW, setting},
    speech::{Said, heartbeat, listen, uncounted},
    stage::{ANSWERED, Host, PASSED_ON, Played, QUIET, peer},
};
use crate::{
    abi::{Peer, WRITER_INCOMPLETE},
    discovery::{MAX_DATAGRAMS, Setting},
};

fn ask(host: &Host, known: &Peer, base: u64, members: &[u64]) -> (Played, Vec<Said>) {
    let message = Message::to_us(false).acknack(0, base, members, true);
    let (played, said) = host.hear(known, &message);
    (played, uncounted(said))
}

fn data(number: u64) -> Said {
    Said::Data { of: 0, number }
}

fn gap(start: u64, base: u64, list: &[u64]) -> Said {
    Said::Gap {
        of: 0,
        start,
        base,
        list: list.to_vec(),
    }
}

#[test]
fn what_is_asked_for_is_sent() {
    let host = Host::new().with(0, 1..=12, 100);
    let (played, said) = ask(&host, &peer(), 8, &[8, 9, 11, 12, 13]);
    assert_eq!(played.outcome, ANSWERED);
    assert_eq!(played.peer.readers[0].acknowledged, 8);
    assert_eq!(
        said,
        [
            Said::Timestamp(0),
            data(8),
            data(9),
            Said::Timestamp(1),
            data(11),
            data(12),
            heartbeat(0, 1, 12, false)
        ]
    );
}

#[test]
fn what_is_gone_is_said_to_be() {
    let host = Host::new().with(0, [4, 5, 8, 20], 100);
    let says = |base, members: &[u64]| ask(&host, &peer(), base, members).1;
    assert_eq!(
        says(1, &[1, 2, 4, 6, 9, 11]),
        [
            gap(1, 4, &[6, 9, 11]),
            Said::Timestamp(0),
            data(4),
            heartbeat(0, 4, 20, false)
        ]
    );
    assert_eq!(
        says(9, &[9]),
        [gap(9, 20, &[]), heartbeat(0, 4, 20, false)],
        "as far as it reaches"
    );
    assert_eq!(
        says(0, &[0, 4]),
        [Said::Timestamp(0), data(4), heartbeat(0, 4, 20, false)],
        "there is no number 0"
    );
    let mut empty = Host::new();
    empty.writers[0].last = 5;
    empty.writers[0].first = 6;
    let (_, said) = ask(&empty, &peer(), 2, &[3]);
    assert_eq!(said, [gap(3, 6, &[]), heartbeat(0, 6, 5, false)]);
}

#[test]
fn an_acknowledgement_alone_is_noted() {
    let host = Host::new().with(0, 1..=3, 100);
    let (played, said) = ask(&host, &peer(), 4, &[]);
    assert_eq!((played.outcome, said), (QUIET, vec![]));
    assert_eq!(played.peer.readers[0].acknowledged, 4);
    let (played, said) = ask(&host, &peer(), 3, &[7]);
    assert_eq!((played.outcome, said), (QUIET, vec![]), "not sent yet");
}

#[test]
fn who_wants_a_heartbeat_gets_one_and_no_storm_of_them() {
    let host = Host::new().with(0, 1..=3, 100);
    let wants = |known: &Peer, base, now_ns| {
        let message = Message::to_us(true).acknack(0, base, &[], false);
        let setting = Setting {
            now_ns,
            ..setting()
        };
        host.play(setting, Some(known), &message)
    };
    let first = wants(&peer(), 1, NOW);
    let said = uncounted(listen(&first.datagrams[0]));
    assert_eq!(said, [heartbeat(0, 1, 3, false)]);
    let all = wants(&peer(), 4, NOW);
    let said = uncounted(listen(&all.datagrams[0]));
    assert_eq!(said, [heartbeat(0, 1, 3, true)], "it has all");
    assert_eq!(wants(&first.peer, 1, NOW + 1_000_000).outcome, QUIET);
    assert_eq!(wants(&first.peer, 1, NOW + 2_000_000).outcome, ANSWERED);
}

#[test]
fn what_was_just_sent_is_on_its_way() {
    let host = Host::new().with(0, 1..=9, 100);
    let sent = ask(&host, &peer(), 1, &[1, 2, 5]).0.peer;
    assert_eq!((sent.readers[0].sent_from, sent.readers[0].sent_to), (1, 6));
    let (again, said) = ask(&host, &sent, 2, &[2, 5]);
    assert_eq!((again.outcome, said), (QUIET, vec![]));
    let (_, more) = ask(&host, &sent, 2, &[2, 5, 7]);
    let expected = [Said::Timestamp(0), data(7), heartbeat(0, 1, 9, false)];
    assert_eq!(more, expected);
    let message = Message::to_us(true).acknack(0, 2, &[2], true);
    let later = Setting {
        now_ns: NOW + 10_000_000,
        ..setting()
    };
    let played = host.play(later, Some(&sent), &message);
    assert_eq!(played.outcome, ANSWERED);
}

#[test]
fn many_samples_take_many_datagrams() {
    let host = Host::new().with(0, 1..=256, 1_200);
    let members: Vec<u64> = (1..=256).collect();
    let message = Message::to_us(true).acknack(0, 1, &members, true);
    let played = host.play(setting(), Some(&peer()), &message);
    assert_eq!(played.datagrams.len(), MAX_DATAGRAMS as usize);
    let mut numbers = vec![];
    for datagram in &played.datagrams {
        assert!(datagram.len() <= 1_472);
        let said = listen(datagram);
        assert!(matches!(said[0], Said::Timestamp(_)), "one in each");
        numbers.extend(said.into_iter().filter_map(|said| match said {
            Said::Data { number, .. } => Some(number),
            _ => None,
        }));
    }
    assert_eq!(numbers, members[..numbers.len()]);
    assert_eq!(numbers.len(), MAX_DATAGRAMS as usize);
    let sent = played.peer.readers[0];
    assert_eq!((sent.sent_from, sent.sent_to), (1, 65));
    // The rest comes when it is asked for.
    let message = Message::to_us(true).acknack(0, 65, &members[64..], true);
    let rest = host.play(setting(), Some(&played.peer), &message);
    assert_eq!(listen(&rest.datagrams[0])[1], data(65));
}

#[test]
fn several_writers_share_a_datagram() {
    let host = Host::new().with(0, 1..=2, 100).with(1, 1..=2, 100);
    let message = Message::to_us(true)
        .heartbeat(0, 1, 1, false)
        .acknack(1, 1, &[1], true)
        .acknack(0, 2, &[2], true);
    let (_, said) = host.hear(&peer(), &message);
    assert_eq!(
        uncounted(said),
        [
            super::speech::acknack(0, 1, [1]),
            Said::Timestamp(0),
            data(2),
            heartbeat(0, 1, 2, false),
            Said::Data { of: 1, number: 1 },
            heartbeat(1, 1, 2, false),
        ]
    );
}

#[test]
fn what_the_map_does_not_have_is_for_rtpsd() {
    let mut host = Host::new().with(0, 1..=3, 100);
    host.samples.get_mut(&(0, 2)).unwrap().len = 0;
    assert_eq!(ask(&host, &peer(), 1, &[1]).0.outcome, ANSWERED);
    assert_eq!(ask(&host, &peer(), 1, &[1, 2]).0.outcome, PASSED_ON);
    let mut host = Host::new().with(0, [1, 3], 100);
    host.writers[0].flags = WRITER_INCOMPLETE;
    assert_eq!(ask(&host, &peer(), 1, &[1, 3]).0.outcome, ANSWERED);
    assert_eq!(ask(&host, &peer(), 1, &[1, 2]).0.outcome, PASSED_ON);
    let host = Host::new().with(0, [1], 1_408);
    let narrow = Setting {
        datagram_size: 1_455,
        ..setting()
    };
    let message = Message::to_us(true).acknack(0, 1, &[1], true);
    let played = host.play(narrow, Some(&peer()), &message);
    assert_eq!(played.outcome, PASSED_ON);
    assert_eq!(host.hear(&peer(), &message).0.outcome, ANSWERED);
}
