//! What a participant can see of the domain, and of its past.

use std::time::Duration;

use rtps_socket::{
    DomainParticipant, InstanceState, LayerChoice, Qos, Selection, ViewState, WaitSet,
};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

#[test]
fn a_domain_can_be_looked_at() {
    let domain = support::own_network();
    let a = participant(domain);
    let named = DomainParticipant::builder()
        .domain(domain)
        .layer(LayerChoice::InProcess)
        .name("watched")
        .user_data(*b"u");
    let b: DomainParticipant = named.open().unwrap();
    let of_topic = Qos::default().topic_data(*b"t");
    let topic = b.create_topic_with::<Shape>("Watched", of_topic).unwrap();
    let qos = Qos::reliable().user_data(*b"w").partition(["p"]);
    let writer = b.create_writer(&topic, qos).unwrap();
    let own = a.create_reader(&topic, Qos::default()).unwrap();
    let builtin = a.builtin();
    support::eventually(|| !builtin.publications().is_empty());
    let [publication] = &builtin.publications()[..] else {
        panic!("not just one: {:?}", builtin.publications());
    };
    assert_eq!(publication.key, writer.guid());
    assert_eq!(
        (&*publication.topic_name, &*publication.type_name),
        ("Watched", "ShapeType")
    );
    assert_eq!(publication.qos.user_data, b"w");
    assert_eq!(publication.qos.partition.0, ["p"]);
    assert!(
        builtin.subscriptions().is_empty(),
        "its own are not among them"
    );
    let topics = builtin.topics();
    assert_eq!(
        (&*topics[0].name, &*topics[0].topic_data),
        ("Watched", &b"t"[..])
    );
    let [remote] = &builtin.participants()[..] else {
        panic!("not just one: {:?}", builtin.participants());
    };
    assert_eq!(
        (remote.key, &*remote.user_data),
        (writer.guid().prefix, &b"u"[..])
    );
    let data = builtin.participant(remote.key);
    assert_eq!(data.as_ref(), Some(remote));
    assert!(a.contains_entity(own.guid()) && !a.contains_entity(writer.guid()));
    drop((writer, b));
    support::eventually(|| builtin.participants().is_empty() && builtin.topics().is_empty());
    assert!(own.matched().is_empty());
}

#[test]
fn readers_come_and_go_with_their_filters() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let builtin = a.builtin();
    let topic = b.create_topic::<Shape>("Watched").unwrap();
    let filtered = b
        .create_content_filtered_topic("Filtered", &topic, "x > %0", &["1"])
        .unwrap();
    let seen = builtin.changes();
    let reader = b.create_reader(&filtered, Qos::default()).unwrap();
    assert!(builtin.wait(seen, LONG));
    support::eventually(|| !builtin.subscriptions().is_empty());
    let filter = builtin.subscriptions().remove(0).content_filter.unwrap();
    let parameters = ["1".to_owned()];
    assert_eq!(
        (&*filter.expression, &filter.parameters[..]),
        ("x > %0", &parameters[..])
    );
    drop(reader);
    support::eventually(|| builtin.subscriptions().is_empty());
    b.set_user_data(*b"new").unwrap();
    let too_long = b.set_user_data([0; 257]).unwrap_err().to_string();
    assert!(
        too_long.contains("257 bytes and may have 256"),
        "{too_long}"
    );
    support::eventually(|| builtin.participants()[0].user_data == b"new");
}

#[test]
fn more_than_a_page_of_endpoints_is_seen() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let writers: Vec<_> = (0..600)
        .map(|number| {
            let topic = b.create_topic::<Shape>(&format!("T{number}")).unwrap();
            b.create_writer(&topic, Qos::reliable()).unwrap()
        })
        .collect();
    let last = a
        .find_topic::<Shape>("T599", LONG)
        .expect("the last of them");
    assert_eq!(last.name(), "T599");
    support::eventually(|| a.builtin().publications().len() == writers.len());
    assert_eq!(a.builtin().topics().len(), writers.len());
    assert!(
        a.find_topic::<Shape>("None", Duration::from_millis(20))
            .is_none()
    );
}

#[test]
fn the_past_can_be_waited_for() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Past").unwrap();
    let qos = || Qos::reliable().transient_local().keep_all();
    let writer = a.create_writer(&topic, qos()).unwrap();
    for x in 0..200 {
        writer.write(&shape("BLUE", x, 1000)).unwrap();
    }
    let reader = b.create_reader(&topic, qos()).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_historical_data(LONG).unwrap();
    assert_eq!(reader.take().len(), 200);
}

/// A writer of one participant, and readers of another and of its own.
#[test]
fn what_is_ignored_is_as_if_it_did_not_exist() {
    let domain = support::own_network();
    let [a, b, c] = [(); 3].map(|()| participant(domain));
    let topics = ["One", "Two"].map(|name| a.create_topic::<Shape>(name).unwrap());
    let writers_of = |of: &DomainParticipant| {
        topics
            .each_ref()
            .map(|t| of.create_writer(t, Qos::reliable()).unwrap())
    };
    let (of_b, of_c, own) = (writers_of(&b), writers_of(&c), writers_of(&a));
    let readers = topics.each_ref().map(|topic| {
        let reader = a.create_reader(topic, Qos::reliable().keep_all()).unwrap();
        reader.wait_for_matched(3, LONG).unwrap();
        reader
    });
    for writer in [&of_b[0], &of_c[0], &own[0]] {
        writer.wait_for_matched(1, LONG).unwrap();
    }
    let builtin = a.builtin();
    assert_eq!(builtin.participants().len(), 2);
    let seen = builtin.changes();
    a.ignore_participant(b.guid().prefix);
    assert!(builtin.wait(seen, LONG));
    assert_eq!(builtin.participants()[0].key, c.guid().prefix);
    assert!(
        builtin
            .publications()
            .iter()
            .all(|known| known.key.prefix == c.guid().prefix)
    );
    assert_eq!(readers[0].matched().len(), 2, "the match has ended");
    let status = readers[0].subscription_matched_status();
    assert_eq!((status.total.total_count, status.current_count), (3, 2));
    of_b[0].write(&shape("BLUE", 1, 0)).unwrap();
    of_c[0].write(&shape("BLUE", 2, 0)).unwrap();
    own[0].write(&shape("BLUE", 3, 0)).unwrap();
    own[0].wait_for_acknowledgments(LONG).unwrap();
    of_c[0].wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(readers[0].take().len(), 2);
    a.ignore_participant(a.guid().prefix);
    assert_eq!(readers[0].matched(), [of_c[0].guid()]);
    assert!(
        own[0].matched().is_empty(),
        "nor does the writer know the reader"
    );
    let late = a.create_reader(&topics[0], Qos::reliable()).unwrap();
    late.wait_for_matched(1, LONG).unwrap();
    a.ignore_publication(of_c[0].guid());
    assert!(readers[0].matched().is_empty() && late.matched().is_empty());
    assert_eq!(readers[1].matched(), [of_c[1].guid()]);
    a.ignore_topic("Two");
    assert!(readers[1].matched().is_empty());
    assert!(builtin.topics().is_empty());
    let reader = c.create_reader(&topics[0], Qos::reliable()).unwrap();
    own[0].wait_for_matched(1, LONG).unwrap();
    a.ignore_subscription(reader.guid());
    assert!(own[0].matched().is_empty());
}

#[test]
fn the_domain_is_told_in_samples() {
    let domain = support::own_network();
    let a = participant(domain);
    let builtin = a.builtin();
    let participants = builtin.participant_reader();
    let writers = builtin.publication_reader();
    let topics = builtin.topic_reader();
    let is_alive = participants.read_condition(Selection::not_read());
    let over = participants.read_condition(Selection {
        instance_states: InstanceState::NotAliveDisposed.into(),
        ..Selection::default()
    });
    let set = WaitSet::new();
    set.attach(&is_alive);
    assert!(!set.wait(LONG / 1000).contains(is_alive.as_ref()));
    let b = participant(domain);
    assert_eq!(set.wait(LONG), [is_alive.as_ref().clone()]);
    let [sample] = &participants.read(9, is_alive.selection())[..] else {
        panic!("not just one");
    };
    assert_eq!(sample.data.as_ref().unwrap().key, b.guid().prefix);
    assert_eq!(sample.info.instance.0, b.guid().to_bytes());
    assert_eq!(sample.info.view_state, ViewState::New);
    assert!(!is_alive.as_ref().trigger_value(), "it has been read");
    let topic = b.create_topic::<Shape>("Watched").unwrap();
    let writer = b.create_writer(&topic, Qos::reliable()).unwrap();
    assert!(writers.wait(LONG));
    assert_eq!(topics.take(9, &Selection::default()).len(), 1);
    let of_writer = writers.take(9, &Selection::default()).remove(0);
    assert_eq!(of_writer.data.unwrap().key, writer.guid());
    writer.set_qos(Qos::reliable().user_data(*b"w")).unwrap();
    assert!(writers.wait(LONG));
    let changed = writers.take(9, &Selection::default()).remove(0);
    assert_eq!(changed.data.unwrap().qos.user_data, b"w");
    assert_eq!(changed.info.view_state, ViewState::NotNew);
    assert!(writers.take(9, &Selection::default()).is_empty());
    set.detach(&is_alive);
    set.attach(&over);
    let gone = b.guid().prefix;
    drop((b, writer));
    assert_eq!(support::block_on(set.wait_async()), [over.as_ref().clone()]);
    let last = participants.take(9, over.selection()).remove(0);
    assert_eq!((last.data, last.key.unwrap().key), (None, gone));
    assert!(participants.read(9, &Selection::default()).is_empty());
    for instance_state in [
        writers.take(9, &Selection::default())[0]
            .info
            .instance_state,
        topics.take(9, &Selection::default())[0].info.instance_state,
    ] {
        assert_eq!(instance_state, InstanceState::NotAliveDisposed);
    }
}
