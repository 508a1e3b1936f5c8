//! Who drives when: callers that only poll, and listeners that own endpoints or wait themselves.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use rtps_socket::{DomainParticipant, LayerChoice, Qos, RtpsSocket, StatusEvent};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

/// Runs `act` on a thread of this network; fails when it does not end.
fn within_ten_seconds(act: impl FnOnce() + Send + 'static) {
    let (done, ended) = mpsc::channel();
    thread::spawn(move || {
        act();
        let _ = done.send(());
    });
    assert!(ended.recv_timeout(LONG).is_ok(), "it does not end");
}

/// Has `poll` called without a pause until it has taken 200 samples that another participant writes.
fn poll_samples(poll: impl Fn(&rtps_socket::DataReader<Shape>) -> usize) {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let writer = a.create_writer(&topic, Qos::reliable().keep_all()).unwrap();
    let reader = b.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
    // A wait takes the seat from the background thread and leaves it free.
    reader.wait_for_matched(1, LONG).unwrap();
    let writing = thread::spawn(move || {
        writer.wait_for_matched(1, LONG).unwrap();
        for x in 0..200 {
            writer.write(&shape("BLUE", x, 0)).unwrap();
        }
        writer.wait_for_acknowledgments(LONG).unwrap();
    });
    let (mut count, end) = (0, Instant::now() + LONG);
    while count < 200 || !writing.is_finished() {
        assert!(Instant::now() < end, "only {count} samples come");
        count += poll(&reader);
    }
    writing.join().unwrap();
}

#[test]
fn polling_without_waiting_gets_samples() {
    poll_samples(|reader| usize::from(reader.take_next(Duration::ZERO).is_some()));
    poll_samples(|reader| reader.take().len());
    poll_samples(|reader| {
        reader.wait(Duration::ZERO);
        reader.take().len()
    });
}

#[test]
fn a_listener_may_own_endpoints() {
    let domain = support::own_network();
    let participant = participant(domain);
    within_ten_seconds(move || {
        let topic = participant.create_topic::<Shape>("Square").unwrap();
        let owning = || {
            let writer = participant.create_writer(&topic, Qos::default()).unwrap();
            move |_: StatusEvent| drop(writer.matched())
        };
        let reader = participant.create_reader(&topic, Qos::default()).unwrap();
        reader.set_listener(owning());
        // One goes when it is replaced, the other with the reader.
        reader.set_listener(owning());
        drop(reader);
    });
}

#[test]
fn the_instances_of_a_reader_may_own_endpoints() {
    let domain = support::own_network();
    let builder = RtpsSocket::builder().domain(domain);
    let socket = builder.layer(LayerChoice::InProcess).open().unwrap();
    within_ten_seconds(move || {
        let writer = socket.create_writer("Raw", "Bytes", Qos::default(), true);
        let owned = writer.unwrap();
        let reader = socket.create_reader(
            "Raw",
            "Bytes",
            Qos::default(),
            Some(Arc::new(move |_, _| {
                owned.assert_liveliness();
                None
            })),
        );
        drop(reader.unwrap());
    });
}

/// Sends a sample from a listener of `echoing`, and waits there until it has been acknowledged.
fn echo_from_listener(
    echoing: &DomainParticipant,
    writer: rtps_socket::DataWriter<Shape>,
) -> (rtps_socket::DataReader<Shape>, Arc<AtomicBool>) {
    let trigger = echoing.create_topic::<Shape>("Trigger").unwrap();
    let reader = echoing.create_reader(&trigger, Qos::reliable()).unwrap();
    let is_acknowledged = Arc::new(AtomicBool::new(false));
    let (writer, result) = (Mutex::new(writer), Arc::clone(&is_acknowledged));
    reader.set_listener(move |_| {
        let writer = writer.lock().unwrap();
        writer.write(&shape("RED", 1, 0)).unwrap();
        let waited = writer.wait_for_acknowledgments(Duration::from_secs(3));
        result.store(waited.is_ok(), Ordering::SeqCst);
    });
    (reader, is_acknowledged)
}

#[test]
fn a_listener_may_wait_itself() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let topic = a.create_topic::<Shape>("Square").unwrap();
    let trigger = a.create_topic::<Shape>("Trigger").unwrap();
    let writer = b.create_writer(&topic, Qos::reliable().keep_all()).unwrap();
    let _sink = a.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    let (reader, is_acknowledged) = echo_from_listener(&b, writer);
    let waiting = thread::spawn(move || {
        let start = Instant::now();
        let sample = reader.take_next(Duration::from_secs(2));
        (sample.is_some(), start.elapsed())
    });
    // It waits, and so it is its thread that calls the listener.
    thread::sleep(Duration::from_millis(200));
    let writer = a
        .create_writer(&trigger, Qos::reliable().keep_all().transient_local())
        .unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    writer.write(&shape("BLUE", 1, 0)).unwrap();
    let (is_some, elapsed) = waiting.join().unwrap();
    assert!(is_some && elapsed < Duration::from_secs(2), "{elapsed:?}");
    assert!(is_acknowledged.load(Ordering::SeqCst));
}
