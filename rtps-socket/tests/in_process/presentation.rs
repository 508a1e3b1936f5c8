//! Coherent sets, and accesses that freeze what readers show.

use std::time::Duration;

use rtps_socket::qos::PresentationScope;
use rtps_socket::{DataReader, Qos};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

fn xs(reader: &DataReader<Shape>) -> Vec<i32> {
    let samples = reader.take();
    samples
        .into_iter()
        .filter_map(|sample| sample.data)
        .map(|data| data.x)
        .collect()
}

#[test]
fn an_access_freezes_all_readers() {
    let participant = participant(support::own_network());
    let subscriber = participant.create_subscriber(Qos::default());
    let qos = || Qos::reliable().keep_all();
    let pairs: Vec<_> = ["One", "Two"]
        .into_iter()
        .map(|name| {
            let topic = participant.create_topic::<Shape>(name).unwrap();
            let writer = participant.create_writer(&topic, qos()).unwrap();
            let reader = subscriber.create_reader(&topic, qos()).unwrap();
            writer.wait_for_matched(1, LONG).unwrap();
            reader.wait_for_matched(1, LONG).unwrap();
            (writer, reader)
        })
        .collect();
    let write = |x| {
        for (writer, _) in &pairs {
            writer.write(&shape("BLUE", x, 0)).unwrap();
            writer.wait_for_acknowledgments(LONG).unwrap();
        }
    };
    write(1);
    let access = subscriber.begin_access();
    let nested = subscriber.begin_access();
    write(2);
    nested.end();
    for (_, reader) in &pairs {
        assert_eq!(xs(reader), [1]);
        assert!(
            reader
                .take_next_instance(None, 9, &Default::default())
                .is_empty()
        );
    }
    access.end();
    for (_, reader) in &pairs {
        assert_eq!(xs(reader), [2]);
    }
}

#[test]
fn a_reader_that_comes_during_an_access_shows_nothing_before_its_end() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Late").unwrap();
    let qos = || Qos::reliable().keep_all().transient_local();
    let writer = participant.create_writer(&topic, qos()).unwrap();
    let subscriber = participant.create_subscriber(Qos::default());
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    let access = subscriber.begin_access();
    let reader = subscriber.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    writer.wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(xs(&reader), []);
    assert!(access.readers().is_empty());
    access.end();
    assert_eq!(xs(&reader), [1]);
}

#[test]
fn a_set_of_a_topic_is_seen_as_a_whole() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Coherent").unwrap();
    let coherent = || Qos::default().presentation(PresentationScope::Topic, true, false);
    let publisher = a.create_publisher(coherent());
    let qos = || Qos::reliable().keep_all();
    let writer = publisher.create_writer(&topic, qos()).unwrap();
    let subscriber = b.create_subscriber(coherent());
    let reader = subscriber.create_reader(&topic, qos()).unwrap();
    let indifferent = b.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(2, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    indifferent.wait_for_matched(1, LONG).unwrap();
    let set = publisher.coherent_changes();
    for x in 0..3 {
        writer.write(&shape("BLUE", x, 0)).unwrap();
    }
    support::eventually(|| indifferent.read_selection(9, &Default::default()).len() == 3);
    std::thread::sleep(Duration::from_millis(20));
    assert!(xs(&reader).is_empty(), "the set is open");
    drop(set);
    assert!(reader.wait(LONG));
    assert_eq!(xs(&reader), [0, 1, 2]);
    writer.write(&shape("BLUE", 3, 0)).unwrap();
    assert!(reader.wait(LONG));
    assert_eq!(xs(&reader), [3]);
}

#[test]
fn a_set_of_a_group_is_seen_in_all_readers_at_once() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let coherent = || Qos::default().presentation(PresentationScope::Group, true, true);
    let (publisher, subscriber) = (
        a.create_publisher(coherent()),
        b.create_subscriber(coherent()),
    );
    let qos = || Qos::reliable().keep_all();
    let pairs: Vec<_> = ["One", "Two", "Three"]
        .into_iter()
        .map(|name| {
            let topic = a.create_topic::<Shape>(name).unwrap();
            let writer = publisher.create_writer(&topic, qos()).unwrap();
            let reader = subscriber.create_reader(&topic, qos()).unwrap();
            (writer, reader)
        })
        .collect();
    for (writer, reader) in &pairs {
        writer.wait_for_matched(1, LONG).unwrap();
        reader.wait_for_matched(1, LONG).unwrap();
    }
    let readers = || pairs.iter().map(|(_, reader)| reader);
    for round in 0..20 {
        publisher.begin_coherent_changes();
        for x in 0..3 {
            // The third has a part in some sets only.
            for (writer, _) in &pairs[..2 + round % 2] {
                writer.write(&shape("BLUE", x, 0)).unwrap();
            }
        }
        for (writer, _) in &pairs {
            writer.wait_for_acknowledgments(LONG).unwrap();
        }
        let access = subscriber.begin_access();
        assert!(
            readers().all(|reader| xs(reader).is_empty()),
            "the set is open"
        );
        drop(access);
        publisher.end_coherent_changes();
        let seen = |reader: &DataReader<Shape>| xs(reader).len();
        support::eventually(|| {
            let access = subscriber.begin_access();
            let counts: Vec<_> = readers().map(seen).collect();
            drop(access);
            let third = 3 * (round % 2);
            assert!(
                [[0, 0, 0], [3, 3, third]].contains(&counts[..].try_into().unwrap()),
                "{counts:?}"
            );
            counts[0] == 3
        });
    }
}

#[test]
fn deadlines_are_missed_on_both_sides() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Late").unwrap();
    let qos = || Qos::reliable().deadline(Duration::from_millis(20));
    let writer = participant.create_writer(&topic, qos()).unwrap();
    let reader = participant.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    let handle = writer.lookup_instance(&shape("BLUE", 1, 0));
    assert!(handle.is_some());
    support::eventually(|| {
        writer
            .status_changes()
            .contains(rtps_socket::StatusKind::OfferedDeadlineMissed)
            && reader
                .status_changes()
                .contains(rtps_socket::StatusKind::RequestedDeadlineMissed)
    });
    assert_eq!(
        writer.offered_deadline_missed_status().last_instance,
        handle
    );
    assert_eq!(
        reader.requested_deadline_missed_status().last_instance,
        handle
    );
}

#[test]
fn the_order_of_a_group_spans_its_readers() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let ordered = || Qos::default().presentation(PresentationScope::Group, false, true);
    let (publisher, subscriber) = (
        a.create_publisher(ordered()),
        b.create_subscriber(ordered()),
    );
    let qos = || Qos::reliable().keep_all();
    let pairs = ["One", "Two"].map(|name| {
        let topic = a.create_topic::<Shape>(name).unwrap();
        let writer = publisher.create_writer(&topic, qos()).unwrap();
        let reader = subscriber.create_reader(&topic, qos()).unwrap();
        writer.wait_for_matched(1, LONG).unwrap();
        reader.wait_for_matched(1, LONG).unwrap();
        (writer, reader)
    });
    let written = [0, 1, 1, 0, 1, 0, 0, 1];
    for (x, which) in (0..).zip(written) {
        pairs[which].0.write(&shape("BLUE", x, 0)).unwrap();
    }
    publisher.wait_for_acknowledgments(LONG).unwrap();
    let access = subscriber.begin_access();
    let mut read = Vec::new();
    for guid in access.readers() {
        let reader = pairs
            .iter()
            .map(|(_, reader)| reader)
            .find(|reader| reader.guid() == guid);
        let sample = reader
            .unwrap()
            .take_selection(1, &Default::default())
            .remove(0);
        read.push(sample.data.unwrap().x);
    }
    assert_eq!(read, [0, 1, 2, 3, 4, 5, 6, 7]);
}
