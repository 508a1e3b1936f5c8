//! Reliable readers: order, holes, joins, back-pressure.

use super::*;
use crate::qos::ResourceLimits;

fn bench() -> Bench {
    Bench::started(reliable(), reliable())
}

#[test]
fn what_comes_in_order_is_there_at_once() {
    let mut bench = bench();
    for sequence in 1..=3 {
        bench.data(sequence);
        assert_eq!(bench.taken(), [sequence]);
    }
    assert_eq!(bench.progress(), 4);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
}

#[test]
fn what_comes_early_waits_for_what_is_missing() {
    let mut bench = bench();
    bench.data(3);
    bench.data(2);
    assert_eq!(bench.taken(), [0; 0]);
    bench.data(1);
    assert_eq!(bench.taken(), [1, 2, 3]);
}

#[test]
fn duplicates_are_dropped_whether_delivered_or_held() {
    let mut bench = bench();
    for sequence in [1, 1, 3, 3, 2, 1, 2, 3] {
        bench.data(sequence);
    }
    assert_eq!(bench.taken(), [1, 2, 3]);
}

#[test]
fn a_gap_makes_way_and_costs_nothing_by_its_width() {
    let mut bench = Bench::new(transient_local(), transient_local());
    bench.gap(1, 1 << 40, &[(1 << 40) + 2]);
    bench.heartbeat((1 << 40) - 5, (1 << 40) + 3);
    for sequence in [1 << 40, (1 << 40) + 3, (1 << 40) + 1] {
        bench.data(sequence);
    }
    assert_eq!(bench.taken(), [1 << 40, (1 << 40) + 1, (1 << 40) + 3]);
    assert!(!bench.events().contains(&lost(1)));
}

#[test]
fn a_gap_to_the_end_of_all_numbers_is_survived() {
    let mut bench = Bench::new(reliable(), reliable());
    bench.gap(1, i64::MAX - 256, &[i64::MAX - 256, i64::MAX - 1]);
    bench.heartbeat(i64::MAX, i64::MAX);
    bench.data(i64::MAX);
    bench.data(i64::MAX);
    assert_eq!(bench.taken(), [0; 0]);
    bench.answers();
}

#[test]
fn a_gap_of_numbers_that_were_never_announced_is_not_believed() {
    let mut bench = bench();
    bench.data(1);
    bench.gap(2, 1 << 40, &[]);
    assert!(bench.progress() <= 2 + (1 << 16));
    bench.heartbeat(1, 2);
    bench.gap(3, 4, &[]);
    assert_eq!(bench.taken(), [1]);
}

#[test]
fn gaps_full_of_holes_are_bounded() {
    let mut bench = bench();
    for block in 0..250 {
        let base = 2 + 256 * block;
        let members: Vec<i64> = (base..base + 256).step_by(2).collect();
        bench.gap(base, base, &members);
    }
    let proxy = &bench.reader.proxies.get(bench.writer).unwrap();
    assert!(proxy.ranges() <= 4097, "{}", proxy.ranges());
}

#[test]
fn held_changes_are_bounded() {
    let mut bench = bench();
    for sequence in (2..200_000).filter(|sequence| sequence % 50_000 != 0) {
        bench.data(sequence);
        bench.heartbeat(1, sequence);
    }
    let held = bench.reader.proxies.get(bench.writer).unwrap().held_count();
    assert_eq!(held, 1 << 16);
    bench.data(1);
    bench.data(50_000);
    assert_eq!(bench.taken(), (1..=held as i64 + 2).collect::<Vec<_>>());
}

#[test]
fn held_bytes_are_bounded() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.max_sample_size = 10_000;
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    for sequence in 2..1000 {
        bench.data(sequence);
    }
    let held = bench.reader.proxies.get(bench.writer).unwrap().held_count();
    assert!(held <= 20_000 / 256, "{held}");
}

#[test]
fn a_heartbeat_tells_what_is_lost() {
    let mut bench = bench();
    bench.data(1);
    bench.data(4);
    bench.heartbeat(6, 7);
    assert_eq!(bench.taken(), [1, 4]);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable, lost(3)]);
    bench.data(6);
    assert_eq!(bench.taken(), [6]);
}

#[test]
fn a_heartbeat_far_ahead_is_believed_when_it_is_said_again() {
    let mut bench = bench();
    bench.data(1);
    bench.heartbeat(1 << 40, (1 << 40) + 5);
    assert_eq!(bench.progress(), 2);
    assert_eq!(bench.answers(), [Answer::AckNack(2, vec![], 3, false)]);
    bench.heartbeat(1 << 40, (1 << 40) + 5);
    assert_eq!(bench.progress(), 1 << 40);
}

#[test]
fn a_heartbeat_far_ahead_that_the_writer_denies_is_forgotten() {
    let mut bench = bench();
    bench.data(1);
    bench.heartbeat(i64::MAX, i64::MAX);
    bench.answers();
    bench.heartbeat(1, 2);
    bench.heartbeat(i64::MAX, i64::MAX);
    assert_eq!(bench.progress(), 2);
    bench.data(2);
    assert_eq!(bench.taken(), [1, 2]);
}

#[test]
fn a_late_reader_starts_where_the_history_starts_without_loss() {
    let mut bench = Bench::new(transient_local(), transient_local());
    bench.data(12);
    assert_eq!(bench.taken(), [0; 0]);
    bench.heartbeat(11, 12);
    bench.data(11);
    assert_eq!(bench.taken(), [11, 12]);
    assert!(
        !bench
            .events()
            .iter()
            .any(|event| matches!(event, ReaderEvent::SampleLost { .. }))
    );
}

#[test]
fn a_late_volatile_reader_has_no_use_for_history() {
    let mut bench = Bench::new(reliable(), transient_local());
    bench.answers();
    bench.heartbeat(1, 20);
    assert_eq!(bench.answers(), [Answer::AckNack(21, vec![], 2, true)]);
    bench.data(5);
    bench.data(21);
    assert_eq!(bench.taken(), [21]);
}

#[test]
fn a_late_volatile_reader_keeps_what_came_since_the_match() {
    let mut bench = Bench::new(reliable(), transient_local());
    bench.answers();
    bench.data(19);
    bench.heartbeat(1, 20);
    assert_eq!(bench.answers(), [Answer::AckNack(20, vec![20], 2, false)]);
    assert_eq!(bench.taken(), [19]);
}

#[test]
fn a_late_volatile_reader_believes_the_gap_of_its_writer() {
    let mut bench = Bench::new(reliable(), transient_local());
    bench.answers();
    bench.gap(1, 18, &[]);
    bench.heartbeat(1, 20);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(18, vec![18, 19, 20], 2, false)]
    );
}

#[test]
fn a_volatile_reader_that_was_there_first_wants_all() {
    let mut bench = Bench::new(reliable(), transient_local());
    bench.answers();
    bench.heartbeat(1, 0);
    bench.answers();
    bench.heartbeat(1, 3);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(1, vec![1, 2, 3], 3, false)]
    );
}

#[test]
fn a_volatile_writer_is_asked_for_all_it_has() {
    let mut bench = Bench::new(reliable(), reliable());
    bench.answers();
    bench.heartbeat(3, 4);
    assert_eq!(bench.answers(), [Answer::AckNack(3, vec![3, 4], 2, false)]);
}

#[test]
fn a_full_cache_holds_the_writer_up_without_loss() {
    let limits = ResourceLimits {
        max_samples: Some(2),
        ..ResourceLimits::default()
    };
    let qos = Qos {
        resource_limits: limits,
        ..reliable()
    };
    let mut bench = Bench::started(qos, reliable());
    for sequence in 1..=5 {
        bench.data(sequence);
    }
    let rejected = ReaderEvent::SampleRejected {
        writer: bench.writer,
        instance: key(0),
        reason: RejectedReason::Samples,
    };
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable, rejected]);
    bench.heartbeat(1, 5);
    assert_eq!(bench.answers(), [Answer::AckNack(3, vec![], 3, true)]);

    assert_eq!(bench.taken(), [1, 2]);
    bench.wait(20);
    assert_eq!(bench.answers(), [Answer::AckNack(5, vec![], 4, true)]);
    assert_eq!(bench.taken(), [3, 4]);
    assert_eq!(bench.answers(), [Answer::AckNack(6, vec![], 5, true)]);
    assert_eq!(bench.taken(), [5]);
}

#[test]
fn a_resumed_reader_goes_on_where_it_stopped() {
    let mut bench = Bench::new(transient_local(), transient_local());
    bench
        .reader
        .resume_from(bench.writer, SequenceNumber(8), 1000);
    assert_eq!(bench.answers(), [Answer::AckNack(8, vec![], 1001, false)]);
    bench.heartbeat(1, 9);
    bench.data(7);
    bench.data(8);
    assert_eq!(bench.taken(), [8]);
    assert_eq!(bench.answers(), [Answer::AckNack(9, vec![9], 1002, false)]);
}

#[test]
fn a_reader_resumed_without_progress_only_counts_on() {
    let mut bench = Bench::new(transient_local(), transient_local());
    bench
        .reader
        .resume_from(bench.writer, SequenceNumber(1), 1000);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 1001, false)]);
    bench.heartbeat(100_000, 100_001);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(
            100_000,
            vec![100_000, 100_001],
            1002,
            false
        )]
    );
}

#[test]
fn what_a_writer_filters_out_or_garbles_does_not_hold_up_the_rest() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.instance_of = Some(std::sync::Arc::new(|_, payload| {
        (payload.len() == 16).then(|| key(payload[0]))
    }));
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    let filtered = InlineQos {
        status: StatusInfo {
            filtered: true,
            ..StatusInfo::default()
        },
        ..InlineQos::default()
    };
    bench.submit(1, filtered, PayloadKind::None, &[]);
    bench.submit(2, InlineQos::default(), PayloadKind::Data, &[1, 2, 3]);
    bench.submit(3, InlineQos::default(), PayloadKind::Data, &[9; 16]);
    let samples = bench.take();
    assert_eq!(sequences(&samples), [3]);
    assert_eq!(samples[0].info.instance, key(9));
    assert!(bench.events().contains(&lost(1)));
}

#[test]
fn strangers_are_not_heard() {
    let mut bench = bench();
    bench.writer = writer(2);
    bench.data(1);
    bench.heartbeat(1, 5);
    bench.gap(1, 3, &[]);
    assert_eq!(bench.taken(), [0; 0]);
    assert_eq!(bench.answers(), []);
}

#[test]
fn what_is_held_of_an_unmatched_writer_is_lost() {
    let mut bench = bench();
    bench.data(1);
    bench.data(3);
    bench.reader.unmatch_writer(bench.now, bench.writer);
    assert!(bench.events().contains(&lost(1)));
    assert_eq!(bench.taken()[0], 1);
    assert_eq!(bench.reader.poll_timeout(), None);
}

#[test]
fn what_is_dealt_with_elsewhere_is_skipped() {
    let mut bench = Bench::new(transient_local(), transient_local());
    bench.answers();
    bench.data(3);
    bench.reader.skip_to(bench.writer, SequenceNumber(3));
    assert_eq!(bench.taken(), [3], "it was held");
    bench.reader.skip_to(bench.writer, SequenceNumber(2));
    assert_eq!(bench.reader.progress(bench.writer), Some(SequenceNumber(4)));
    bench.heartbeat(1, 5);
    let answer = Answer::AckNack(4, vec![4, 5], 2, false);
    assert_eq!(bench.answers(), [answer]);
}

#[test]
fn greetings_end_after_as_many_as_are_wanted() {
    let mut config = ReaderConfig::new(reader_guid(), transient_local());
    config.timing.max_greetings = 2;
    let mut bench = Bench::unmatched(config);
    let writer = remote(bench.writer, transient_local());
    bench.reader.match_writer(bench.now, &writer);
    let mut greetings = 0;
    for _ in 0..100 {
        greetings += bench.answers().len();
        bench.wait(50);
    }
    assert_eq!(greetings, 2);
}
