//! Best-effort readers: newest first, nothing twice, nothing asked for.

use super::*;

fn bench() -> Bench {
    let mut bench = Bench::new(
        Qos {
            history: crate::qos::History::KeepAll,
            ..Qos::default()
        },
        reliable(),
    );
    bench.events();
    bench
}

#[test]
fn what_is_older_than_the_newest_is_dropped_and_counted_as_lost() {
    let mut bench = bench();
    for sequence in [5, 6, 6, 9, 7, 8, 10] {
        bench.data(sequence);
    }
    assert_eq!(bench.taken(), [5, 6, 9, 10]);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable, lost(2)]);
}

#[test]
fn a_gap_is_no_loss() {
    let mut bench = bench();
    bench.data(1);
    bench.gap(2, 4, &[4]);
    bench.data(5);
    assert_eq!(bench.taken(), [1, 5]);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
}

#[test]
fn samples_without_room_are_gone() {
    let qos = Qos {
        history: crate::qos::History::KeepAll,
        resource_limits: crate::qos::ResourceLimits {
            max_samples: Some(1),
            ..Default::default()
        },
        ..Qos::default()
    };
    let mut bench = Bench::new(qos, Qos::default());
    bench.events();
    bench.data(1);
    bench.data(2);
    assert_eq!(bench.taken(), [1]);
    bench.data(3);
    assert_eq!(bench.taken(), [3]);
    let rejected = bench
        .events()
        .into_iter()
        .filter(|event| matches!(event, ReaderEvent::SampleRejected { .. }));
    assert_eq!(rejected.count(), 1);
}
