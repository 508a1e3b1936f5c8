//! Reading instance by instance, and handles of instances.

use std::time::Duration;

use rtps_socket::error::WriteError;
use rtps_socket::{DataReader, DataWriter, InstanceHandle, InstanceState, Qos, Selection};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

fn pair() -> (DataWriter<Shape>, DataReader<Shape>) {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Instances").unwrap();
    let qos = || Qos::reliable().keep_all();
    let writer = participant.create_writer(&topic, qos()).unwrap();
    let reader = participant.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    (writer, reader)
}

#[test]
fn instances_are_walked_in_one_order() {
    let (writer, reader) = pair();
    for x in 0..3 {
        for color in ["BLUE", "RED", "GREEN"] {
            writer.write(&shape(color, x, 0)).unwrap();
        }
    }
    writer.dispose(&shape("RED", 0, 0)).unwrap();
    writer.wait_for_acknowledgments(LONG).unwrap();
    let all = Selection::default();
    let mut previous = None;
    let mut walked = Vec::new();
    loop {
        let samples = reader.read_next_instance(previous, usize::MAX, &all);
        let Some(first) = samples.first() else {
            break;
        };
        assert!(
            previous < Some(first.info.instance),
            "in the order of handles"
        );
        previous = Some(first.info.instance);
        let color = &first.data_or_key().unwrap().color;
        assert_eq!(reader.lookup_instance(&shape(color, 9, 9)), previous);
        let xs: Vec<_> = samples
            .iter()
            .filter_map(|sample| sample.data.as_ref())
            .map(|data| data.x)
            .collect();
        assert_eq!(xs, [0, 1, 2]);
        walked.push((color.clone(), samples.last().unwrap().info.instance_state));
    }
    let order: Vec<_> = walked.iter().map(|(color, _)| color.clone()).collect();
    walked.sort_by(|one, other| one.0.cmp(&other.0));
    let (alive, disposed) = (InstanceState::Alive, InstanceState::NotAliveDisposed);
    assert_eq!(
        walked,
        [
            ("BLUE".to_owned(), alive),
            ("GREEN".to_owned(), alive),
            ("RED".to_owned(), disposed)
        ]
    );
    let taken: Vec<_> =
        std::iter::successors(reader.take_next_instance(None, 1, &all).pop(), |sample| {
            reader
                .take_next_instance(Some(sample.info.instance), 1, &all)
                .pop()
        })
        .map(|sample| sample.data.unwrap().color)
        .collect();
    assert_eq!(taken, order, "one of each");
    assert_eq!(reader.take().len(), 7);
}

#[test]
fn what_is_read_again_still_has_its_key() {
    let (writer, reader) = pair();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    drop(reader.take_next(LONG).expect("a sample"));
    drop(writer);
    assert!(reader.wait(LONG));
    for _ in 0..2 {
        let ended = reader.read_selection(usize::MAX, &Selection::default());
        let [end] = &ended[..] else {
            panic!("not just the end: {ended:?}");
        };
        assert_eq!(end.info.instance_state, InstanceState::NotAliveNoWriters);
        assert_eq!(end.key.as_ref().unwrap().color, "BLUE");
    }
}

#[test]
fn handles_lead_back_to_keys() {
    let (writer, reader) = pair();
    let blue = shape("BLUE", 1, 0);
    assert_eq!(writer.lookup_instance(&blue), None);
    let handle = writer.register_instance(&blue).unwrap();
    assert_eq!(writer.lookup_instance(&blue), Some(handle));
    assert_eq!(writer.key_value(handle).unwrap().color, "BLUE");
    writer.write(&blue).unwrap();
    writer.dispose_instance(handle).unwrap();
    writer.wait_for_acknowledgments(LONG).unwrap();
    assert_eq!(reader.key_value(handle), None, "nothing has been read yet");
    let all = Selection::default();
    assert_eq!(
        reader.read_instance(handle, 1, &all)[0].data,
        Some(blue.clone())
    );
    assert_eq!(reader.key_value(handle).unwrap().color, "BLUE");
    let samples = reader.take_instance(handle, usize::MAX, &all);
    assert_eq!(
        samples.last().unwrap().info.instance_state,
        InstanceState::NotAliveDisposed
    );
    writer.unregister_instance(handle).unwrap();
    assert_eq!(
        writer.dispose_instance(handle),
        Err(WriteError::UnknownInstance)
    );
    let nobodys = InstanceHandle([7; 16]);
    assert_eq!(
        writer.unregister_instance(nobodys),
        Err(WriteError::UnknownInstance)
    );
    assert!(reader.take_instance(nobodys, 1, &all).is_empty());
}
