//! What a participant can see of the domain, and of its past.

use std::time::Duration;

use rtps_socket::{DomainParticipant, LayerChoice, Qos};

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
