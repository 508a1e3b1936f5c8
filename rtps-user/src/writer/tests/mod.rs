//! A writer alone, its readers played by hand: exactly which submessages leave it, and when.

mod bench;
mod coherent;
mod durability_service;
mod flow;
mod fragments;
mod policies;
mod selection;
mod shared;

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use bench::{Bench, DATAGRAM, Sent, change, describe, matched, reader_guid, reliable, writer_guid};

use super::*;
use crate::RemoteEndpoint;
use crate::history::ChangeKind;
use crate::qos::{Durability, History, Liveliness, Reliability};
use crate::wire::{
    EntityId, EntityKind, FragmentNumberSet, GuidPrefix, KeyHash, MessageReceiver, Received,
    SequenceNumberSet, Submessage, Timestamp,
};

#[test]
fn readers_behind_one_address_share_a_datagram() {
    let mut bench = Bench::new(Qos::default());
    for (reader, port) in [(1, 7411), (2, 7411), (3, 7413)] {
        bench.match_reader(reader, port, Qos::default());
    }
    bench.write(100);
    let sent = bench.sent();
    let [(destinations, lines)] = sent.as_slice() else {
        panic!("one datagram, not {sent:?}");
    };
    let ports: Vec<_> = destinations.iter().map(SocketAddr::port).collect();
    assert_eq!(ports, [7411, 7413]);
    assert_eq!(lines, &["DATA 1 to all"]);
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn small_changes_share_a_datagram_when_they_pile_up() {
    let mut bench = Bench::new(Qos::default());
    bench.match_reader(1, 7411, Qos::default());
    bench.writer.config.qos.history = History::KeepAll;
    for _ in 0..10 {
        bench.write(100);
    }
    assert_eq!(bench.sent().len(), 2);
}

#[test]
fn replaced_before_sent_is_said_to_reliable_readers_only() {
    for (reliability, first) in [
        (Reliability::RELIABLE, Some("GAP 1..3 [] to all")),
        (Reliability::BestEffort, None),
    ] {
        let qos = Qos {
            reliability,
            ..Qos::default()
        };
        let mut bench = Bench::new(qos.clone());
        bench.match_reader(1, 7411, qos);
        bench.lines();
        for _ in 0..3 {
            bench.write(10);
        }
        let expected: Vec<_> = first.into_iter().chain(["DATA 3 to all"]).collect();
        assert_eq!(bench.lines(), expected);
    }
}

#[test]
fn reminders_come_ever_later_and_end_with_the_acknowledgement() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(100);
    assert_eq!(bench.lines(), ["DATA 1 to all"]);
    assert!(bench.pass(Duration::from_millis(9)).is_empty());
    let reminder = ["HEARTBEAT 1..=1 to 1"];
    assert_eq!(bench.pass(Duration::from_millis(1)), reminder);
    assert!(bench.pass(Duration::from_millis(19)).is_empty());
    assert_eq!(bench.pass(Duration::from_millis(1)), reminder);
    let reminders = bench.pass(Duration::from_secs(60)).len();
    assert!((60..70).contains(&reminders), "{reminders}");
    bench.acknack(1, 2, &[]);
    assert_eq!(bench.writer.poll_event(), Some(WriterEvent::Acknowledged));
    assert!(bench.writer.all_acknowledged());
    assert!(bench.pass(Duration::from_secs(60)).is_empty());
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn a_heartbeat_travels_with_every_so_many_changes() {
    let timing = WriterTiming {
        heartbeat_samples: 32,
        ..WriterTiming::default()
    };
    let qos = reliable(Durability::Volatile);
    let mut bench = Bench::with_timing(qos.clone(), timing);
    bench.match_reader(1, 7411, qos);
    bench.lines();
    let mut heartbeats = 0;
    for number in 1..=96 {
        bench.write(100);
        let lines = bench.lines();
        heartbeats += lines.len() - 1;
        assert_eq!(lines.len() == 2, number % 32 == 0, "{lines:?}");
    }
    assert_eq!(heartbeats, 3);
}

#[test]
fn the_heartbeat_for_a_full_history_comes_in_time() {
    let mut qos = reliable(Durability::Volatile);
    qos.resource_limits.max_samples = Some(8);
    let mut bench = matched(qos);
    for _ in 0..8 {
        bench.write(100);
    }
    assert!(bench.writer.write(bench.now, change(100)).is_err());
    let lines = bench.lines();
    assert_eq!(lines.last().unwrap(), "HEARTBEAT 1..=8 to all");
}

#[test]
fn missing_changes_are_repeated_and_gone_ones_are_gaps() {
    let mut bench = matched(reliable(Durability::Volatile));
    for _ in 0..9 {
        bench.write(100);
    }
    bench.lines();
    for gone in [2, 3, 5, 7] {
        bench.writer.remove(SequenceNumber(gone));
    }
    bench.acknack(1, 2, &[2, 3, 4, 5, 6, 7, 300]);
    assert_eq!(
        bench.lines(),
        [
            "GAP 2..4 [5, 7] to 1",
            "DATA 4 to 1",
            "DATA 6 to 1",
            "HEARTBEAT 4..=9 to 1"
        ]
    );
}

#[test]
fn the_same_request_waits_ever_longer() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(100);
    bench.write(100);
    bench.lines();
    let repair = ["DATA 2 to 1", "HEARTBEAT 2..=2 to 1"];
    bench.acknack(1, 2, &[2]);
    assert_eq!(bench.lines(), repair);
    for delay in [2, 4, 8] {
        bench.acknack(1, 2, &[2]);
        assert!(bench.pass(Duration::from_millis(delay - 1)).is_empty());
        assert_eq!(bench.pass(Duration::from_millis(1)), repair, "{delay} ms");
    }
}

#[test]
fn a_volatile_late_joiner_is_told_where_to_begin() {
    let mut bench = matched(reliable(Durability::TransientLocal));
    bench.write(100);
    bench.write(100);
    bench.lines();
    bench.match_reader(2, 7412, reliable(Durability::Volatile));
    let greeting = ["GAP 1..3 [] to 2", "HEARTBEAT 3..=2 final to 2"];
    assert_eq!(bench.lines(), greeting);
    bench.acknack(2, 1, &[1, 2]);
    assert_eq!(bench.lines(), greeting);
}

#[test]
fn a_transient_local_late_joiner_asks_and_gets() {
    let mut bench = matched(reliable(Durability::TransientLocal));
    bench.write(100);
    bench.write(100);
    bench.lines();
    bench.acknack(1, 3, &[]);
    bench.match_reader(2, 7412, reliable(Durability::TransientLocal));
    assert_eq!(bench.lines(), ["HEARTBEAT 1..=2 to 2"]);
    assert!(!bench.writer.all_acknowledged());
    bench.acknack(2, 1, &[1, 2]);
    assert_eq!(
        bench.lines(),
        ["DATA 1 to 2", "DATA 2 to 2", "HEARTBEAT 1..=2 to 2"]
    );
}

#[test]
fn a_preemptive_acknack_is_answered() {
    for base in [0, 1] {
        let mut bench = matched(reliable(Durability::TransientLocal));
        bench.write(100);
        bench.lines();
        bench.acknack_with(1, base, &[], true);
        assert!(bench.lines().is_empty(), "a final one asks for nothing");
        bench.acknack_with(1, base, &[], false);
        assert_eq!(bench.lines(), ["HEARTBEAT 1..=1 to 1"]);
    }
}

#[test]
fn a_volatile_reader_that_missed_its_greeting_is_told_once_more_where_to_begin() {
    let mut bench = matched(reliable(Durability::TransientLocal));
    bench.match_reader(2, 7412, reliable(Durability::Volatile));
    bench.lines();
    bench.write(100);
    bench.lines();
    bench.acknack_with(2, 1, &[], false);
    let nothing_yet = "HEARTBEAT 1..=0 final to 2";
    assert_eq!(bench.lines(), [nothing_yet, "HEARTBEAT 1..=1 to 2"]);
    bench.match_reader(3, 7413, reliable(Durability::Volatile));
    bench.lines();
    bench.write(100);
    bench.lines();
    bench.acknack_with(3, 1, &[], false);
    let greeting = ["GAP 1..2 [] to 3", "HEARTBEAT 2..=2 to 3"];
    assert_eq!(bench.lines(), greeting);
}

#[test]
fn duplicate_and_old_counts_are_ignored() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(100);
    bench.lines();
    bench.count = 10;
    bench.acknack(1, 1, &[1]);
    assert_eq!(bench.lines().len(), 2);
    bench.count = 10;
    bench.acknack(1, 2, &[]);
    bench.count = 3;
    bench.acknack(1, 2, &[]);
    assert!(!bench.writer.all_acknowledged());
}

#[test]
fn large_changes_are_fragments_and_a_heartbeat() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(3000);
    let lines = bench.lines();
    assert_eq!(
        lines,
        [
            "DATA_FRAG 1.1 to all",
            "DATA_FRAG 1.2 to all",
            "DATA_FRAG 1.3 to all",
            "HEARTBEAT 1..=1 to all"
        ]
    );
    bench.nack_frag(1, 1, &[2, 3, 4]);
    assert_eq!(
        bench.lines(),
        [
            "DATA_FRAG 1.2 to 1",
            "DATA_FRAG 1.3 to 1",
            "HEARTBEAT 1..=1 to 1"
        ]
    );
    bench.nack_frag(1, 7, &[1]);
    assert!(bench.lines().is_empty(), "never sent, never repeated");
}

#[test]
fn what_is_half_sent_is_not_in_heartbeats() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(3000);
    let mut out = Vec::new();
    assert!(bench.writer.poll_transmit(bench.now, &mut out).is_some());
    bench.acknack_with(1, 1, &[], false);
    let lines = bench.lines();
    assert_eq!(lines[0], "HEARTBEAT 1..=0 final to 1");
}

#[test]
fn manual_liveliness_is_asserted_and_lost() {
    let lease = crate::wire::Duration::from_std(Duration::from_secs(1));
    let kind = LivelinessKind::ManualByTopic;
    let mut bench = matched(Qos {
        liveliness: Liveliness { kind, lease },
        ..reliable(Durability::Volatile)
    });
    bench.writer.assert_liveliness(bench.now);
    assert_eq!(bench.lines(), ["HEARTBEAT 1..=0 final alive to all"]);
    bench.pass(Duration::from_millis(999));
    assert_eq!(bench.writer.poll_event(), None);
    bench.pass(Duration::from_millis(1));
    assert_eq!(bench.writer.poll_event(), Some(WriterEvent::LivelinessLost));
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn a_resumed_writer_counts_on() {
    let mut bench = Bench::new(reliable(Durability::Volatile));
    bench.writer.resume_from(SequenceNumber(100), 7);
    bench.match_reader(1, 7411, reliable(Durability::Volatile));
    let greeting = ["GAP 1..100 [] to 1", "HEARTBEAT 100..=99 final to 1"];
    assert_eq!(bench.lines(), greeting);
    bench.write(100);
    assert_eq!(bench.lines(), ["DATA 100 to all"]);
}

#[test]
fn all_fragments_are_repeated_that_several_sets_ask_for() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.write(1_000_000);
    bench.lines();
    bench.pass(Duration::from_secs(1));
    let wanted: Vec<u32> = (1..=512).collect();
    let (first, second) = wanted.split_at(256);
    bench.nack_frag(1, 1, first);
    bench.nack_frag(1, 1, second);
    // Asked for again before it was sent.
    bench.nack_frag(1, 1, &first[200..]);
    let is_repair = |line: &String| line.starts_with("DATA_FRAG") && line.ends_with("to 1");
    let repairs = bench.pass(Duration::from_millis(500));
    let mut repairs: Vec<_> = repairs.into_iter().filter(is_repair).collect();
    assert_eq!(repairs.len(), 512);
    repairs.sort();
    repairs.dedup();
    assert_eq!(repairs.len(), 512);
}

#[test]
fn a_later_acknack_does_not_cancel_what_waits_to_be_sent() {
    let mut bench = matched(reliable(Durability::Volatile));
    for _ in 0..5 {
        bench.write(100);
    }
    bench.lines();
    bench.acknack(1, 1, &[1, 2, 3]);
    assert_eq!(bench.lines().len(), 4);
    bench.acknack(1, 2, &[2, 4]);
    assert!(bench.lines().is_empty(), "2 was sent just now");
    bench.acknack(1, 3, &[]);
    bench.acknack(1, 3, &[5]);
    let repairs = bench.pass(Duration::from_millis(100));
    assert_eq!(
        repairs[..3],
        ["DATA 4 to 1", "DATA 5 to 1", "HEARTBEAT 3..=5 to 1"],
        "{repairs:?}"
    );
}
