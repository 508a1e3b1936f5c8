//! More than a socket likes: floods of what nobody wants, and large samples from several sides.

use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rtps_socket::cdr::{Representation, to_payload};
use rtps_socket::error::WriteError;
use rtps_socket::{Qos, Selection};

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);

/// Sends junk and half messages to the ports of the first two participants of a domain until `is_over`; with pauses,
/// because what the buffers cannot hold is lost for others as well.
fn flood(domain: u32, is_over: &AtomicBool) {
    let first = (7400 + 250 * domain + 10) as u16;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut header = b"RTPS\x02\x05\x01\x0f............".to_vec();
    header.extend([0x15, 0x01, 0xff, 0xff]);
    while !is_over.load(Ordering::Relaxed) {
        for port in first..first + 4 {
            for datagram in [&b"junk"[..], &header, b"R", &[]] {
                for _ in 0..25 {
                    let _ = socket.send_to(datagram, ("127.0.0.1", port));
                }
            }
        }
        thread::sleep(Duration::from_millis(1));
    }
}

/// Ends the flood, also when the test fails.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn a_flood_keeps_neither_matching_nor_samples_out() {
    let domain = support::own_network();
    let (a, b) = (participant(domain), participant(domain));
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| flood(domain, &is_over));
        let _over = Over(&is_over);
        let topic = a.create_topic::<Shape>("Square").unwrap();
        let writer = a.create_writer(&topic, Qos::reliable().keep_all()).unwrap();
        let reader = b.create_reader(&topic, Qos::reliable().keep_all()).unwrap();
        writer.wait_for_matched(1, LONG).unwrap();
        reader.wait_for_matched(1, LONG).unwrap();
        for x in 0..100 {
            writer.write(&shape("BLUE", x, 0)).unwrap();
            let sample = reader.take_next(LONG).map(|sample| sample.data.unwrap().x);
            assert_eq!(sample, Some(x));
        }
        writer.wait_for_acknowledgments(LONG).unwrap();
    });
}

#[test]
fn large_samples_of_two_writers_arrive_whole() {
    const SIZE: usize = 600_000;
    let domain = support::own_network();
    let (a, b, c) = (
        participant(domain),
        participant(domain),
        participant(domain),
    );
    let topic = a.create_topic::<Shape>("Large").unwrap();
    let qos = || Qos::reliable().keep_all().max_blocking_time(LONG);
    let reader = a.create_reader(&topic, qos()).unwrap();
    thread::scope(|scope| {
        for (from, color) in [(&b, "BLUE"), (&c, "RED")] {
            let topic = from.create_topic::<Shape>("Large").unwrap();
            let writer = from.create_writer(&topic, qos()).unwrap();
            scope.spawn(move || {
                writer.wait_for_matched(1, LONG).unwrap();
                for x in 0..4 {
                    writer.write(&shape(color, x, SIZE)).unwrap();
                }
                writer.wait_for_acknowledgments(LONG).unwrap();
            });
        }
        let mut counts = [0; 2];
        while counts != [4; 2] {
            let sample = reader.take_next(LONG).expect("a sample");
            let Some(value) = sample.data else { continue };
            let count = &mut counts[usize::from(value.color == "RED")];
            assert_eq!(value, shape(&value.color, *count, SIZE));
            *count += 1;
        }
    });
}

#[test]
fn what_is_written_into_a_loan_arrives() {
    let participant = participant(support::own_network());
    let topic = participant.create_topic::<Shape>("Lent").unwrap();
    let writer = participant
        .create_writer(&topic, Qos::reliable().keep_all())
        .unwrap();
    let reader = participant
        .create_reader(&topic, Qos::reliable().keep_all())
        .unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    reader.wait_for_matched(1, LONG).unwrap();
    let known = writer.matched_subscription_data(reader.guid()).unwrap();
    assert_eq!(known.topic_name, "Lent");
    let mut payload = Vec::new();
    for x in 0..3 {
        let sample = shape("BLUE", x, 100_000);
        to_payload(&sample, Representation::Xcdr1, &mut payload).unwrap();
        let mut loan = writer.loan(payload.len());
        loan.copy_from_slice(&payload);
        writer.write_loaned(loan).unwrap();
        writer.wait_for_acknowledgments(LONG).unwrap();
        let taken = reader.take_serialized(1, &Selection::default()).remove(0);
        assert_eq!(taken.payload, payload);
        assert_eq!(reader.lookup_instance(&sample), Some(taken.info.instance));
        payload.clear();
    }
    let nonsense = writer.loan(4);
    assert_eq!(
        writer.write_loaned(nonsense),
        Err(WriteError::NoSample("ShapeType"))
    );
}
