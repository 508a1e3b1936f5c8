//! READER_DATA_LIFECYCLE: what is over does not stay for ever.

use super::*;
use crate::qos::ReaderDataLifecycle;

fn bench() -> Bench {
    let qos = Qos {
        reader_data_lifecycle: ReaderDataLifecycle {
            autopurge_nowriter_samples_delay: millis(100),
            autopurge_disposed_samples_delay: millis(200),
        },
        ..reliable()
    };
    Bench::started(qos, reliable())
}

#[test]
fn samples_of_disposed_instances_go_in_time() {
    let mut bench = bench();
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(2), ALIVE, b"data");
    bench.sample(3, key(1), DISPOSED, b"");
    bench.wait(199);
    assert_eq!(bench.reader.len(), 3);
    bench.wait(1);
    assert_eq!(bench.taken(), [2]);
    assert_eq!(bench.reader.poll_timeout(), None);
}

#[test]
fn instances_without_writers_go_in_time() {
    let mut bench = bench();
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), UNREGISTERED, b"");
    bench.wait(100);
    assert!(bench.reader.is_empty());
    assert_eq!(bench.reader.cache.instances.len(), 0);
    bench.sample(3, key(1), ALIVE, b"data");
    bench.reader.unmatch_writer(bench.now, bench.writer);
    bench.wait(99);
    assert_eq!(bench.reader.len(), 2);
    bench.wait(1);
    assert!(bench.reader.is_empty());
}

#[test]
fn an_instance_that_comes_back_stays() {
    let mut bench = bench();
    bench.sample(1, key(1), DISPOSED, b"");
    bench.wait(100);
    bench.sample(2, key(1), ALIVE, b"data");
    bench.wait(1000);
    assert_eq!(bench.taken(), [1, 2]);
}

#[test]
fn what_is_forgotten_leaves_no_timer() {
    let mut bench = bench();
    for sequence in 1..=100 {
        let instance = key(sequence as u8);
        bench.sample(2 * sequence - 1, instance, ALIVE, b"data");
        bench.sample(2 * sequence, instance, UNREGISTERED, b"");
        bench.taken();
    }
    assert_eq!(bench.reader.cache.lifecycle.next(), None);
}
