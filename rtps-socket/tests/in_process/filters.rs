//! Topics of which readers want only some samples.

use std::time::Duration;

use rtps_socket::error::FilterError;
use rtps_socket::{DataReader, Qos};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

fn next(reader: &DataReader<Shape>) -> (String, i32) {
    let data = reader.take_next(LONG).expect("a sample").data.unwrap();
    (data.color, data.x)
}

#[test]
fn readers_get_what_they_want() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let qos = || Qos::reliable().keep_all();
    let writer = a.create_writer(&topic, qos()).unwrap();
    let filtered = b
        .create_content_filtered_topic(
            "Square_filtered",
            &topic,
            "color = %0 AND x >= %1",
            &["BLUE", "2"],
        )
        .unwrap();
    let reader = b.create_reader(&filtered, qos()).unwrap();
    let all = b.create_reader(&topic, qos()).unwrap();
    writer.wait_for_matched(2, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    all.wait_for_matched(1, LONG).unwrap();
    let write = || {
        for x in 0..4 {
            for color in ["BLUE", "RED"] {
                writer.write(&shape(color, x, 0)).unwrap();
            }
        }
        writer.wait_for_acknowledgments(LONG).unwrap();
    };
    write();
    assert_eq!(next(&reader), ("BLUE".to_owned(), 2));
    assert_eq!(next(&reader), ("BLUE".to_owned(), 3));
    assert!(reader.take().is_empty());
    assert_eq!(all.take().len(), 8);

    filtered.set_expression_parameters(&["'RED'", "3"]).unwrap();
    assert_eq!(filtered.expression_parameters(), ["'RED'", "3"]);
    // A writer may go by the old parameters until it has learnt of the new ones.
    support::eventually(|| {
        write();
        !reader.take().is_empty()
    });
    all.take();
    write();
    assert_eq!(next(&reader), ("RED".to_owned(), 3));
    assert!(reader.take().is_empty());
    assert_eq!(all.take().len(), 8);
    assert_eq!(reader.sample_lost_status().total_count, 0);
}

#[test]
fn filters_that_fit_nothing_are_refused() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Square").unwrap();
    let create = |expression: &str, parameters: &[&str]| {
        let created =
            participant.create_content_filtered_topic("Filtered", &topic, expression, parameters);
        created.map(|filtered| filtered.filter_expression())
    };
    assert_eq!(create("x > 1", &[]), Ok("x > 1".to_owned()));
    assert!(matches!(create("x > %0", &[]), Err(FilterError::Parse(_))));
    assert!(matches!(create("size > 1", &[]), Err(FilterError::Bind(_))));
    assert_eq!(
        create("x > 1", &["1"; 101]),
        Err(FilterError::TooManyParameters(101))
    );
    let named = participant.create_content_filtered_topic("", &topic, "x > 1", &[]);
    assert!(matches!(named, Err(FilterError::Refused(_))));
}

#[test]
fn late_joiners_get_what_they_want_of_what_is_kept() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let qos = || Qos::reliable().keep_all().transient_local();
    let writer = a.create_writer(&topic, qos().xcdr2()).unwrap();
    for x in 0..100 {
        writer.write(&shape("BLUE", x, 2000)).unwrap();
    }
    let filtered = b
        .create_content_filtered_topic("Some", &topic, "x BETWEEN 40 AND 42 OR x > %0", &["98"])
        .unwrap();
    let reader = b.create_reader(&filtered, qos().xcdr2()).unwrap();
    let wanted = [40, 41, 42, 99].map(|x| ("BLUE".to_owned(), x));
    assert_eq!([(); 4].map(|()| next(&reader)), wanted);
    writer.wait_for_acknowledgments(LONG).unwrap();
    assert!(reader.take().is_empty());
}

#[test]
fn the_end_of_an_instance_is_judged_by_its_key() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let qos = || Qos::reliable().keep_all();
    let writer = a.create_writer(&topic, qos()).unwrap();
    let filter = |name, expression| {
        let topic = b.create_content_filtered_topic(name, &topic, expression, &[]);
        b.create_reader(&topic.unwrap(), qos()).unwrap()
    };
    let by_key = filter("ByKey", "color LIKE 'B%'");
    let by_value = filter("ByValue", "x = 1");
    writer.wait_for_matched(2, LONG).unwrap();
    for color in ["BLUE", "RED"] {
        writer.write(&shape(color, 1, 0)).unwrap();
        writer.dispose(&shape(color, 0, 0)).unwrap();
    }
    writer.wait_for_acknowledgments(LONG).unwrap();
    let seen = |reader: &DataReader<Shape>| -> Vec<_> {
        let samples = reader.take().into_iter();
        let color = |key: Option<Shape>| key.map(|shape| shape.color);
        samples
            .map(|sample| (color(sample.data), color(sample.key)))
            .collect()
    };
    let (data, end) = (
        |color: &str| (Some(color.to_owned()), None),
        |color: &str| (None, Some(color.to_owned())),
    );
    assert_eq!(seen(&by_key), [data("BLUE"), end("BLUE")]);
    let all = [data("BLUE"), end("BLUE"), data("RED"), end("RED")];
    assert_eq!(seen(&by_value), all);
}
