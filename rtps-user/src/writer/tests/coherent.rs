//! Coherent sets and groups, as they are on the wire.

use super::*;
use crate::qos::{Presentation, PresentationScope};
use crate::wire::PayloadKind;

fn coherent(scope: PresentationScope, durability: Durability) -> Qos {
    Qos {
        presentation: Presentation {
            scope,
            coherent: true,
            ordered: false,
        },
        ..reliable(durability)
    }
}

/// A line for each DATA with what it says of sets and groups, HEARTBEATs with their groups, and GAPs.
fn lines(bench: &mut Bench) -> Vec<String> {
    let describe = |submessage: &Submessage<'_>| match submessage {
        Submessage::Data(data) => {
            let number = |number: Option<SequenceNumber>| match number {
                Some(SequenceNumber::UNKNOWN) => "end".to_owned(),
                Some(number) => number.to_string(),
                None => "-".to_owned(),
            };
            let qos = data.inline_qos;
            let empty = if data.kind == PayloadKind::None {
                " empty"
            } else {
                ""
            };
            format!(
                "{} set {} group {} of {}{empty}",
                data.sequence,
                number(qos.coherent_set),
                number(qos.group_sequence),
                number(qos.group_coherent_set),
            )
        }
        Submessage::Heartbeat(heartbeat) => match heartbeat.group {
            Some(group) => format!(
                "HEARTBEAT {}: {}..={}",
                group.current, group.first, group.last
            ),
            None => "HEARTBEAT".to_owned(),
        },
        other => describe(other),
    };
    let sent = bench.sent_as(describe);
    sent.into_iter().flat_map(|(_, lines)| lines).collect()
}

#[test]
fn members_name_the_first_and_the_end_is_said_at_once() {
    let qos = coherent(PresentationScope::Topic, Durability::Volatile);
    let mut bench = matched(qos);
    bench.write(8);
    bench.writer.begin_coherent();
    bench.write(8);
    bench.write(3000);
    let end = bench.writer.end_coherent(Timestamp::default());
    assert_eq!(end, Some(SequenceNumber(4)));
    bench.write(8);
    let lines = lines(&mut bench);
    let datas: Vec<_> = lines.iter().filter(|line| line.contains("set")).collect();
    assert_eq!(
        datas,
        [
            "1 set - group - of -",
            "2 set 2 group - of -",
            "4 set end group - of - empty",
            "5 set - group - of -"
        ]
    );
}

#[test]
fn a_set_without_changes_has_no_end() {
    let mut bench = matched(coherent(PresentationScope::Topic, Durability::Volatile));
    bench.writer.begin_coherent();
    assert_eq!(bench.writer.end_coherent(Timestamp::default()), None);
    assert_eq!(bench.writer.end_coherent(Timestamp::default()), None);
    assert!(bench.lines().is_empty());
}

#[test]
fn without_coherent_access_there_are_no_sets() {
    let mut bench = matched(reliable(Durability::Volatile));
    bench.writer.begin_coherent();
    bench.write(8);
    assert_eq!(bench.writer.end_coherent(Timestamp::default()), None);
    assert_eq!(lines(&mut bench), ["1 set - group - of -"]);
}

#[test]
fn readers_without_coherent_access_get_a_gap_for_the_end() {
    let mut bench = Bench::new(coherent(PresentationScope::Topic, Durability::Volatile));
    bench.match_reader(
        1,
        7411,
        coherent(PresentationScope::Topic, Durability::Volatile),
    );
    bench.match_reader(2, 7412, reliable(Durability::Volatile));
    bench.lines();
    bench.writer.begin_coherent();
    bench.write(8);
    bench.writer.end_coherent(Timestamp::default());
    bench.write(8);
    let sent = bench.sent();
    let to = |port: u16| {
        sent.iter()
            .filter(move |(to, _)| to.iter().any(|to| to.port() == port))
    };
    let lines_to = |port| {
        to(port)
            .flat_map(|(_, lines)| lines.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(
        lines_to(7411),
        ["DATA 1 to all", "DATA 2 to 1", "DATA 3 to all"]
    );
    assert_eq!(
        lines_to(7412),
        ["DATA 1 to all", "GAP 2..3 [] to 2", "DATA 3 to all"]
    );
}

#[test]
fn ends_stay_as_long_as_their_sets() {
    let qos = Qos {
        history: History::KeepLast(1),
        ..coherent(PresentationScope::Topic, Durability::TransientLocal)
    };
    let mut bench = Bench::new(qos.clone());
    let write = |bench: &mut Bench, instance: u8| {
        let change = NewChange {
            instance: KeyHash([instance; 16]),
            ..change(8)
        };
        bench.writer.write(bench.now, change).unwrap();
    };
    for set in 0..200 {
        bench.writer.begin_coherent();
        // The first set alone has a change of its own.
        for instance in if set == 0 { 1..4 } else { 2..4 } {
            write(&mut bench, instance);
        }
        bench.writer.end_coherent(Timestamp::default());
        assert!(bench.writer.history.len() < 30, "ends pile up");
    }
    bench.match_reader(1, 7411, qos);
    bench.acknack(1, 1, &[1, 4]);
    let lines = lines(&mut bench);
    assert!(
        lines.iter().any(|line| line.starts_with("1 set 1")),
        "{lines:?}"
    );
    assert!(
        lines.iter().any(|line| line.starts_with("4 set end")),
        "{lines:?}"
    );
    assert_eq!(bench.writer.history.samples(), 3);
}

#[test]
fn an_open_set_may_exceed_the_window() {
    let timing = WriterTiming {
        max_unacknowledged_bytes: 1000,
        min_unacknowledged_bytes: 1000,
        ..WriterTiming::default()
    };
    let qos = coherent(PresentationScope::Topic, Durability::Volatile);
    let mut bench = Bench::with_timing(qos.clone(), timing);
    bench.match_reader(1, 7411, qos);
    bench.writer.begin_coherent();
    let mut written = 0;
    while written < 100 {
        match bench.writer.write(bench.now, change(100)) {
            Ok(sequence) => written = sequence.0,
            Err(error) => {
                assert_eq!(error, WriteError::HistoryFull);
                bench.lines();
                bench.acknack(1, written + 1, &[]);
            }
        }
    }
    assert_eq!(
        bench.writer.end_coherent(Timestamp::default()),
        Some(SequenceNumber(101))
    );
}

#[test]
fn changes_of_a_group_are_numbered_across_writers() {
    let qos = coherent(PresentationScope::Group, Durability::Volatile);
    let mut group = Group::default();
    group.set_writers([writer_guid().entity]);
    let (mut one, mut other) = (matched(qos.clone()), matched(qos));
    let write = |bench: &mut Bench, group: &mut Group| {
        let group = Some(group);
        let written = bench.writer.write_or_return(bench.now, change(8), group);
        written.unwrap();
    };
    write(&mut one, &mut group);
    group.begin_set();
    write(&mut other, &mut group);
    write(&mut one, &mut group);
    for bench in [&mut one, &mut other] {
        bench.writer.end_coherent_in(&group, Timestamp::default());
    }
    group.end_set();
    assert_eq!(
        lines(&mut one),
        [
            "1 set - group 1 of -",
            "2 set 2 group 3 of 2",
            "3 set end group 3 of 2 empty"
        ]
    );
    assert_eq!(
        lines(&mut other),
        ["1 set 1 group 2 of 2", "2 set end group 3 of 2 empty"]
    );
    one.now += Duration::from_millis(10);
    one.writer.handle_timeout(one.now);
    assert_eq!(lines(&mut one), ["HEARTBEAT 3: 1..=3"]);
}

#[test]
fn a_writer_of_the_group_that_wrote_nothing_says_so() {
    let mut bench = matched(coherent(PresentationScope::Group, Durability::Volatile));
    let mut other = matched(coherent(PresentationScope::Group, Durability::Volatile));
    let mut group = Group::default();
    group.begin_set();
    let nothing = bench.writer.end_coherent_in(&group, Timestamp::default());
    assert_eq!(nothing, None, "nobody wrote anything");
    let written = other
        .writer
        .write_or_return(other.now, change(8), Some(&mut group));
    written.unwrap();
    bench.writer.end_coherent_in(&group, Timestamp::default());
    assert_eq!(lines(&mut bench), ["1 set end group 1 of 1 empty"]);
}

#[test]
fn a_change_that_is_refused_takes_no_number() {
    let mut qos = coherent(PresentationScope::Group, Durability::Volatile);
    qos.resource_limits.max_samples = Some(1);
    let mut bench = matched(qos);
    let mut group = Group::default();
    let mut write = || {
        bench
            .writer
            .write_or_return(bench.now, change(8), Some(&mut group))
            .is_ok()
    };
    assert!(write());
    assert!(!write());
    assert_eq!(group.last(), SequenceNumber(1));
}
