//! What reliable readers answer, and when.

use super::*;

#[test]
fn a_writer_is_greeted_until_its_first_heartbeat() {
    let mut bench = Bench::new(reliable(), reliable());
    assert_eq!(bench.reader.poll_timeout(), Some(bench.now));
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 1, false)]);
    bench.wait(49);
    assert_eq!(bench.answers(), []);
    bench.wait(1);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 2, false)]);
    bench.wait(50);
    assert_eq!(bench.answers(), []);
    bench.wait(50);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 3, false)]);
    bench.heartbeat(1, 0);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 4, true)]);
    assert_eq!(bench.reader.poll_timeout(), None);
}

#[test]
fn fast_dds_is_greeted_in_its_own_way() {
    let mut bench = Bench::unmatched(ReaderConfig::new(reader_guid(), reliable()));
    bench.writer.prefix.0[..2].copy_from_slice(&[0x01, 0x0f]);
    let known = remote(bench.writer, reliable());
    bench.reader.match_writer(bench.now, &known);
    assert_eq!(bench.answers(), [Answer::AckNack(0, vec![], 1, false)]);
}

#[test]
fn best_effort_readers_do_not_answer() {
    let mut bench = Bench::new(Qos::default(), reliable());
    bench.heartbeat(1, 5);
    assert_eq!(bench.answers(), []);
    assert_eq!(bench.reader.poll_timeout(), None);
}

#[test]
fn a_heartbeat_is_answered_with_what_is_there_and_what_is_missing() {
    let mut bench = Bench::started(reliable(), reliable());
    for sequence in [1, 2, 4, 7] {
        bench.data(sequence);
    }
    bench.heartbeat(1, 8);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(3, vec![3, 5, 6, 8], 3, false)]
    );
}

#[test]
fn an_acknack_spans_no_more_than_it_can() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.heartbeat(1, 50_000);
    let [Answer::AckNack(1, members, ..)] = &bench.answers()[..] else {
        panic!()
    };
    assert_eq!(*members, (1..=256).collect::<Vec<_>>());
}

#[test]
fn a_final_heartbeat_is_answered_only_where_something_is_missing() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.data(1);
    bench.heartbeat_with(1, 1, 2, true);
    assert_eq!(bench.answers(), []);
    bench.heartbeat_with(1, 2, 3, true);
    assert_eq!(bench.answers(), [Answer::AckNack(2, vec![2], 3, false)]);
}

#[test]
fn old_counts_are_ignored_until_they_may_have_begun_anew() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.heartbeat_with(1, 3, 1, false);
    assert_eq!(bench.answers(), []);
    bench.wait(500);
    bench.heartbeat_with(1, 3, 1, false);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(1, vec![1, 2, 3], 3, false)]
    );
}

#[test]
fn counts_wrap() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.wait(500);
    bench.heartbeat_with(1, 0, i32::MAX, false);
    bench.answers();
    bench.heartbeat_with(1, 1, i32::MIN, false);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![1], 4, false)]);
}

#[test]
fn what_has_been_asked_for_is_not_asked_for_again_at_once() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.heartbeat(1, 2);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![1, 2], 3, false)]);
    bench.wait(5);
    bench.heartbeat(1, 3);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![3], 4, false)]);
    bench.wait(14);
    bench.heartbeat(1, 3);
    assert_eq!(bench.answers(), []);
    bench.wait(1);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![1, 2], 5, false)]);
}

#[test]
fn repeated_loss_of_new_numbers_does_not_starve_old_ones() {
    let mut bench = Bench::started(reliable(), reliable());
    let mut asked_for_first = 0;
    for last in 1..=100 {
        bench.heartbeat(1, last);
        for answer in bench.answers() {
            let Answer::AckNack(_, members, ..) = answer else {
                panic!()
            };
            asked_for_first += usize::from(members.contains(&1));
        }
        bench.wait(1);
    }
    assert!((4..=6).contains(&asked_for_first), "{asked_for_first}");
}

#[test]
fn an_answer_can_wait() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.timing.heartbeat_response_delay = Duration::from_millis(3);
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.answers();
    bench.heartbeat(1, 2);
    bench.wait(2);
    assert_eq!(bench.answers(), []);
    bench.data(1);
    bench.wait(1);
    assert_eq!(bench.answers(), [Answer::AckNack(2, vec![2], 2, false)]);
}

#[test]
fn heartbeats_that_come_together_are_answered_once() {
    let mut bench = Bench::started(reliable(), reliable());
    for sequence in 1..=100 {
        bench.data(sequence);
        bench.heartbeat(1, sequence);
    }
    assert_eq!(bench.answers(), [Answer::AckNack(101, vec![], 3, true)]);
}

#[test]
fn repairs_that_are_lost_are_asked_for_again_when_the_last_has_come() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.heartbeat(1, 4);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(1, vec![1, 2, 3, 4], 3, false)]
    );
    bench.data(1);
    bench.data(3);
    assert_eq!(bench.answers(), []);
    bench.data(4);
    assert_eq!(bench.answers(), [Answer::AckNack(2, vec![2], 4, false)]);
    bench.data(2);
    assert_eq!(bench.answers(), []);
    assert_eq!(bench.taken(), [1, 2, 3, 4]);
}

#[test]
fn a_writer_that_does_not_answer_is_left_alone_until_it_is_heard() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.heartbeat(1, 1);
    let asked = |bench: &mut Bench| {
        let mut answers = 0;
        for _ in 0..100 {
            answers += bench.answers().len();
            bench.wait(20);
        }
        answers
    };
    assert_eq!(asked(&mut bench), 5);
    assert_eq!(bench.reader.poll_timeout(), None);
    bench.heartbeat(1, 1);
    assert_eq!(asked(&mut bench), 5);
}

#[test]
fn no_more_is_asked_for_at_once_than_finds_room() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.timing.max_requested_bytes = 100_000;
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.answers();
    let send = |bench: &mut Bench, sequence| {
        bench.sample(sequence, key(0), StatusInfo::default(), &[0; 30_000]);
    };
    send(&mut bench, 1);
    bench.heartbeat(1, 9);
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(2, vec![2, 3, 4], 2, false)]
    );
    bench.heartbeat(1, 9);
    assert_eq!(bench.answers(), [], "their repairs are on their way");
    for sequence in 2..=4 {
        send(&mut bench, sequence);
    }
    assert_eq!(
        bench.answers(),
        [Answer::AckNack(5, vec![5, 6, 7], 3, false)]
    );
    bench.gap(5, 8, &[]);
    assert_eq!(bench.answers(), [Answer::AckNack(8, vec![8, 9], 4, false)]);
}

#[test]
fn a_rematched_writer_is_answered_at_its_new_address() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.data(1);
    let mut moved = remote(bench.writer, reliable());
    moved.unicast = vec!["10.0.0.9:1".parse().unwrap()];
    bench.reader.match_writer(bench.now, &moved);
    bench.heartbeat(1, 1);
    let transmit = bench.reader.poll_transmit(bench.now, &mut Vec::new());
    assert_eq!(
        *transmit.unwrap().destinations,
        ["10.0.0.9:1".parse().unwrap()]
    );
    assert_eq!(bench.progress(), 2);
}

#[test]
fn counts_go_on_when_a_writer_comes_back() {
    let mut bench = Bench::started(reliable(), reliable());
    bench.reader.unmatch_writer(bench.now, bench.writer);
    let again = remote(bench.writer, reliable());
    bench.reader.match_writer(bench.now, &again);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![], 3, false)]);
}

/// Whoever claims numbers at the end of what there is must not make the reader say what nobody understands.
#[test]
fn answers_stay_readable_at_the_end_of_all_numbers() {
    let ends = (0..600).chain([1 << 20]).map(|back| i64::MAX - back);
    for end in ends {
        let mut bench = Bench::started(reliable(), reliable());
        for _ in 0..2 {
            bench.heartbeat(1, end);
            bench.answers();
            bench.heartbeat(end, end);
            bench.answers();
            bench.gap(end - 300, end, &[]);
            bench.data(end);
            bench.heartbeat(end, i64::MAX);
            bench.answers();
            bench.wait(1000);
            bench.answers();
        }
        assert!(bench.progress() > end - 300);
    }
}
