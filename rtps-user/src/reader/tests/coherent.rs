//! PRESENTATION coherent_access: sets are whole or absent.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::qos::{History, Presentation, PresentationScope, ResourceLimits};
use crate::wire::GroupDigest;

fn coherent(scope: PresentationScope) -> Qos {
    Qos {
        presentation: Presentation {
            scope,
            coherent: true,
            ordered: false,
        },
        ..reliable()
    }
}

fn topic() -> Qos {
    coherent(PresentationScope::Topic)
}

fn bench(qos: Qos) -> Bench {
    Bench::started(qos, topic())
}

fn in_set(first: i64) -> InlineQos {
    InlineQos {
        key_hash: Some(key(0)),
        coherent_set: Some(SequenceNumber(first)),
        ..InlineQos::default()
    }
}

const END: InlineQos = InlineQos {
    key_hash: None,
    status: ALIVE,
    coherent_set: Some(SequenceNumber::UNKNOWN),
    group_sequence: None,
    group_coherent_set: None,
    writer_group: None,
    lifespan: None,
};

impl Bench {
    /// A change of the set that begins with `first`.
    fn member(&mut self, sequence: i64, first: i64) {
        self.submit(sequence, in_set(first), PayloadKind::Data, b"data");
    }

    /// What ends a set.
    fn end(&mut self, sequence: i64) {
        self.submit(sequence, END, PayloadKind::None, &[]);
    }

    fn lost(&mut self) -> u64 {
        let count = |event| match event {
            ReaderEvent::SampleLost { count, .. } => count,
            _ => 0,
        };
        self.events().into_iter().map(count).sum()
    }
}

#[test]
fn a_set_is_there_when_it_has_ended() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    bench.member(2, 1);
    assert!(bench.events().is_empty());
    assert!(!bench.reader.has_data());
    assert_eq!(bench.progress(), 3, "it is acknowledged");
    bench.end(3);
    assert_eq!(bench.events(), [ReaderEvent::DataAvailable]);
    assert_eq!(bench.taken(), [1, 2]);
    assert_eq!(bench.progress(), 4);
}

#[test]
fn what_is_not_of_the_set_ends_it() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    bench.member(2, 2);
    assert_eq!(bench.taken(), [1]);
    bench.data(3);
    assert_eq!(bench.taken(), [2, 3]);
    bench.member(4, 4);
    bench.sample(5, key(0), DISPOSED, b"");
    assert_eq!(bench.taken(), [4, 5]);
}

/// The standard's examples, and what HDDS sends.
#[test]
fn a_change_of_nothing_ends_a_set_whatever_it_names() {
    let named = |set| InlineQos {
        coherent_set: Some(SequenceNumber(set)),
        ..InlineQos::default()
    };
    for end in [InlineQos::default(), END, named(0), named(1), named(2)] {
        let mut bench = bench(topic());
        bench.member(1, 1);
        bench.submit(2, end, PayloadKind::None, &[]);
        assert_eq!(bench.taken(), [1], "{end:?}");
        bench.member(3, 3);
        bench.member(4, 4);
        assert_eq!(bench.taken(), [3], "{end:?}");
    }
}

#[test]
fn what_another_filter_has_left_out_does_not_end_a_set() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    let mut filtered = in_set(1);
    filtered.status.filtered = true;
    bench.submit(2, filtered, PayloadKind::None, &[]);
    assert!(bench.taken().is_empty());
    bench.end(3);
    assert_eq!(bench.taken(), [1]);
}

/// Some do not keep the end for those that lost it.
#[test]
fn an_end_that_is_not_repeated_is_told_by_the_next_sample() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    bench.gap(2, 3, &[]);
    assert!(bench.taken().is_empty(), "it may have been of the set");
    bench.data(3);
    assert_eq!(bench.taken(), [1, 3]);
}

#[test]
fn its_end_counts_in_its_turn() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    bench.end(3);
    bench.data(4);
    assert!(bench.taken().is_empty());
    bench.member(2, 1);
    assert_eq!(bench.taken(), [1, 2, 4]);
}

#[test]
fn who_did_not_ask_for_it_sees_each_change_at_once() {
    let mut bench = bench(reliable());
    bench.member(1, 1);
    assert_eq!(bench.taken(), [1]);
    bench.end(2);
    assert_eq!(bench.progress(), 3);
    assert!(bench.taken().is_empty());
}

#[test]
fn what_is_irrelevant_is_no_loss_to_a_set() {
    let mut bench = bench(topic());
    bench
        .reader
        .set_content_filter(Some(std::sync::Arc::new(|_, data| data == b"data")), None);
    bench.member(1, 1);
    bench.gap(2, 3, &[]);
    bench.submit(3, in_set(1), PayloadKind::Data, b"nothing for us");
    bench.member(4, 1);
    bench.end(5);
    assert_eq!(bench.taken(), [1, 4]);
    assert_eq!(bench.lost(), 0);
}

#[test]
fn a_set_that_lacks_a_change_is_lost_as_a_whole() {
    let mut bench = bench(topic());
    for sequence in [1, 2, 4] {
        bench.member(sequence, 1);
    }
    bench.heartbeat(4, 4);
    bench.member(5, 1);
    bench.end(6);
    bench.member(7, 7);
    bench.end(8);
    assert_eq!(bench.taken(), [7]);
    assert_eq!(bench.lost(), 5);
}

#[test]
fn best_effort_sets_are_whole_or_absent() {
    let best_effort = Qos {
        reliability: Reliability::BestEffort,
        ..topic()
    };
    let mut bench = bench(best_effort);
    for sequence in [1, 3] {
        bench.member(sequence, 1);
    }
    bench.end(4);
    bench.member(5, 5);
    bench.member(6, 5);
    bench.end(7);
    bench.member(9, 8);
    bench.end(10);
    bench.member(11, 11);
    bench.data(13);
    assert_eq!(bench.taken(), [5, 6, 13]);
}

#[test]
fn a_set_that_began_before_the_match_is_not_shown() {
    let mut bench = Bench::new(topic(), topic());
    bench.heartbeat(3, 3);
    bench.member(3, 1);
    bench.end(4);
    bench.member(5, 5);
    bench.end(6);
    assert_eq!(bench.taken(), [5]);
}

#[test]
fn what_durable_writers_do_not_keep_is_no_loss() {
    let durable = Qos {
        durability: Durability::TransientLocal,
        ..topic()
    };
    let mut bench = Bench::new(durable.clone(), durable);
    bench.heartbeat(3, 4);
    bench.member(3, 1);
    bench.end(4);
    assert_eq!(bench.taken(), [3]);
}

#[test]
fn what_a_writer_leaves_open_is_lost() {
    let mut bench = bench(topic());
    bench.member(1, 1);
    bench.member(2, 1);
    bench.reader.unmatch_writer(bench.now, bench.writer);
    assert!(bench.taken().is_empty());
    assert_eq!(bench.lost(), 2);
    assert_eq!(bench.reader.cache.staged, 0);
}

fn limited(limits: ResourceLimits) -> Qos {
    Qos {
        resource_limits: limits,
        ..topic()
    }
}

#[test]
fn sets_wait_for_room_as_samples_do() {
    let mut bench = bench(limited(ResourceLimits {
        max_samples: Some(3),
        ..ResourceLimits::default()
    }));
    bench.member(1, 1);
    bench.member(2, 1);
    bench.end(3);
    bench.member(4, 4);
    bench.member(5, 4);
    bench.end(6);
    assert_eq!(bench.progress(), 5);
    assert_eq!(bench.taken(), [1, 2]);
    assert_eq!(bench.taken(), [4, 5]);
    assert_eq!(bench.progress(), 7);
    assert_eq!(bench.lost(), 0);
}

#[test]
fn sets_that_never_fit_do_not_block() {
    let limits = [
        ResourceLimits {
            max_samples: Some(2),
            ..ResourceLimits::default()
        },
        ResourceLimits {
            max_samples_per_instance: Some(2),
            ..ResourceLimits::default()
        },
    ];
    for limits in limits {
        let mut bench = bench(limited(limits));
        for sequence in 1..=3 {
            bench.member(sequence, 1);
        }
        bench.end(4);
        bench.member(5, 5);
        bench.end(6);
        assert_eq!(bench.taken(), [5]);
        assert_eq!(bench.progress(), 7);
        assert_eq!(bench.lost(), 3);
        assert_eq!(bench.reader.cache.staged, 0);
    }
}

#[test]
fn history_counts_once_a_set_is_there() {
    let mut bench = bench(Qos {
        history: History::KeepLast(1),
        ..topic()
    });
    bench.data(1);
    bench.member(2, 2);
    bench.member(3, 2);
    assert_eq!(
        sequences(&bench.reader.read(9, &Selection::default())),
        [1],
        "what is there stays until the set has ended"
    );
    bench.end(4);
    assert_eq!(bench.taken(), [3]);
}

/// A writer's part of the set of its publisher that begins with group sequence number `group`.
fn part(first: i64, group: i64, sequence: i64) -> InlineQos {
    InlineQos {
        group_sequence: Some(SequenceNumber(sequence)),
        group_coherent_set: Some(SequenceNumber(group)),
        ..in_set(first)
    }
}

fn end_of_part(group: i64) -> InlineQos {
    InlineQos {
        group_coherent_set: Some(SequenceNumber(group)),
        writer_group: Some(GroupDigest([7; 4])),
        ..END
    }
}

/// Two readers of one subscriber, each with its writer of one publisher.
fn groups() -> (Bench, Bench) {
    let group = || coherent(PresentationScope::Group);
    let mut second = Bench::unmatched(ReaderConfig::new(reader_guid(), group()));
    second.writer.entity.0[0] = 9;
    let mut benches = (bench(group()), second);
    benches
        .1
        .reader
        .match_writer(benches.1.now, &remote(benches.1.writer, group()));
    for bench in [&mut benches.0, &mut benches.1] {
        bench.reader.stage_groups();
        bench.heartbeat(1, 0);
        bench.submit(1, end_of_part(1), PayloadKind::None, &[]);
    }
    benches
}

#[test]
fn parts_of_a_group_wait_for_each_other() {
    let (mut first, mut second) = groups();
    first.submit(2, part(2, 3, 3), PayloadKind::Data, b"data");
    first.submit(3, end_of_part(3), PayloadKind::None, &[]);
    assert!(first.taken().is_empty());
    let set = first.reader.staged_groups().next().unwrap();
    assert_eq!(set.first, SequenceNumber(3));
    assert!(!first.reader.awaits_group(&set));
    assert!(second.reader.awaits_group(&set));
    second.submit(2, part(2, 3, 4), PayloadKind::Data, b"data");
    assert!(second.reader.awaits_group(&set));
    second.submit(3, end_of_part(3), PayloadKind::None, &[]);
    assert!(!second.reader.awaits_group(&set));
    for bench in [&mut first, &mut second] {
        bench.reader.release_group(&set);
        assert_eq!(bench.reader.staged_groups().count(), 0);
    }
    assert_eq!(first.taken(), [2]);
    let samples = second.take();
    assert_eq!(samples[0].info.group_sequence, Some(SequenceNumber(4)));
    assert_eq!(second.reader.cache.staged, 0);
}

#[test]
fn a_writer_without_part_in_a_set_says_so() {
    let (mut first, mut second) = groups();
    first.submit(2, part(2, 3, 3), PayloadKind::Data, b"data");
    first.submit(3, end_of_part(3), PayloadKind::None, &[]);
    let set = first.reader.staged_groups().next().unwrap();
    assert!(second.reader.awaits_group(&set));
    second.submit(2, end_of_part(3), PayloadKind::None, &[]);
    assert!(!second.reader.awaits_group(&set));
    second.reader.release_group(&set);
    assert!(second.taken().is_empty());
}

#[test]
fn a_writer_that_has_not_been_heard_is_waited_for() {
    let (mut first, mut second) = groups();
    second.writer.entity.0[0] = 8;
    let group = coherent(PresentationScope::Group);
    let known = remote(second.writer, group);
    second.reader.match_writer(second.now, &known);
    first.submit(2, part(2, 3, 3), PayloadKind::Data, b"data");
    first.submit(3, end_of_part(3), PayloadKind::None, &[]);
    second.writer.entity.0[0] = 9;
    second.submit(2, end_of_part(3), PayloadKind::None, &[]);
    let set = first.reader.staged_groups().next().unwrap();
    assert!(second.reader.awaits_group(&set));
    second.writer.entity.0[0] = 8;
    second.heartbeat(1, 0);
    assert!(!second.reader.awaits_group(&set), "it is of no group");
}

#[test]
fn a_writer_that_has_begun_its_part_is_waited_for() {
    let (mut first, mut second) = groups();
    second.writer.entity.0[0] = 8;
    let known = remote(second.writer, coherent(PresentationScope::Group));
    second.reader.match_writer(second.now, &known);
    second.heartbeat(1, 0);
    second.submit(1, part(1, 3, 4), PayloadKind::Data, b"data");
    first.submit(2, part(2, 3, 3), PayloadKind::Data, b"data");
    first.submit(3, end_of_part(3), PayloadKind::None, &[]);
    second.writer.entity.0[0] = 9;
    second.submit(2, end_of_part(3), PayloadKind::None, &[]);
    let set = first.reader.staged_groups().next().unwrap();
    assert!(second.reader.awaits_group(&set));
    second.writer.entity.0[0] = 8;
    second.submit(2, end_of_part(3), PayloadKind::None, &[]);
    assert!(!second.reader.awaits_group(&set));
}

#[test]
fn a_writer_that_is_gone_is_not_waited_for() {
    let (mut first, mut second) = groups();
    first.submit(2, part(2, 3, 3), PayloadKind::Data, b"data");
    first.submit(3, end_of_part(3), PayloadKind::None, &[]);
    let set = first.reader.staged_groups().next().unwrap();
    second.reader.unmatch_writer(second.now, second.writer);
    assert!(!second.reader.awaits_group(&set));
}

#[test]
fn without_somebody_to_release_them_groups_are_sets_of_their_writers() {
    let mut bench = bench(coherent(PresentationScope::Group));
    bench.submit(1, part(1, 1, 1), PayloadKind::Data, b"data");
    bench.submit(2, end_of_part(1), PayloadKind::None, &[]);
    assert_eq!(bench.taken(), [1]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Whatever is lost, reordered or doubled: a set is taken whole or not at all.
    #[test]
    fn sets_are_whole_or_absent(
        is_reliable in any::<bool>(),
        sizes in prop::collection::vec(1..6i64, 1..8),
        arrivals in prop::collection::vec((0..40usize, any::<bool>()), 0..120),
        max_samples in prop::option::of(4..9u32),
    ) {
        let reliability = if is_reliable { Reliability::RELIABLE } else { Reliability::BestEffort };
        let limits = ResourceLimits { max_samples, ..ResourceLimits::default() };
        let mut bench = bench(Qos { reliability, ..limited(limits) });
        // (number, first of its set); an end belongs to no set.
        let (mut changes, mut next) = (Vec::new(), 1);
        for size in &sizes {
            changes.extend((next..next + size).map(|sequence| (sequence, Some(next))));
            changes.push((next + size, None));
            next += size + 1;
        }
        let mut taken = BTreeSet::new();
        for (index, takes) in arrivals {
            match changes.get(index % changes.len()) {
                Some((sequence, Some(first))) => bench.member(*sequence, *first),
                Some((sequence, None)) => bench.end(*sequence),
                None => {}
            }
            if takes {
                taken.extend(bench.taken());
                let torn = changes.iter().filter_map(|(_, first)| *first).find(|first| {
                    let of_set = changes.iter().filter(|(_, other)| other == &Some(*first));
                    let count = of_set.clone().filter(|(number, _)| taken.contains(number)).count();
                    count != 0 && count != of_set.count()
                });
                prop_assert_eq!(torn, None);
            }
        }
        for _ in 0..20 {
            bench.taken();
        }
        prop_assert!(bench.reader.is_empty());
    }
}
