//! Publishers and subscribers: policies, enabling, listeners, statuses.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use rtps_socket::error::{CreateError, SetQosError, WriteError};
use rtps_socket::qos::{PolicyId, PresentationScope};
use rtps_socket::{EntityEvent, Qos, StatusEvent, StatusKind, StatusMask};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

#[test]
fn partitions_change_while_endpoints_live() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Moving").unwrap();
    let publisher = a.create_publisher(Qos::default().partition(["left"]));
    let writer = publisher.create_writer(&topic, Qos::reliable()).unwrap();
    let own = Qos::reliable().partition(["own"]);
    let fixed = publisher.create_writer(&topic, own.clone()).unwrap();
    let subscriber = b.create_subscriber(Qos::default().partition(["right"]));
    let reader = subscriber.create_reader(&topic, Qos::reliable()).unwrap();
    let of_own = b.create_reader(&topic, own).unwrap();
    of_own.wait_for_matched(1, LONG).unwrap();
    assert!(writer.matched().is_empty());
    publisher
        .set_qos(Qos::default().partition(["right"]))
        .unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    subscriber
        .set_qos(Qos::default().partition(["left"]))
        .unwrap();
    support::eventually(|| writer.matched().is_empty() && reader.matched().is_empty());
    assert_eq!(fixed.matched(), [of_own.guid()]);
    let ordered = Qos::default().presentation(PresentationScope::Topic, false, true);
    assert_eq!(
        publisher.set_qos(ordered),
        Err(SetQosError::Immutable(PolicyId::Presentation))
    );
}

#[test]
fn policies_of_endpoints_change_while_they_live() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Changing").unwrap();
    let second = Duration::from_secs(1);
    let writer = a.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = b
        .create_reader(&topic, Qos::reliable().deadline(second))
        .unwrap();
    support::eventually(|| {
        let status = reader.requested_incompatible_qos_status();
        status.last_policy == Some(PolicyId::Deadline)
    });
    writer.set_qos(Qos::reliable().deadline(second)).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    assert_eq!(
        writer.set_qos(Qos::best_effort().deadline(second)),
        Err(SetQosError::Immutable(PolicyId::Reliability))
    );
    assert_eq!(writer.qos().deadline, reader.qos().deadline);
}

#[test]
fn what_is_not_enabled_is_not_known() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Hidden").unwrap();
    let publisher = participant.create_publisher(Qos::default().autoenable_created_entities(false));
    let writer = publisher.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = participant.create_reader(&topic, Qos::reliable()).unwrap();
    assert_eq!(
        writer.write(&shape("BLUE", 1, 0)),
        Err(WriteError::NotEnabled)
    );
    assert!(
        reader
            .wait_for_matched(1, Duration::from_millis(30))
            .is_err()
    );
    writer.enable();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    assert!(reader.take_next(LONG).is_some());

    participant.set_autoenable_created_entities(false);
    let subscriber = participant.create_subscriber(Qos::default());
    let late = subscriber.create_reader(&topic, Qos::reliable()).unwrap();
    assert!(!subscriber.is_enabled());
    assert!(late.wait_for_matched(1, Duration::from_millis(30)).is_err());
    subscriber.enable();
    late.wait_for_matched(1, LONG).unwrap();
}

/// A listener that notes what it is told, and what it has been told so far.
fn notes() -> (
    impl Fn(EntityEvent) + Send + Sync + 'static,
    Arc<Mutex<Vec<EntityEvent>>>,
) {
    let told = Arc::new(Mutex::new(Vec::new()));
    let noted = Arc::clone(&told);
    let note = move |event: EntityEvent| noted.lock().unwrap().push(event);
    (note, told)
}

#[test]
fn listeners_above_hear_what_endpoints_do_not() {
    let participant = participant(support::own_network());
    let (note, of_participant) = notes();
    participant.set_listener(StatusMask::ALL, note);
    let subscriber = participant.create_subscriber(Qos::default());
    let (note, of_subscriber) = notes();
    subscriber.set_listener(StatusKind::DataOnReaders.into(), note);
    let topic = participant.create_topic::<Shape>("Listened").unwrap();
    let writer = participant.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = subscriber.create_reader(&topic, Qos::reliable()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    writer.wait_for_acknowledgments(LONG).unwrap();
    support::eventually(|| !of_subscriber.lock().unwrap().is_empty());
    let of_subscriber = of_subscriber.lock().unwrap();
    assert!(
        of_subscriber
            .iter()
            .all(|event| event.event == StatusEvent::DataOnReaders)
    );
    support::eventually(|| of_participant.lock().unwrap().len() == 3);
    let kinds = of_participant
        .lock()
        .unwrap()
        .clone()
        .into_iter()
        .map(|event| {
            assert_eq!(
                (&*event.topic, &*event.type_name),
                ("Listened", "ShapeType")
            );
            event.event.kind()
        });
    let mut kinds: Vec<_> = kinds.collect();
    kinds.sort_by_key(|kind| *kind as u32);
    assert_eq!(
        kinds,
        [
            StatusKind::LivelinessChanged,
            StatusKind::PublicationMatched,
            StatusKind::SubscriptionMatched,
        ]
    );
    assert!(writer.status_events().is_empty() && reader.status_events().is_empty());
}

#[test]
fn statuses_count_what_has_changed_since() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Counted").unwrap();
    let writer = participant.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = participant.create_reader(&topic, Qos::reliable()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    assert!(
        writer
            .status_changes()
            .contains(StatusKind::PublicationMatched)
    );
    let status = writer.publication_matched_status();
    assert_eq!((status.current_count, status.current_count_change), (1, 1));
    assert_eq!(status.last, Some(reader.guid()));
    assert!(
        !writer
            .status_changes()
            .contains(StatusKind::PublicationMatched)
    );
    reader.wait_for_matched(1, LONG).unwrap();
    assert_eq!(reader.liveliness_changed_status().alive_count, 1);
    drop(reader);
    support::eventually(|| writer.matched().is_empty());
    let status = writer.publication_matched_status();
    assert_eq!((status.current_count, status.current_count_change), (0, -1));
    assert_eq!(
        (status.total.total_count, status.total.total_count_change),
        (1, 0)
    );
    assert_eq!(
        writer.offered_incompatible_qos_status().total.total_count,
        0
    );
}

#[test]
fn publishers_wait_for_all_their_writers() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Suspended").unwrap();
    let publisher = participant.create_publisher(Qos::default());
    let writer = publisher
        .create_writer(&topic, Qos::reliable().keep_all())
        .unwrap();
    let reader = participant
        .create_reader(&topic, Qos::reliable().keep_all())
        .unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    publisher.suspend_publications();
    for x in 0..10 {
        writer.write(&shape("BLUE", x, 0)).unwrap();
    }
    publisher.resume_publications();
    publisher.wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(reader.take().len(), 10);
}

#[test]
fn policies_that_contradict_each_other_are_refused() {
    let participant = participant(support::own_network());
    let tight = || {
        Qos::reliable()
            .keep_last(4)
            .resource_limits(None, None, Some(2))
    };
    assert!(
        participant
            .create_topic_with::<Shape>("No", tight())
            .is_err()
    );
    let topic = participant.create_topic::<Shape>("Shapes").unwrap();
    let refused = participant.create_writer(&topic, tight()).err().unwrap();
    assert!(matches!(refused, CreateError::Inconsistent(_)), "{refused}");
    let second = Duration::from_secs(1);
    let qos = || Qos::reliable().time_based_filter(second);
    let reader = participant.create_reader(&topic, qos()).unwrap();
    let before = reader.qos();
    let refused = reader.set_qos(qos().deadline(second / 2)).unwrap_err();
    assert!(refused.to_string().contains("500ms"), "{refused}");
    assert_eq!(reader.qos(), before);
    reader.set_qos(qos().deadline(second)).unwrap();
}
