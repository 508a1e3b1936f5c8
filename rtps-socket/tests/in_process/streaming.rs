//! Writing in a tight loop, where samples wait for each other, and looking instead of sleeping.

use std::thread;
use std::time::{Duration, Instant};

use rtps_socket::{DataReader, DomainParticipant, LayerChoice, Qos};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);
const COUNT: i32 = 2000;

/// Writes a stream with these policies, and calls nothing after its last sample until the other end has it.
fn stream(offered: Qos, requested: Qos) -> (DomainParticipant, DataReader<Shape>) {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let writer = a.create_writer(&topic, offered).unwrap();
    let reader = b.create_reader(&topic, requested).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    thread::scope(|scope| {
        scope.spawn(|| {
            for x in 0..COUNT {
                writer.write(&shape("BLUE", x, 20)).unwrap();
            }
        });
        let (mut next, end) = (0, Instant::now() + LONG);
        while next < COUNT {
            assert!(Instant::now() < end, "the stream stops before {next}");
            reader.wait(Duration::from_millis(100));
            for sample in reader.take() {
                let value = sample.data.unwrap();
                assert!(value.x >= next, "{} after {next}", value.x);
                next = value.x + 1;
            }
        }
    });
    (b, reader)
}

#[test]
fn the_end_of_a_stream_is_sent_without_another_call() {
    stream(Qos::reliable().keep_all(), Qos::reliable().keep_all());
}

#[test]
fn a_short_history_holds_nothing_back() {
    stream(Qos::reliable().keep_last(1), Qos::reliable().keep_all());
}

#[test]
fn a_latency_budget_ends() {
    let patient = || {
        Qos::reliable()
            .keep_all()
            .latency_budget(Duration::from_millis(20))
    };
    stream(patient(), patient());
}

#[test]
fn what_waits_is_sent_before_the_writer_goes() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let patient = Qos::best_effort().latency_budget(Duration::from_millis(80));
    let writer = a
        .create_writer(&topic, patient.clone().keep_last(9))
        .unwrap();
    let reader = b.create_reader(&topic, patient).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    drop(writer);
    assert!(reader.take_next(Duration::from_secs(2)).is_some());
}

#[test]
fn who_looks_instead_of_sleeping_gets_samples_and_ends_in_time() {
    let domain = support::own_network();
    let open = || {
        let builder = DomainParticipant::builder().domain(domain);
        let builder = builder.layer(LayerChoice::InProcess);
        builder.busy_poll(Duration::from_millis(50)).open().unwrap()
    };
    let (a, b) = (open(), open());
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    for x in 0..20 {
        writer.write(&shape("BLUE", x, 0)).unwrap();
        let sample = reader.take_next(LONG).unwrap();
        assert_eq!(sample.data.unwrap().x, x);
    }
    for patience in [20, 200] {
        let (start, patience) = (Instant::now(), Duration::from_millis(patience));
        assert!(reader.take_next(patience).is_none());
        assert!(start.elapsed() >= patience);
    }
}
