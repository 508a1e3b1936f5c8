//! TIME_BASED_FILTER: not more than the reader can bear, but the last value all the same.

use super::*;
use crate::qos::{Deadline, TimeBasedFilter};

fn filtered() -> Qos {
    Qos {
        time_based_filter: TimeBasedFilter(millis(100)),
        ..reliable()
    }
}

fn bench(qos: Qos) -> Bench {
    Bench::started(qos, reliable())
}

#[test]
fn samples_of_an_instance_are_apart() {
    let mut bench = bench(filtered());
    let mut taken = Vec::new();
    for sequence in 1..=20 {
        bench.data(sequence);
        taken.extend(bench.taken());
        bench.wait(30);
        taken.extend(bench.taken());
    }
    // At 0, 100 (the one of 90), 210 (that came just in time), ...
    assert_eq!(taken.len(), 6, "{taken:?}");
    assert!(taken.is_sorted());
    assert_eq!(bench.progress(), 21);
    let is_loss = |event: &ReaderEvent| matches!(event, ReaderEvent::SampleLost { .. });
    assert!(!bench.events().iter().any(is_loss));
}

#[test]
fn the_last_value_comes_when_the_writer_falls_silent() {
    let mut bench = bench(filtered());
    for sequence in 1..=3 {
        bench.data(sequence);
        bench.wait(10);
    }
    assert_eq!(bench.taken(), [1]);
    assert_eq!(
        bench.reader.poll_timeout(),
        Some(bench.now + Duration::from_millis(70))
    );
    bench.events();
    bench.wait(70);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
    assert_eq!(bench.taken(), [3]);
    assert_eq!(bench.reader.poll_timeout(), None);
    bench.wait(50);
    bench.data(4);
    assert!(bench.taken().is_empty(), "the period begins anew");
}

#[test]
fn best_effort_readers_can_do_without_it() {
    let mut bench = bench(Qos {
        reliability: Reliability::BestEffort,
        ..filtered()
    });
    bench.data(1);
    bench.data(2);
    bench.wait(100);
    assert_eq!(bench.taken(), [1]);
    bench.data(3);
    assert_eq!(bench.taken(), [3]);
}

#[test]
fn each_instance_has_its_own_period() {
    let mut bench = bench(filtered());
    for sequence in 1..=4 {
        bench.sample(sequence, key((sequence % 2) as u8), ALIVE, b"data");
    }
    assert_eq!(bench.taken(), [1, 2]);
    bench.wait(100);
    let mut last = bench.taken();
    last.sort_unstable();
    assert_eq!(last, [3, 4]);
}

#[test]
fn the_end_of_an_instance_is_never_filtered() {
    let mut bench = bench(filtered());
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), ALIVE, b"data");
    bench.sample(3, key(1), DISPOSED, b"");
    bench.sample(4, key(1), ALIVE, b"data");
    assert_eq!(bench.taken(), [1, 3, 4]);
    bench.sample(5, key(1), ALIVE, b"data");
    bench.sample(6, key(1), UNREGISTERED, b"");
    assert_eq!(bench.taken(), [5, 6], "its last value stays");
    bench.wait(1000);
    assert!(bench.reader.is_empty());
}

#[test]
fn what_is_filtered_keeps_the_deadline() {
    let mut bench = bench(Qos {
        deadline: Deadline(millis(100)),
        reliability: Reliability::BestEffort,
        ..filtered()
    });
    for sequence in 1..=10 {
        bench.data(sequence);
        bench.wait(60);
    }
    let is_missed = |event: &ReaderEvent| matches!(event, ReaderEvent::DeadlineMissed { .. });
    assert!(!bench.events().iter().any(is_missed));
}

#[test]
fn the_period_can_change() {
    let mut bench = bench(reliable());
    bench.data(1);
    bench.reader.set_qos(filtered());
    bench.data(2);
    bench.data(3);
    assert_eq!(bench.taken(), [1, 2]);
    bench.reader.set_qos(reliable());
    bench.data(4);
    assert_eq!(bench.taken(), [4]);
    bench.wait(200);
    assert!(bench.reader.is_empty());
}
