//! Leases of writers and deadlines of instances.

use super::*;
use crate::qos::{Deadline, Liveliness, LivelinessKind};

fn offering(kind: LivelinessKind) -> Qos {
    Qos {
        liveliness: Liveliness {
            kind,
            lease: wire::Duration {
                seconds: 1,
                fraction: 0,
            },
        },
        ..reliable()
    }
}

fn changed(alive: u32, alive_change: i32, not_alive: u32, not_alive_change: i32) -> ReaderEvent {
    ReaderEvent::LivelinessChanged {
        writer: writer(1),
        alive_count: alive,
        alive_change,
        not_alive_count: not_alive,
        not_alive_change,
    }
}

#[test]
fn writers_are_counted_as_they_come_and_go() {
    let mut bench = Bench::new(reliable(), reliable());
    assert_eq!(bench.events(), [changed(1, 1, 0, 0)]);
    bench.reader.unmatch_writer(bench.now, bench.writer);
    assert_eq!(bench.events(), [changed(0, -1, 0, 0)]);
}

#[test]
fn a_silent_writer_is_not_alive_and_its_instances_have_no_writers() {
    let mut bench = Bench::started(reliable(), offering(LivelinessKind::ManualByTopic));
    bench.data(1);
    bench.wait(999);
    bench.data(2);
    bench.wait(999);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
    bench.take();
    bench.wait(1);
    assert_eq!(
        bench.events(),
        [ReaderEvent::DataAvailable, changed(0, -1, 1, 1)]
    );
    let samples = bench.take();
    assert!(!samples[0].info.valid_data);
    assert_eq!(
        samples[0].info.instance_state,
        InstanceState::NotAliveNoWriters
    );

    bench.data(3);
    assert_eq!(
        bench.events(),
        [ReaderEvent::DataAvailable, changed(1, 1, 0, -1)]
    );
    assert_eq!(bench.take()[0].info.instance_state, InstanceState::Alive);
}

#[test]
fn only_the_right_assertion_renews() {
    for (kind, by_layer, by_participant) in [
        (LivelinessKind::Automatic, true, true),
        (LivelinessKind::ManualByParticipant, false, true),
        (LivelinessKind::ManualByTopic, false, false),
    ] {
        for (manual, renews) in [(false, by_layer), (true, by_participant)] {
            let mut bench = Bench::started(reliable(), offering(kind));
            bench.wait(600);
            bench
                .reader
                .handle_liveliness(bench.now, bench.writer.prefix, manual);
            bench
                .reader
                .handle_liveliness(bench.now, GuidPrefix([9; 12]), true);
            bench.wait(600);
            assert_eq!(bench.events().is_empty(), renews, "{kind:?} {manual}");
        }
    }
}

#[test]
fn a_missed_deadline_is_told_once_a_period() {
    let qos = Qos {
        deadline: Deadline(wire::Duration::from_std(Duration::from_millis(100))),
        ..reliable()
    };
    let mut bench = Bench::started(qos, reliable());
    bench.data(1);
    bench.wait(60);
    bench.data(2);
    bench.events();
    bench.wait(99);
    assert_eq!(bench.events(), []);
    let missed = ReaderEvent::DeadlineMissed { instance: key(0) };
    for _ in 0..2 {
        bench.wait(1);
        assert_eq!(bench.events(), [missed]);
        bench.wait(99);
    }
    bench.data(3);
    bench.events();
    bench.wait(99);
    assert_eq!(bench.events(), []);
}
