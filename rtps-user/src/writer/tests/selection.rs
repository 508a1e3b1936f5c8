//! Readers that do not want everything.

use super::*;
use crate::filter::PayloadFilter;
use crate::wire::{FilterSignature, PayloadKind};

/// Wants the payloads that begin with that byte.
fn only(first: u8) -> Option<(PayloadFilter, FilterSignature)> {
    let passes: PayloadFilter = Arc::new(move |kind, payload: &[u8]| {
        kind != PayloadKind::Data || payload.first() == Some(&first)
    });
    Some((passes, signature(first)))
}

fn signature(first: u8) -> FilterSignature {
    FilterSignature([first; 16])
}

impl Bench {
    fn write_first(&mut self, first: u8, bytes: usize) {
        let change = NewChange {
            payload: vec![first; bytes].into(),
            ..change(0)
        };
        self.writer.write(self.now, change).unwrap();
    }

    /// The submessages that went to a port.
    fn lines_by_port<const N: usize>(&mut self, ports: [u16; N]) -> [Vec<String>; N] {
        let sent = self.sent();
        ports.map(|port| {
            let here = sent
                .iter()
                .filter(|(to, _)| to.iter().any(|to| to.port() == port));
            here.flat_map(|(_, lines)| lines.clone()).collect()
        })
    }
}

/// Reader 1 wants everything, reader 2 what begins with 2, reader 3 what begins with 3.
fn filtered(qos: Qos) -> Bench {
    let mut bench = Bench::new(qos.clone());
    for number in 1..=3 {
        bench.match_reader(number, 7410 + u16::from(number), qos.clone());
    }
    bench.writer.set_reader_filter(reader_guid(2), only(2));
    bench.writer.set_reader_filter(reader_guid(3), only(3));
    bench.lines();
    bench
}

#[test]
fn each_gets_what_it_wants_and_is_told_what_it_does_not_get() {
    let mut bench = filtered(reliable(Durability::Volatile));
    for first in [2, 2, 3, 1] {
        bench.write_first(first, 8);
    }
    let [all, two, three] = bench.lines_by_port([7411, 7412, 7413]);
    let everything: Vec<_> = (1..=4)
        .map(|number| format!("DATA {number} to 1"))
        .collect();
    assert_eq!(all, everything);
    assert_eq!(two, ["DATA 1 to 2", "DATA 2 to 2", "GAP 3..5 [] to 2"]);
    assert_eq!(
        three,
        ["GAP 1..3 [] to 3", "DATA 3 to 3", "GAP 4..5 [] to 3"]
    );
    for reader in 1..=3 {
        bench.acknack(reader, 5, &[]);
    }
    assert!(bench.writer.all_acknowledged());
    assert!(bench.writer.history.is_empty());
}

#[test]
fn what_all_want_goes_to_all_at_once() {
    let mut bench = filtered(reliable(Durability::Volatile));
    bench.writer.set_reader_filter(reader_guid(3), only(2));
    bench.write_first(2, 8);
    bench.write_first(1, 8);
    bench.write_first(2, 8);
    let [all, two, _] = bench.lines_by_port([7411, 7412, 7413]);
    assert_eq!(all, ["DATA 1 to all", "DATA 2 to 1", "DATA 3 to all"]);
    assert_eq!(two, ["DATA 1 to all", "GAP 2..3 [] to 2", "DATA 3 to all"]);
}

#[test]
fn best_effort_readers_are_told_nothing() {
    let mut bench = filtered(Qos {
        history: History::KeepAll,
        ..Qos::default()
    });
    for first in [1, 2, 3] {
        bench.write_first(first, 8);
    }
    let [_, two, three] = bench.lines_by_port([7411, 7412, 7413]);
    assert_eq!(two, ["DATA 2 to 2"]);
    assert_eq!(three, ["DATA 3 to 3"]);
    assert!(bench.writer.history.is_empty());
}

#[test]
fn large_changes_go_in_fragments_to_those_that_want_them() {
    let mut bench = filtered(reliable(Durability::Volatile));
    bench.write_first(2, 4000);
    let [all, two, three] = bench.lines_by_port([7411, 7412, 7413]);
    for lines in [all, two] {
        let fragments = lines.iter().filter(|line| line.starts_with("DATA_FRAG 1."));
        assert_eq!(fragments.count(), 3);
    }
    assert_eq!(three, ["GAP 1..2 [] to 3", "HEARTBEAT 1..=1 to all"]);
}

#[test]
fn repairs_are_filtered_as_well() {
    let mut bench = filtered(reliable(Durability::Volatile));
    for first in [1, 2, 1, 1, 2] {
        bench.write_first(first, 8);
    }
    bench.lines();
    bench.acknack(2, 1, &[1, 2, 3, 4, 5]);
    let [two] = bench.lines_by_port([7412]);
    assert_eq!(
        two[..3],
        ["GAP 1..2 [3, 4] to 2", "DATA 2 to 2", "DATA 5 to 2"]
    );
}

#[test]
fn late_joiners_get_of_the_past_what_they_want() {
    for reliability in [Reliability::RELIABLE, Reliability::BestEffort] {
        let qos = Qos {
            reliability,
            ..reliable(Durability::TransientLocal)
        };
        let mut bench = Bench::new(qos.clone());
        for first in [1, 2, 1] {
            bench.write_first(first, 8);
        }
        bench.match_reader(2, 7412, qos);
        bench.writer.set_reader_filter(reader_guid(2), only(2));
        if reliability.is_reliable() {
            bench.lines();
            bench.acknack(2, 1, &[1, 2, 3]);
        }
        let mut lines = bench.lines();
        lines.retain(|line| line.starts_with("DATA"));
        assert_eq!(lines, ["DATA 2 to 2"], "{reliability:?}");
    }
}

#[test]
fn what_waits_to_be_repeated_does_not_hold_up_what_is_new() {
    let mut bench = filtered(reliable(Durability::Volatile));
    bench.write_first(2, 8);
    bench.lines();
    for _ in 0..2 {
        bench.acknack(2, 1, &[1]);
        bench.lines();
    }
    bench.write_first(2, 8);
    let [two] = bench.lines_by_port([7412]);
    assert_eq!(two, ["DATA 2 to 2"], "1 was repeated a moment ago");
    let lines = bench.pass(Duration::from_millis(5));
    assert!(lines.contains(&"DATA 1 to 2".to_owned()), "{lines:?}");
}

#[test]
fn a_filter_that_is_taken_back_filters_no_more() {
    let mut bench = filtered(reliable(Durability::Volatile));
    for reader in [2, 3] {
        bench.writer.set_reader_filter(reader_guid(reader), None);
    }
    bench.write_first(1, 8);
    assert_eq!(bench.lines(), ["DATA 1 to all"]);
}

#[test]
fn hundreds_of_unwanted_changes_are_few_gaps() {
    let mut bench = filtered(reliable(Durability::TransientLocal));
    for _ in 0..600 {
        bench.write_first(1, 8);
        bench.lines();
    }
    bench.match_reader(4, 7414, reliable(Durability::TransientLocal));
    bench.writer.set_reader_filter(reader_guid(4), only(4));
    bench.lines();
    let mut base = 1;
    for answers in 1.. {
        bench.acknack(4, base, &[base]);
        let lines = bench.pass(Duration::from_millis(3));
        let gap = lines.iter().find(|line| line.starts_with("GAP")).unwrap();
        let (_, end) = gap.split_once("..").unwrap();
        base = end.split(' ').next().unwrap().parse().unwrap();
        if base > 600 {
            assert!(answers < 8);
            break;
        }
    }
}

/// Reader 2 takes the last two bytes of each key for the key.
#[test]
fn keys_are_sent_in_the_form_that_a_reader_knows() {
    let mut bench = Bench::new(reliable(Durability::TransientLocal));
    let match_readers = |bench: &mut Bench, first: u8| {
        for number in [first, first + 1] {
            let qos = reliable(Durability::TransientLocal);
            bench.match_reader(number, 7410 + u16::from(number), qos);
        }
        let last_two: BareKey = |payload| payload.last_chunk::<2>().map(|key| key.to_vec());
        (bench.writer).set_reader_bare_key(reader_guid(first + 1), last_two);
    };
    let payloads = |bench: &mut Bench| {
        let sent = bench.sent_as(|submessage| match submessage {
            Submessage::Data(data) => Some((data.sequence.0, data.payload.to_vec())),
            _ => None,
        });
        let sent = sent.into_iter().flat_map(|(to, payloads)| {
            let port = to[0].port();
            let payloads = payloads.into_iter().flatten();
            payloads.map(move |(sequence, payload)| (port, sequence, payload))
        });
        sent.collect::<Vec<_>>()
    };
    match_readers(&mut bench, 1);
    for kind in [ChangeKind::Alive, ChangeKind::Disposed] {
        let payload = vec![1, 2, 3, 4].into();
        let change = NewChange {
            kind,
            payload,
            ..change(0)
        };
        bench.writer.write(bench.now, change).unwrap();
    }
    let sent = payloads(&mut bench);
    // Padded.
    let (sample, key) = (vec![1, 2, 3, 4], vec![3, 4, 0, 0]);
    assert_eq!(sent[0].1, 1, "{sent:?}");
    assert_eq!(sent[0].2, sample, "a sample is no key");
    assert_eq!(
        sent[1..],
        [(7411, 2, sample.clone()), (7412, 2, key.clone())]
    );
    // The same for those that come late.
    match_readers(&mut bench, 3);
    bench.lines();
    for (reader, disposal) in [(3, sample.clone()), (4, key)] {
        bench.acknack(reader, 1, &[1, 2]);
        let port = 7410 + u16::from(reader);
        let expected = [(port, 1, sample.clone()), (port, 2, disposal)];
        assert_eq!(payloads(&mut bench), expected);
    }
}

/// Of each DATA its number, and which of the filters for 2 and 3 it says that it has passed.
fn passed(submessage: &Submessage<'_>) -> Option<(i64, [Option<bool>; 2])> {
    let Submessage::Data(data) = submessage else {
        return None;
    };
    let results = [2, 3].map(|first| data.filters?.result_of(signature(first)));
    Some((data.sequence.0, results))
}

#[test]
fn samples_say_which_filters_they_have_passed() {
    let mut bench = filtered(reliable(Durability::Volatile));
    let passed_by = |bench: &mut Bench, port: u16| {
        let sent = bench.sent_as(passed);
        let here = sent
            .into_iter()
            .filter(|(to, _)| to.iter().any(|to| to.port() == port));
        here.flat_map(|(_, lines)| lines.into_iter().flatten())
            .collect::<Vec<_>>()
    };
    bench.write_first(2, 8);
    assert_eq!(passed_by(&mut bench, 7412), [(1, [Some(true), None])]);
    bench.write_first(2, 8);
    assert_eq!(passed_by(&mut bench, 7411), [(2, [None, None])]);
    // Now it goes to all.
    bench.writer.set_reader_filter(reader_guid(3), only(2));
    bench.write_first(2, 8);
    assert_eq!(passed_by(&mut bench, 7413), [(3, [Some(true), None])]);
    // There is no room for it.
    let longest = (0..DATAGRAM)
        .rev()
        .find(|len| !bench.writer.layout.is_fragmented(*len));
    bench.write_first(2, longest.unwrap());
    assert_eq!(passed_by(&mut bench, 7412), [(4, [None, None])]);
    bench.acknack(2, 1, &[1]);
    assert_eq!(
        passed_by(&mut bench, 7412),
        [(1, [Some(true), None])],
        "repeated"
    );
    // What is not data has nothing to be judged by.
    let disposal = NewChange {
        kind: ChangeKind::Disposed,
        ..change(8)
    };
    bench.writer.write(bench.now, disposal).unwrap();
    assert_eq!(passed_by(&mut bench, 7412), [(5, [None, None])]);
    for reader in [2, 3] {
        bench.writer.set_reader_filter(reader_guid(reader), None);
    }
    bench.write_first(2, 8);
    assert_eq!(passed_by(&mut bench, 7411), [(6, [None, None])]);
}

#[test]
fn a_filter_that_changes_holds_for_what_waits_as_well() {
    for reliability in [Reliability::RELIABLE, Reliability::BestEffort] {
        let mut bench = filtered(Qos {
            reliability,
            ..reliable(Durability::Volatile)
        });
        for _ in 0..3 {
            bench.write_first(2, DATAGRAM - 200);
        }
        let mut out = Vec::new();
        bench.writer.poll_transmit(bench.now, &mut out);
        bench.writer.set_reader_filter(reader_guid(2), only(3));
        let [two] = bench.lines_by_port([7412]);
        assert!(!two.iter().any(|line| line.starts_with("DATA")), "{two:?}");
        let gaps = two.iter().filter(|line| line.starts_with("GAP"));
        assert_eq!(gaps.count() > 0, reliability.is_reliable());
    }
}

/// As [`filtered`], with a window that begins with 193 fragments.
fn filtered_in_window() -> Bench {
    let qos = Qos {
        history: History::KeepLast(10),
        ..reliable(Durability::Volatile)
    };
    let timing = WriterTiming {
        max_unacknowledged_bytes: 1 << 20,
        ..WriterTiming::default()
    };
    let mut bench = Bench::with_timing(qos.clone(), timing);
    for number in 1..=3 {
        bench.match_reader(number, 7410 + u16::from(number), qos.clone());
    }
    bench.writer.set_reader_filter(reader_guid(2), only(2));
    bench.writer.set_reader_filter(reader_guid(3), only(3));
    bench.lines();
    bench
}

fn fragments(lines: &[String]) -> usize {
    let fragments = lines.iter().filter(|line| line.starts_with("DATA_FRAG"));
    fragments.count()
}

#[test]
fn a_large_change_waits_for_those_that_want_it() {
    let mut bench = filtered_in_window();
    bench.write_first(2, 1000 * DATAGRAM);
    bench.write_first(3, 8);
    let [all, two, three] = bench.lines_by_port([7411, 7412, 7413]);
    assert_eq!([fragments(&all), fragments(&two)], [193, 193]);
    assert_eq!(three, ["GAP 1..2 [] to 3"]);
    bench.progress(1, 1, 150);
    bench.progress(3, 1, 150);
    assert_eq!(fragments(&bench.lines()), 0, "the slowest counts");
    bench.progress(2, 1, 100);
    assert_eq!(fragments(&bench.lines()), 99);
    let mut rest = bench.pass(Duration::from_millis(200));
    rest.retain(|line| !line.starts_with('H'));
    assert_eq!(rest.last().unwrap(), "DATA 2 to 3", "{rest:?}");
    assert!(rest.contains(&"GAP 2..3 [] to 2".to_owned()));
}

#[test]
fn a_large_change_goes_on_without_those_that_leave() {
    let mut bench = filtered_in_window();
    bench.write_first(2, 1000 * DATAGRAM);
    bench.lines();
    bench.writer.unmatch_reader(reader_guid(1));
    bench.progress(2, 1, 194);
    let [one, two] = bench.lines_by_port([7411, 7412]);
    assert_eq!(fragments(&one), 0);
    assert!(fragments(&two) >= 193);
    bench.writer.unmatch_reader(reader_guid(2));
    bench.write_first(3, 8);
    let lines = bench.pass(Duration::from_millis(200));
    assert!(lines.contains(&"DATA 2 to all".to_owned()));
    bench.acknack(3, 3, &[]);
    assert!(bench.writer.all_acknowledged());
    assert!(bench.writer.history.is_empty());
}

#[test]
fn a_large_change_may_be_removed_before_it_is_sent() {
    let mut bench = filtered_in_window();
    bench.write_first(2, 1000 * DATAGRAM);
    bench.lines();
    bench.write_first(2, 8);
    bench.writer.remove(SequenceNumber(1));
    bench.now += Duration::from_millis(20);
    bench.writer.handle_timeout(bench.now);
    let [all, two, three] = bench.lines_by_port([7411, 7412, 7413]).map(|mut lines| {
        lines.retain(|line| !line.starts_with('H'));
        lines
    });
    assert_eq!(two, ["GAP 1..2 [] to all", "DATA 2 to 2"]);
    assert_eq!(all, ["GAP 1..2 [] to all", "DATA 2 to 1"]);
    assert_eq!(three, ["GAP 2..3 [] to 3"]);
}
