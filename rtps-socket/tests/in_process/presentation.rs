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
