//! Typed writers and readers of several participants with each other.

use std::time::{Duration, Instant};

use rtps_socket::error::WaitError;
use rtps_socket::qos::{LivelinessKind, PolicyId};
use rtps_socket::{InstanceState, Qos, StatusEvent};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

#[test]
fn samples_cross_from_participant_to_participant() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable().keep_all()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    for x in 0..1000 {
        writer.write(&shape("BLUE", x, 0)).unwrap();
    }
    for x in 0..1000 {
        let sample = reader.take_next(LONG).expect("a sample");
        assert_eq!(sample.data.unwrap().x, x);
    }
    writer.wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(writer.matched(), [reader.guid()]);
    assert!(matches!(
        writer.status_events()[..],
        [StatusEvent::PublicationMatched {
            current: 1,
            change: 1,
            ..
        }]
    ));
}

#[test]
fn samples_cross_within_a_participant() {
    let domain = support::own_network();
    let participant = participant(domain);
    let topic = participant.create_topic::<Shape>("Square").unwrap();
    let writer = participant.create_writer(&topic, Qos::default()).unwrap();
    let reader = participant.create_reader(&topic, Qos::reliable()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("RED", 7, 0)).unwrap();
    assert_eq!(reader.take_next(LONG).unwrap().data.unwrap().x, 7);
}

#[test]
fn large_samples_are_fragmented_and_put_together() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Large").unwrap();
    let writer = a
        .create_writer(&topic, Qos::reliable().keep_all().max_blocking_time(LONG))
        .unwrap();
    let reader = b.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    for x in 0..5 {
        writer.write(&shape("BIG", x, 1_000_000)).unwrap();
    }
    for x in 0..5 {
        let sample = reader
            .take_next(LONG)
            .expect("a large sample")
            .data
            .unwrap();
        assert_eq!(sample, shape("BIG", x, 1_000_000));
    }
}

#[test]
fn late_joiners_get_what_is_kept() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Kept").unwrap();
    let qos = Qos::reliable().transient_local().keep_last(2);
    let writer = a.create_writer(&topic, qos.clone()).unwrap();
    for x in 0..5 {
        writer.write(&shape("BLUE", x, 0)).unwrap();
    }
    let reader = b.create_reader(&topic, qos).unwrap();
    for x in [3, 4] {
        assert_eq!(
            reader
                .take_next(LONG)
                .expect("a kept sample")
                .data
                .unwrap()
                .x,
            x
        );
    }
    assert!(reader.take().is_empty());
}

#[test]
fn the_end_of_instances_and_writers_is_told() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Ends").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable().keep_all()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    writer.write(&shape("RED", 2, 0)).unwrap();
    writer.dispose(&shape("BLUE", 0, 0)).unwrap();
    let mut ended = Vec::new();
    while ended.is_empty() {
        let sample = reader.take_next(LONG).expect("the end of an instance");
        if sample.data.is_none() {
            ended.push((sample.key.unwrap().color, sample.info.instance_state));
        }
    }
    assert_eq!(
        ended,
        [("BLUE".to_owned(), InstanceState::NotAliveDisposed)]
    );
    drop(writer);
    let sample = reader.take_next(LONG).expect("no writers");
    assert_eq!(sample.info.instance_state, InstanceState::NotAliveNoWriters);
    assert_eq!(sample.key.unwrap().color, "RED");
    assert!(reader.matched().is_empty());
}

#[test]
fn a_participant_that_is_dropped_is_gone_at_once() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Gone").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable()).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    drop((writer, a));
    support::eventually(|| reader.matched().is_empty());
}

#[test]
fn incompatible_policies_are_named_on_both_sides() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Strict").unwrap();
    let writer = a.create_writer(&topic, Qos::best_effort()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable()).unwrap();
    let mut events = Vec::new();
    support::eventually(|| {
        events.extend(writer.status_events());
        events.extend(reader.status_events());
        events.len() == 2
    });
    let policy = PolicyId::Reliability;
    let offered = StatusEvent::OfferedIncompatibleQos {
        policy,
        total: 1,
        reader: reader.guid(),
    };
    let requested = StatusEvent::RequestedIncompatibleQos {
        policy,
        total: 1,
        writer: writer.guid(),
    };
    assert!(
        events.contains(&offered) && events.contains(&requested),
        "{events:?}"
    );
    let error = writer
        .wait_for_matched(1, Duration::from_millis(50))
        .unwrap_err();
    assert_eq!(
        error,
        WaitError::TooFewMatched {
            wanted: 1,
            matched: 0
        }
    );
}

#[test]
fn partitions_keep_apart_in_silence() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Parted").unwrap();
    let publisher = a.create_publisher(Qos::default().partition(["left"]));
    let writer = publisher.create_writer(&topic, Qos::reliable()).unwrap();
    let other = b
        .create_reader(&topic, Qos::default().partition(["right"]))
        .unwrap();
    let same = b.create_subscriber(Qos::default().partition(["l*"]));
    let same = same.create_reader(&topic, Qos::default()).unwrap();
    same.wait_for_matched(1, LONG).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    assert!(other.matched().is_empty() && other.status_events().is_empty());
}

#[test]
fn tasks_are_woken() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Async").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    for x in 0..20 {
        let write = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(5));
                writer.write(&shape("BLUE", x, 0)).unwrap();
            });
            support::block_on(reader.next())
        });
        assert_eq!(write.data.unwrap().x, x);
    }
}

#[test]
fn threads_that_wait_for_different_readers_all_get_theirs() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let qos = || Qos::reliable().keep_all();
    std::thread::scope(|scope| {
        for name in ["One", "Two", "Three"] {
            let topic = a.create_topic::<Shape>(name).unwrap();
            let writer = a.create_writer(&topic, qos()).unwrap();
            let reader = b.create_reader(&topic, qos()).unwrap();
            writer.wait_for_matched(1, LONG).unwrap();
            reader.wait_for_matched(1, LONG).unwrap();
            scope.spawn(move || {
                for x in 0..200 {
                    assert_eq!(reader.take_next(LONG).expect(name).data.unwrap().x, x);
                }
            });
            scope.spawn(move || {
                for x in 0..200 {
                    writer.write(&shape(name, x, 0)).unwrap();
                    std::thread::sleep(Duration::from_micros(200));
                }
                writer.wait_for_acknowledgments(LONG).unwrap();
            });
        }
    });
}

#[test]
fn listeners_are_called_and_may_use_the_api() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Heard").unwrap();
    let writer = std::sync::Arc::new(
        a.create_writer(&topic, Qos::reliable().transient_local())
            .unwrap(),
    );
    let heard = std::sync::Arc::downgrade(&writer);
    writer.set_listener(move |event| {
        if let (StatusEvent::PublicationMatched { change: 1, .. }, Some(writer)) =
            (event, heard.upgrade())
        {
            writer.write(&shape("GREETING", 1, 0)).unwrap();
        }
    });
    let reader = b
        .create_reader(&topic, Qos::reliable().transient_local())
        .unwrap();
    let sample = reader.take_next(LONG).expect("what the listener wrote");
    assert_eq!(sample.data.unwrap().color, "GREETING");
}

#[test]
fn a_reader_that_stops_holds_a_keep_all_writer_up() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Full").unwrap();
    let limited = || {
        Qos::reliable()
            .keep_all()
            .resource_limits(Some(4), None, None)
    };
    let writer = a
        .create_writer(
            &topic,
            limited().max_blocking_time(Duration::from_millis(200)),
        )
        .unwrap();
    let reader = b.create_reader(&topic, limited()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    let start = Instant::now();
    let mut written = 0;
    let error = loop {
        match writer.write(&shape("BLUE", written, 0)) {
            Ok(_) => written += 1,
            Err(error) => break error,
        }
        assert!(written < 100, "nothing holds the writer up");
    };
    assert_eq!(error, rtps_socket::error::WriteError::Timeout);
    assert!(start.elapsed() >= Duration::from_millis(200));
    for x in 0..written {
        assert_eq!(reader.take_next(LONG).expect("a sample").data.unwrap().x, x);
    }
    writer.write(&shape("BLUE", written, 0)).unwrap();
}

/// MANUAL_BY_PARTICIPANT: readers of the other learn by the participant's message that it is alive.
#[test]
fn a_writer_that_writes_keeps_the_others_of_its_participant_alive() {
    const LEASE: Duration = Duration::from_millis(1500);
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let qos = || Qos::reliable().liveliness(LivelinessKind::ManualByParticipant, LEASE);
    let [one, two] = ["One", "Two"].map(|name| a.create_topic::<Shape>(name).unwrap());
    let writing = a.create_writer(&one, qos()).unwrap();
    let _silent = a.create_writer(&two, qos()).unwrap();
    let reader = b.create_reader(&two, qos()).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    let end = Instant::now() + 2 * LEASE;
    while Instant::now() < end {
        writing.write(&shape("BLUE", 1, 0)).unwrap();
        let status = reader.liveliness_changed_status();
        assert_eq!((status.alive_count, status.not_alive_count), (1, 0));
        std::thread::sleep(LEASE / 5);
    }
    support::eventually(|| reader.liveliness_changed_status().not_alive_count == 1);
    a.assert_liveliness();
    support::eventually(|| reader.liveliness_changed_status().alive_count == 1);
}
