//! Walking over instances, frozen views, content filters, and the end of history.

use std::sync::Arc;

use super::*;

fn bench() -> Bench {
    Bench::started(reliable(), reliable())
}

fn walk(bench: &mut Bench, selection: &Selection) -> Vec<KeyHash> {
    let mut previous = None;
    std::iter::from_fn(|| {
        previous = bench.reader.next_instance(previous, selection);
        previous
    })
    .collect()
}

#[test]
fn instances_follow_each_other_by_their_keys() {
    let mut bench = bench();
    for (sequence, instance) in [(1, 3), (2, 1), (3, 2), (4, 1)] {
        bench.sample(sequence, key(instance), ALIVE, b"data");
    }
    let any = Selection::default();
    assert_eq!(walk(&mut bench, &any), [key(1), key(2), key(3)]);
    let of_first = Selection {
        instance: bench.reader.next_instance(None, &any),
        ..any
    };
    assert_eq!(sequences(&bench.reader.take(9, &of_first)), [2, 4]);
    assert_eq!(
        bench.reader.next_instance(Some(key(1)), &any),
        Some(key(2)),
        "also after one that has been taken"
    );
    bench.sample(5, key(0), ALIVE, b"data");
    bench.sample(6, key(1), DISPOSED, b"");
    assert_eq!(walk(&mut bench, &any), [key(0), key(1), key(2), key(3)]);
    bench.taken();
    assert_eq!(walk(&mut bench, &any), []);
    assert!(bench.reader.lookup_instance(key(2)));
    assert!(!bench.reader.lookup_instance(key(7)));
}

#[test]
fn only_instances_with_samples_that_are_wanted_count() {
    let mut bench = bench();
    for (sequence, instance) in [(1, 1), (2, 2), (3, 3)] {
        bench.sample(sequence, key(instance), ALIVE, b"data");
    }
    let second = Selection {
        instance: Some(key(2)),
        ..Selection::default()
    };
    bench.reader.read(9, &second);
    let not_read = Selection::not_read();
    assert_eq!(walk(&mut bench, &not_read), [key(1), key(3)]);
    bench.sample(4, key(2), ALIVE, b"data");
    assert_eq!(walk(&mut bench, &not_read), [key(1), key(2), key(3)]);
}

#[test]
fn a_frozen_view_does_not_grow() {
    let mut bench = bench();
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), ALIVE, b"data");
    bench.reader.freeze();
    bench.sample(3, key(1), ALIVE, b"data");
    bench.sample(4, key(2), ALIVE, b"data");
    assert_eq!(walk(&mut bench, &Selection::default()), [key(1)]);
    assert_eq!(bench.taken(), [1, 2]);
    assert_eq!(bench.taken(), []);
    assert!(!bench.reader.has_matching(&Selection::default()));
    bench.reader.thaw();
    assert_eq!(bench.taken(), [3, 4]);
}

/// Wants payloads that begin with at least `least`.
fn at_least(least: u8) -> Option<PayloadFilter> {
    Some(Arc::new(move |_, payload| payload[0] >= least))
}

#[test]
fn what_a_filter_keeps_out_is_neither_missing_nor_lost() {
    let mut bench = bench();
    bench.reader.set_content_filter(at_least(5), None);
    for (sequence, value) in [(1, 7), (3, 9), (2, 3), (4, 2)] {
        bench.sample(sequence, key(1), ALIVE, &[value]);
    }
    assert_eq!(bench.progress(), 5);
    assert_eq!(bench.taken(), [1, 3]);
    bench.reader.set_content_filter(at_least(1), None);
    bench.sample(5, key(1), ALIVE, &[2]);
    assert_eq!(bench.taken(), [5]);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
}

#[test]
fn the_end_of_an_instance_passes_unless_its_key_tells() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.content_filter = at_least(5);
    let mut bench = Bench::unmatched(config);
    bench.switch_to(1, reliable());
    let disposed = |instance| InlineQos {
        key_hash: Some(key(instance)),
        status: DISPOSED,
        ..InlineQos::default()
    };
    bench.sample(1, key(1), ALIVE, &[7]);
    bench.submit(2, disposed(1), PayloadKind::None, &[]);
    bench.sample(3, key(2), ALIVE, &[3]);
    bench.submit(4, disposed(2), PayloadKind::None, &[]);
    bench.submit(5, disposed(3), PayloadKind::Key, &[1]);
    assert_eq!(bench.taken(), [1, 2]);
}

#[test]
fn history_is_complete_when_all_has_come_that_there_was() {
    let mut bench = Bench::new(transient_local(), transient_local());
    assert!(!bench.reader.is_history_complete());
    bench.data(1);
    bench.heartbeat(1, 3);
    bench.data(3);
    assert!(!bench.reader.has_history_of(bench.writer));
    bench.data(2);
    assert!(bench.reader.is_history_complete());
    bench.heartbeat(1, 5);
    assert!(bench.reader.is_history_complete(), "the rest is no history");
}

#[test]
fn without_durability_there_is_no_history() {
    let bench = Bench::new(reliable(), transient_local());
    assert!(bench.reader.is_history_complete());
    assert!(!bench.reader.has_history_of(writer(2)), "not even matched");
}
