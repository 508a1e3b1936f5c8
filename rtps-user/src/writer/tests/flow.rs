//! How far a writer runs ahead, how often it asks, and how much it repeats at once.

use super::*;
use crate::history::CacheChange;

const BYTES: usize = 1000 - CacheChange::OVERHEAD;

/// A writer with a window of 100 changes of [`BYTES`], and with a reader that has been greeted.
fn with_window(durability: Durability) -> Bench {
    let qos = reliable(durability);
    let timing = WriterTiming {
        max_unacknowledged_bytes: 100_000,
        min_unacknowledged_bytes: 100_000,
        ..WriterTiming::default()
    };
    let mut bench = Bench::with_timing(qos.clone(), timing);
    bench.match_reader(1, 7411, qos);
    bench.lines();
    bench
}

impl Bench {
    fn try_write(&mut self) -> Result<SequenceNumber, WriteError> {
        self.writer.write(self.now, change(BYTES))
    }

    /// Writes as long as there is room; gives how many changes that were.
    fn write_all(&mut self) -> usize {
        (0..2000).take_while(|_| self.try_write().is_ok()).count()
    }
}

fn heartbeats(lines: &[String]) -> usize {
    let is_heartbeat = |line: &&String| line.starts_with("HEARTBEAT");
    lines.iter().filter(is_heartbeat).count()
}

#[test]
fn a_full_window_opens_for_many_changes_at_once() {
    for durability in [Durability::Volatile, Durability::TransientLocal] {
        let mut bench = with_window(durability);
        assert_eq!(bench.write_all(), 100);
        bench.lines();
        bench.acknack(1, 50, &[]);
        assert_eq!(bench.try_write(), Err(WriteError::HistoryFull));
        bench.acknack(1, 51, &[]);
        assert_eq!(bench.write_all(), 50);
    }
}

#[test]
fn keep_last_has_no_window() {
    let mut bench = with_window(Durability::Volatile);
    bench.writer.config.qos.history = History::KeepLast(1);
    assert_eq!(bench.write_all(), 2000);
}

#[test]
fn a_late_joiner_that_fetches_the_past_does_not_close_the_window() {
    let mut bench = with_window(Durability::TransientLocal);
    for base in [101, 201] {
        bench.write_all();
        bench.lines();
        bench.acknack(1, base, &[]);
    }
    bench.match_reader(2, 7412, reliable(Durability::TransientLocal));
    assert_eq!(bench.write_all(), 100);
    bench.lines();
    bench.acknack(1, 301, &[]);
    assert_eq!(bench.write_all(), 0, "the late joiner gets these as well");
    let all: Vec<i64> = (1..=200).collect();
    let size = bench.writer.window.size();
    bench.acknack(2, 1, &all);
    assert_eq!(bench.writer.window.size(), size, "the past was not lost");
}

#[test]
fn each_window_is_asked_for_four_times() {
    let mut bench = with_window(Durability::Volatile);
    bench.write_all();
    let lines = bench.lines();
    assert_eq!(heartbeats(&lines), 4, "{lines:?}");
    assert_eq!(lines.last().unwrap(), "HEARTBEAT 1..=100 to all");
}

#[test]
fn who_writes_one_by_one_asks_once_in_a_window_and_when_it_is_full() {
    let mut bench = with_window(Durability::Volatile);
    let mut asked = Vec::new();
    for n in 1..=100 {
        bench.try_write().unwrap();
        if heartbeats(&bench.lines()) > 0 {
            asked.push(n);
        }
    }
    assert_eq!(asked, [75, 100]);
    bench.writer.config.qos.history = History::KeepLast(1);
    bench.try_write().unwrap();
    assert_eq!(heartbeats(&bench.lines()), 0, "nobody waits for room");
}

#[test]
fn heartbeats_between_changes_leave_datagrams_alike() {
    let mut bench = with_window(Durability::Volatile);
    bench.write_all();
    let lines: Vec<_> = bench.sent().into_iter().map(|(_, lines)| lines).collect();
    let (last, others) = lines.split_last().unwrap();
    assert_eq!(last.len(), 2, "{last:?}");
    assert!(others.iter().all(|lines| lines.len() == 1), "{others:?}");
}

#[test]
fn losses_narrow_the_window_and_deliveries_widen_it() {
    let qos = reliable(Durability::Volatile);
    let mut bench = matched(qos);
    let first = bench.write_all();
    bench.lines();
    bench.acknack(1, 1, &[1, 2]);
    bench.lines();
    bench.acknack(1, first as i64 + 1, &[]);
    let second = bench.write_all();
    assert!(second <= first / 2 + 1, "{second} after {first}");
    let mut last = second;
    for _ in 0..100 {
        bench.lines();
        bench.acknack(1, bench.writer.last_sequence().next().0, &[]);
        last = bench.write_all();
    }
    let largest = WriterTiming::default().max_unacknowledged_bytes;
    assert_eq!(last, largest / 1000 + 1);
}

#[test]
fn a_large_answer_comes_in_parts() {
    let mut bench = with_window(Durability::Volatile);
    bench.write_all();
    bench.lines();
    let all: Vec<i64> = (1..=100).collect();
    bench.acknack(1, 1, &all);
    let is_data = |line: &&String| line.starts_with("DATA");
    let lines = bench.lines();
    assert_eq!(
        lines.iter().filter(is_data).count(),
        60,
        "half a window of bytes"
    );
    assert_eq!(lines.last().unwrap(), "HEARTBEAT 1..=100 to 1");
    assert_eq!(lines.len(), 61);
    assert!(bench.lines().is_empty());
    // The reader's answer brings the rest, and so does time.
    let mut other = with_window(Durability::Volatile);
    other.write_all();
    other.lines();
    other.acknack(1, 1, &all);
    other.lines();
    let rest = other.pass(Duration::from_millis(5));
    bench.acknack(1, 61, &[]);
    let at_once = bench.lines();
    assert_eq!(at_once[..40], rest[..40]);
    assert_eq!(at_once[40..], ["HEARTBEAT 61..=100 to 1"]);
    assert_eq!(rest.iter().filter(is_data).count(), 40);
    assert_eq!(rest[0], "DATA 61 to 1");
}

#[test]
fn the_past_is_replayed_in_parts() {
    let mut bench = with_window(Durability::TransientLocal);
    bench.write_all();
    bench.lines();
    bench.acknack(1, 101, &[]);
    let mut best_effort = reliable(Durability::TransientLocal);
    best_effort.reliability = Reliability::BestEffort;
    bench.match_reader(2, 7412, best_effort);
    assert_eq!(bench.lines().len(), 60);
    assert!(bench.lines().is_empty());
    assert_eq!(bench.pass(Duration::from_millis(5)).len(), 40);
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn the_smallest_window_still_lets_everything_through() {
    let timing = WriterTiming {
        max_unacknowledged_bytes: 0,
        nack_suppression: Duration::ZERO,
        ..WriterTiming::default()
    };
    let qos = reliable(Durability::TransientLocal);
    let mut bench = Bench::with_timing(qos.clone(), timing);
    bench.match_reader(1, 7411, qos);
    bench.lines();
    for base in 2..=4 {
        assert_eq!(bench.write_all(), 1);
        bench.lines();
        bench.acknack(1, base, &[]);
    }
    bench.acknack(1, 1, &[1, 2, 3]);
    let lines = bench.pass(Duration::from_millis(100));
    let repeated = |number| format!("DATA {number} to 1");
    assert!((1..=3).all(|number| lines.contains(&repeated(number))));
}

/// Such a reader asks for the later changes as a whole, as often as it asks for the fragments, and drops them.
#[test]
fn a_reader_that_keeps_nothing_out_of_order_gets_its_fragments_first() {
    let mut bench = with_window(Durability::Volatile);
    for _ in 0..2 {
        bench.write(40_000);
    }
    bench.lines();
    for _ in 0..3 {
        bench.pass(Duration::from_secs(1));
        bench.acknack(1, 1, &[2]);
        bench.nack_frag(1, 1, &[7, 8]);
        let repairs = bench.pass(Duration::from_millis(500));
        let fragments = ["DATA_FRAG 1.7 to 1", "DATA_FRAG 1.8 to 1"];
        assert_eq!(repairs[..2], fragments, "{repairs:?}");
        assert_eq!(repairs[2], "DATA_FRAG 2.1 to 1", "{repairs:?}");
    }
}

#[test]
fn what_one_reader_has_acknowledged_is_known() {
    let mut bench = Bench::new(reliable(Durability::Volatile));
    for number in [1, 2] {
        bench.match_reader(number, 7411, reliable(Durability::Volatile));
    }
    bench.match_reader(3, 7411, Qos::default());
    bench.write(8);
    bench.lines();
    bench.acknack(1, 2, &[]);
    let has = [1, 2, 3, 4].map(|number| {
        let reader = reader_guid(number);
        bench.writer.is_acknowledged_by(reader, SequenceNumber(1))
    });
    assert_eq!(has, [true, false, true, false]);
}
