//! Several readers that wait for the same.

use super::*;

/// A writer with `count` readers, each at an address of its own, that have been greeted.
fn with_readers(count: u8, timing: WriterTiming) -> Bench {
    let mut bench = Bench::with_timing(reliable(Durability::TransientLocal), timing);
    for number in 1..=count {
        let port = 7410 + u16::from(number);
        bench.match_reader(number, port, reliable(Durability::Volatile));
    }
    bench.lines();
    bench
}

fn ports(sent: &Sent) -> Vec<u16> {
    sent.0.iter().map(SocketAddr::port).collect()
}

#[test]
fn what_several_lack_is_sent_once() {
    let mut bench = with_readers(3, WriterTiming::default());
    for _ in 0..5 {
        bench.write(100);
    }
    bench.lines();
    bench.acknack(1, 2, &[2, 3, 5]);
    bench.acknack(2, 3, &[3, 4]);
    bench.acknack(3, 3, &[3]);
    let sent = bench.sent();
    assert_eq!(ports(&sent[0]), [7411, 7412, 7413]);
    assert_eq!(sent[0].1, ["DATA 3 to all", "HEARTBEAT 1..=5 to all"]);
    assert_eq!(ports(&sent[1]), [7411]);
    assert_eq!(
        sent[1].1,
        ["DATA 2 to 1", "DATA 5 to 1", "HEARTBEAT 1..=5 to 1"]
    );
    assert_eq!(ports(&sent[2]), [7412]);
    assert_eq!(sent[2].1, ["DATA 4 to 2", "HEARTBEAT 1..=5 to 2"]);
    assert_eq!(sent.len(), 3, "{sent:?}");
}

#[test]
fn a_request_waits_for_others() {
    let delay = Duration::from_millis(1);
    let timing = WriterTiming {
        nack_response_delay: delay,
        ..WriterTiming::default()
    };
    let mut bench = with_readers(2, timing);
    bench.write(100);
    bench.lines();
    bench.acknack(1, 1, &[1]);
    assert!(bench.lines().is_empty());
    bench.now += delay / 2;
    bench.acknack(2, 1, &[1]);
    let repairs = bench.pass(delay * 2);
    assert_eq!(repairs, ["DATA 1 to all", "HEARTBEAT 1..=1 to all"]);
}

#[test]
fn what_was_shared_is_not_sent_again_at_once() {
    let mut bench = with_readers(2, WriterTiming::default());
    bench.write(100);
    bench.lines();
    for number in [1, 2] {
        bench.acknack(number, 1, &[1]);
    }
    assert_eq!(bench.lines().len(), 2);
    for number in [1, 2] {
        bench.acknack(number, 1, &[1]);
    }
    assert!(bench.lines().is_empty());
    let again = bench.pass(Duration::from_millis(2));
    assert_eq!(again, ["DATA 1 to all", "HEARTBEAT 1..=1 to all"]);
}

#[test]
fn whom_a_change_does_not_concern_does_not_get_it() {
    let mut bench = with_readers(2, WriterTiming::default());
    bench.write(100);
    bench.lines();
    bench.match_reader(3, 7411, reliable(Durability::Volatile));
    bench.lines();
    for number in [1, 2] {
        bench.acknack(number, 1, &[1]);
    }
    let sent = bench.sent();
    let lines: Vec<_> = sent.iter().map(|(_, lines)| lines[0].as_str()).collect();
    assert_eq!(lines, ["DATA 1 to 1", "DATA 1 to 2"]);
}

#[test]
fn shared_changes_fill_datagrams() {
    let mut bench = with_readers(2, WriterTiming::default());
    for _ in 0..20 {
        bench.write(100);
    }
    bench.lines();
    let all: Vec<i64> = (1..=20).collect();
    for number in [1, 2] {
        bench.acknack(number, 1, &all);
    }
    let sent = bench.sent();
    let data = sent.iter().flat_map(|(_, lines)| lines);
    let data = data.filter(|line| line.starts_with("DATA"));
    assert_eq!(data.count(), 20);
    assert_eq!(sent.len(), 3, "{sent:?}");
}
