//! Two processes; the other one is this test program again.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rtps_socket::Qos;

use crate::support::{self, Shape, participant, shape};

const LONG: Duration = Duration::from_secs(10);
/// Tells the other process its domain.
const DOMAIN_VARIABLE: &str = "RTPS_SOCKET_TEST_DOMAIN";
const SAMPLES: i32 = 500;

/// Does nothing unless it is the other process.
#[test]
fn other_process() {
    let Ok(domain) = std::env::var(DOMAIN_VARIABLE) else {
        return;
    };
    let participant = participant(domain.parse().unwrap());
    let topic = participant.create_topic::<Shape>("Apart").unwrap();
    let writer = participant
        .create_writer(&topic, Qos::reliable().keep_all().transient_local())
        .unwrap();
    writer.wait_for_matched(1, LONG).unwrap();
    for x in 0..SAMPLES {
        writer.write(&shape("BLUE", x, 100)).unwrap();
    }
    writer.wait_for_acknowledgments(LONG).unwrap();
}

fn start_other(domain: u32) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "processes::other_process"])
        .env(DOMAIN_VARIABLE, domain.to_string())
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn samples_cross_from_process_to_process() {
    let domain = support::own_network();
    let participant = participant(domain);
    let topic = participant.create_topic::<Shape>("Apart").unwrap();
    // The other process writes as soon as it knows of this reader, which may not know of it then.
    let qos = Qos::reliable().keep_all().transient_local();
    let reader = participant.create_reader(&topic, qos).unwrap();
    let mut other = start_other(domain);
    for x in 0..SAMPLES {
        let sample = reader.take_next(LONG).expect("a sample");
        assert_eq!(sample.data.unwrap(), shape("BLUE", x, 100));
    }
    assert!(other.wait().unwrap().success());
    support::eventually(|| reader.matched().is_empty());
}
