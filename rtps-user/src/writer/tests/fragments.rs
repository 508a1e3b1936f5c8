//! Large changes: announced, repeated and held back by their fragments.

use super::*;

/// With a window that begins with 193 fragments.
fn matched() -> Bench {
    let qos = reliable(Durability::Volatile);
    let timing = WriterTiming {
        max_unacknowledged_bytes: 1 << 20,
        ..WriterTiming::default()
    };
    let mut bench = Bench::with_timing(qos.clone(), timing);
    bench.match_reader(1, 7411, qos);
    bench.lines();
    bench
}

#[test]
fn fragments_are_announced_and_repeated_while_the_rest_is_being_sent() {
    let mut bench = matched();
    bench.write(300 * DATAGRAM);
    let mut out = Vec::new();
    for _ in 0..96 {
        assert!(bench.writer.poll_transmit(bench.now, &mut out).is_some());
    }
    out.clear();
    bench.writer.poll_transmit(bench.now, &mut out);
    let announced = MessageReceiver::new(GuidPrefix([2; 12]), &out)
        .unwrap()
        .next();
    let Some(Ok(Received {
        submessage: Submessage::HeartbeatFrag(heartbeat),
        ..
    })) = announced
    else {
        panic!("{announced:?}");
    };
    assert_eq!((heartbeat.sequence.0, heartbeat.last_fragment), (1, 96));
    bench.nack_frag(1, 1, &[5, 96]);
    bench.nack_frag(1, 1, &[97]);
    let lines = bench.lines();
    let repeated: Vec<_> = lines.iter().filter(|line| line.ends_with("to 1")).collect();
    assert_eq!(repeated[..2], ["DATA_FRAG 1.5 to 1", "DATA_FRAG 1.96 to 1"]);
    assert!(
        !lines.iter().any(|line| line == "DATA_FRAG 1.97 to 1"),
        "not sent, not repeated"
    );
    assert_eq!(
        lines
            .iter()
            .filter(|line| line.starts_with("HeartbeatFrag"))
            .count(),
        3,
        "twice in the window, which has become smaller, and at its end"
    );
}

/// The fragments of change 1 that have been sent to all.
fn fragments(lines: &[String]) -> usize {
    let is_fragment = |line: &&String| line.starts_with("DATA_FRAG 1.") && line.ends_with("all");
    lines.iter().filter(is_fragment).count()
}

#[test]
fn a_large_change_waits_for_readers_that_tell_how_far_they_have_got() {
    let mut bench = matched();
    bench.write(1000 * DATAGRAM);
    let window = fragments(&bench.lines());
    assert_eq!(window, 193);
    bench.progress(1, 1, 50);
    let lines = bench.lines();
    assert!(
        (40..60).contains(&fragments(&lines)),
        "{}",
        fragments(&lines)
    );
    assert!(lines.last().unwrap().starts_with("HeartbeatFrag"));
    let questions = bench.pass(Duration::from_millis(19));
    let is_question = |line: &String| line.starts_with("HeartbeatFrag");
    assert!(!questions.is_empty() && questions.iter().all(is_question));
    let more = fragments(&bench.pass(Duration::from_millis(1)));
    assert_eq!(more, window, "the reader has not answered");
    for fragment in (200..1200).step_by(50) {
        bench.progress(1, 1, fragment);
        bench.lines();
    }
    assert_eq!(bench.lines(), [""; 0]);
    assert!(bench.writer.live.end() > SequenceNumber(1));
}

#[test]
fn a_reader_that_has_fallen_silent_does_not_hold_up_the_others() {
    let mut bench = matched();
    bench.match_reader(2, 7412, reliable(Durability::Volatile));
    bench.write(3000 * DATAGRAM);
    let window = fragments(&bench.lines());
    for reader in [1, 2] {
        bench.progress(reader, 1, 50);
    }
    let mut sent = window + fragments(&bench.lines());
    bench.progress(1, 1, sent as u32 + 1);
    assert_eq!(fragments(&bench.lines()), 0, "the other one is waited for");
    sent += fragments(&bench.pass(Duration::from_millis(20)));
    for _ in 0..3 {
        bench.progress(1, 1, sent as u32 + 1);
        let more = fragments(&bench.lines());
        assert_eq!(more, window, "only this one is waited for");
        sent += more;
    }
    bench.progress(2, 1, sent as u32 / 2);
    bench.progress(1, 1, sent as u32 + 1);
    assert_eq!(fragments(&bench.lines()), 0, "both are again");
}

#[test]
fn a_large_change_takes_its_time_for_other_readers() {
    let mut bench = matched();
    bench.write(1000 * DATAGRAM);
    let window = fragments(&bench.lines());
    assert_eq!(fragments(&bench.pass(Duration::from_micros(999))), 0);
    assert_eq!(fragments(&bench.pass(Duration::from_micros(1))), window);
    bench.nack_frag(1, 1, &[900]);
    assert_eq!(
        fragments(&bench.lines()),
        window,
        "it asks for what is to come"
    );
    bench.writer.hurry();
    assert!(fragments(&bench.lines()) > 2 * window);
    assert!(bench.writer.live.end() > SequenceNumber(1));
}

#[test]
fn nobody_waits_for_readers_that_are_gone() {
    let mut bench = matched();
    bench.write(1000 * DATAGRAM);
    bench.lines();
    bench.writer.unmatch_reader(reader_guid(1));
    bench.pass(Duration::from_secs(1));
    assert_eq!(bench.writer.poll_timeout(), None);
}
