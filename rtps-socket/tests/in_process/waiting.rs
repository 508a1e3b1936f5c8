//! WaitSets and conditions.

use std::thread;
use std::time::{Duration, Instant};

use rtps_socket::{
    Condition, DataReader, DataWriter, DdsType, DomainParticipant, GuardCondition, Qos, Selection,
    StatusKind, StatusMask, WaitSet,
};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);
const SHORT: Duration = Duration::from_millis(20);

fn pair(participant: &DomainParticipant, name: &str) -> (DataWriter<Shape>, DataReader<Shape>) {
    let topic = participant.create_topic::<Shape>(name).unwrap();
    let qos = || Qos::reliable().keep_all();
    let writer = participant.create_writer(&topic, qos()).unwrap();
    let reader = participant.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    (writer, reader)
}

fn later(act: impl FnOnce() + Send) -> impl FnOnce() + Send {
    || {
        thread::sleep(SHORT);
        act();
    }
}

#[test]
fn a_wait_ends_with_the_condition_that_is_true() {
    let participant = participant(support::own_network());
    let (one, of_one) = pair(&participant, "One");
    let (_two, of_two) = pair(&participant, "Two");
    let not_read = Selection::not_read();
    let (a, b) = (
        of_one.read_condition(not_read),
        of_two.read_condition(not_read),
    );
    let guard = GuardCondition::new();
    let set = WaitSet::new();
    set.attach(&a);
    set.attach(&a);
    set.attach(&b);
    set.attach(&guard);
    assert_eq!(set.conditions().len(), 3);
    let start = Instant::now();
    assert_eq!(set.wait(SHORT), []);
    assert!(start.elapsed() >= SHORT);
    thread::scope(|scope| {
        scope.spawn(later(|| _ = one.write(&shape("BLUE", 1, 0)).unwrap()));
        assert_eq!(set.wait(LONG), [a.as_ref().clone()]);
    });
    assert_eq!(of_one.take_selection(9, a.selection()).len(), 1);
    assert_eq!(set.wait(Duration::ZERO), []);
    thread::scope(|scope| {
        scope.spawn(later(|| guard.set_trigger_value(true)));
        assert_eq!(set.wait(LONG), [guard.as_ref().clone()]);
    });
    assert!(guard.as_ref().trigger_value());
    set.detach(&guard);
    assert_eq!(set.wait(Duration::ZERO), []);
}

#[test]
fn conditions_of_several_participants_are_waited_for_at_once() {
    let domain = support::own_network();
    let participants = [participant(domain), participant(domain)];
    let pairs = [pair(&participants[0], "One"), pair(&participants[1], "Two")];
    let conditions = pairs
        .each_ref()
        .map(|(_, reader)| reader.status_condition(StatusKind::DataAvailable.into()));
    let set = WaitSet::new();
    conditions
        .iter()
        .for_each(|condition| set.attach(condition));
    assert_eq!(set.wait(SHORT), []);
    for ((writer, reader), condition) in pairs.iter().zip(&conditions) {
        thread::scope(|scope| {
            scope.spawn(later(|| _ = writer.write(&shape("BLUE", 1, 0)).unwrap()));
            assert_eq!(set.wait(LONG), [condition.as_ref().clone()]);
        });
        reader.take();
    }
    let guard = GuardCondition::new();
    set.attach(&guard);
    thread::scope(|scope| {
        scope.spawn(later(|| guard.set_trigger_value(true)));
        assert_eq!(
            support::block_on(set.wait_async()),
            [guard.as_ref().clone()]
        );
    });
}

#[test]
fn guards_alone_are_waited_for() {
    let (one, two) = (GuardCondition::new(), GuardCondition::new());
    let set = WaitSet::new();
    set.attach(&one);
    set.attach(&two);
    thread::scope(|scope| {
        scope.spawn(later(|| two.set_trigger_value(true)));
        assert_eq!(set.wait(LONG), [two.as_ref().clone()]);
    });
    two.set_trigger_value(false);
    assert_eq!(set.wait(SHORT), []);
}

#[test]
fn statuses_are_true_until_they_are_asked_for() {
    let participant = participant(support::own_network());
    let (writer, reader) = pair(&participant, "Status");
    let matched = writer.status_condition(StatusKind::PublicationMatched.into());
    let condition: Condition = matched.as_ref().clone();
    assert!(condition.trigger_value());
    writer.publication_matched_status();
    assert!(!condition.trigger_value());
    let set = WaitSet::new();
    set.attach(&condition);
    thread::scope(|scope| {
        scope.spawn(later(|| drop(reader)));
        assert_eq!(set.wait(LONG), std::slice::from_ref(&condition));
    });
    matched.set_enabled_statuses(StatusKind::LivelinessLost.into());
    assert!(!condition.trigger_value());
    drop(writer);
    assert!(!condition.trigger_value(), "its writer is gone");
}

#[test]
fn queries_look_into_samples() {
    let participant = participant(support::own_network());
    let (writer, reader) = pair(&participant, "Query");
    let query = reader
        .query_condition(Selection::not_read(), "x > %0", &["1"])
        .unwrap();
    assert!(
        reader
            .query_condition(Selection::default(), "y > 1", &[])
            .is_err()
    );
    let set = WaitSet::new();
    set.attach(&query);
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    assert_eq!(set.wait(SHORT), []);
    thread::scope(|scope| {
        scope.spawn(later(|| _ = writer.write(&shape("BLUE", 2, 0)).unwrap()));
        assert_eq!(set.wait(LONG), [query.as_ref().clone()]);
    });
    let read = reader.read_query(9, &query);
    assert_eq!(read.len(), 1);
    assert_eq!(read[0].data.as_ref().unwrap().x, 2);
    assert!(reader.take_query(9, &query).is_empty(), "it has been read");
    writer.write(&shape("BLUE", 3, 0)).unwrap();
    writer.wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(reader.take_query(9, &query)[0].data.as_ref().unwrap().x, 3);
    assert_eq!(reader.take().len(), 2);
    query.set_query_parameters(&["9"]).unwrap();
    assert!(query.set_query_parameters(&[]).is_err());
    writer.write(&shape("BLUE", 9, 0)).unwrap();
    assert_eq!(set.wait(SHORT), []);
    writer.write(&shape("BLUE", 10, 0)).unwrap();
    assert_eq!(set.wait(LONG).len(), 1);
}

#[test]
fn a_subscriber_has_data_until_its_readers_have_been_read() {
    let participant = participant(support::own_network());
    let subscriber = participant.create_subscriber(Qos::default());
    let publisher = participant.create_publisher(Qos::default());
    let topic = participant.create_topic::<Shape>("One").unwrap();
    let condition = subscriber.status_condition(StatusKind::DataOnReaders.into());
    let of_writers = publisher.status_condition(StatusKind::PublicationMatched.into());
    let of_all = participant.status_condition(StatusKind::SubscriptionMatched.into());
    let data = WaitSet::new();
    data.attach(&condition);
    assert_eq!(data.wait(SHORT), []);
    let reader = subscriber
        .create_reader(&topic, Qos::reliable().keep_all())
        .unwrap();
    let matches = WaitSet::new();
    matches.attach(&of_writers);
    let mut writer = None;
    thread::scope(|scope| {
        scope.spawn(later(|| {
            writer = Some(publisher.create_writer(&topic, Qos::reliable()).unwrap());
        }));
        assert_eq!(matches.wait(LONG), [of_writers.as_ref().clone()]);
    });
    let writer = writer.unwrap();
    matches.attach(&of_all);
    matches.detach(&of_writers);
    assert_eq!(matches.wait(LONG), [of_all.as_ref().clone()]);
    reader.subscription_matched_status();
    assert_eq!(matches.wait(SHORT), []);
    for _ in 0..2 {
        thread::scope(|scope| {
            scope.spawn(later(|| _ = writer.write(&shape("BLUE", 1, 0)).unwrap()));
            assert_eq!(data.wait(LONG), [condition.as_ref().clone()]);
        });
        assert!(
            subscriber
                .status_changes()
                .contains(StatusKind::DataOnReaders)
        );
        assert!(reader.status_changes().contains(StatusKind::DataAvailable));
        assert_eq!(reader.take().len(), 1);
        thread::scope(|scope| {
            scope.spawn(later(|| _ = writer.write(&shape("BLUE", 2, 0)).unwrap()));
            let found = support::block_on(data.wait_async());
            assert_eq!(found, [condition.as_ref().clone()]);
        });
        reader.read();
        assert!(!condition.as_ref().trigger_value());
        reader.take_selection(9, &Selection::default());
    }
    condition.set_enabled_statuses(StatusMask::NONE);
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    assert_eq!(data.wait(SHORT), []);
}

#[derive(DdsType)]
#[dds(type_name = "AnotherType")]
struct Another {
    number: i32,
}

#[test]
fn a_topic_counts_those_who_use_its_name_otherwise() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Same").unwrap();
    let condition = topic.status_condition(StatusKind::InconsistentTopic.into());
    let set = WaitSet::new();
    set.attach(&condition);
    let _reader = a.create_reader(&topic, Qos::default()).unwrap();
    let other = b.create_topic::<Another>("Same").unwrap();
    thread::scope(|scope| {
        let wait = scope.spawn(|| set.wait(LONG));
        let first = b.create_writer(&other, Qos::default()).unwrap();
        assert_eq!(wait.join().unwrap(), [condition.as_ref().clone()]);
        drop(first);
    });
    let status = topic.inconsistent_topic_status();
    assert_eq!((status.total_count, status.total_count_change), (1, 1));
    assert!(!condition.as_ref().trigger_value());
    let (sender, told) = std::sync::mpsc::channel();
    topic.set_listener(move |status| sender.send(status).unwrap());
    let _second = b.create_writer(&other, Qos::default()).unwrap();
    let status = told.recv_timeout(LONG).unwrap();
    assert_eq!((status.total_count, status.total_count_change), (2, 1));
    assert!(!condition.as_ref().trigger_value(), "the listener was told");
    assert_eq!(
        topic.clone().inconsistent_topic_status().total_count_change,
        0
    );
}
