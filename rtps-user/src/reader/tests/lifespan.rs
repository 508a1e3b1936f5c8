//! LIFESPAN: samples that are over are gone.

use super::*;
use crate::qos::{Lifespan, ResourceLimits};
use crate::wire;

fn short_lived() -> Qos {
    Qos {
        lifespan: Lifespan(millis(100)),
        ..reliable()
    }
}

#[test]
fn samples_expire_by_themselves() {
    let mut bench = Bench::started(reliable(), short_lived());
    bench.data(1);
    bench.wait(60);
    bench.data(2);
    assert_eq!(
        bench.reader.poll_timeout(),
        Some(bench.now + Duration::from_millis(40))
    );
    bench.wait(39);
    assert_eq!(bench.reader.len(), 2);
    bench.wait(1);
    assert_eq!(bench.taken(), [2]);
    bench.data(3);
    bench.wait(100);
    assert!(bench.reader.is_empty());
    assert!(!bench.reader.has_data());
    assert_eq!(bench.reader.poll_timeout(), None);
}

#[test]
fn what_was_taken_in_time_does_not_come_back_to_haunt_its_place() {
    let mut bench = Bench::started(reliable(), short_lived());
    bench.data(1);
    bench.taken();
    bench.wait(50);
    bench.data(2);
    bench.wait(60);
    assert_eq!(bench.taken(), [2]);
}

#[test]
fn a_sample_can_have_a_lifespan_of_its_own() {
    let mut bench = Bench::started(reliable(), short_lived());
    let with = |lifespan| InlineQos {
        key_hash: Some(key(1)),
        lifespan: Some(lifespan),
        ..InlineQos::default()
    };
    bench.submit(1, with(millis(10)), PayloadKind::Data, b"data");
    bench.submit(
        2,
        with(wire::Duration::INFINITE),
        PayloadKind::Data,
        b"data",
    );
    bench.wait(10);
    assert_eq!(bench.reader.len(), 1);
    bench.wait(1000);
    assert_eq!(bench.taken(), [2]);
}

#[test]
fn a_changed_lifespan_holds_for_what_comes_after() {
    let mut bench = Bench::started(reliable(), short_lived());
    bench.data(1);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.data(2);
    bench.wait(100);
    assert_eq!(bench.taken(), [2]);
}

#[test]
fn what_expires_makes_room_for_what_waits() {
    let qos = Qos {
        resource_limits: ResourceLimits {
            max_samples: Some(1),
            ..ResourceLimits::default()
        },
        ..reliable()
    };
    let mut bench = Bench::started(qos, short_lived());
    bench.data(1);
    bench.wait(50);
    bench.data(2);
    assert_eq!(bench.progress(), 2);
    bench.wait(50);
    assert_eq!(bench.progress(), 3);
    assert_eq!(bench.taken(), [2]);
}
