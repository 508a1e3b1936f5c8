//! Instances, HISTORY, RESOURCE_LIMITS, and what applications see of them.

use super::*;
use crate::qos::{History, Presentation, PresentationScope, ResourceLimits};

fn keep_last(depth: u32) -> Qos {
    Qos {
        history: History::KeepLast(depth),
        ..reliable()
    }
}

fn bench(qos: Qos) -> Bench {
    Bench::started(qos, reliable())
}

fn states(samples: &[Sample]) -> Vec<(i64, bool, ViewState, InstanceState)> {
    samples
        .iter()
        .map(|Sample { info, .. }| {
            (
                info.sequence.0,
                info.valid_data,
                info.view_state,
                info.instance_state,
            )
        })
        .collect()
}

#[test]
fn keep_last_keeps_the_newest_of_each_instance() {
    let mut bench = bench(keep_last(2));
    for sequence in 1..=6 {
        bench.sample(sequence, key((sequence % 2) as u8), ALIVE, b"data");
    }
    bench.sample(7, key(1), ALIVE, b"data");
    assert_eq!(bench.taken(), [4, 5, 6, 7]);
    assert_eq!(bench.reader.len(), 0);
}

#[test]
fn a_backlog_is_of_samples_that_stay() {
    for (qos, expected) in [(reliable(), true), (keep_last(1000), false)] {
        let mut bench = bench(qos);
        (1..=255).for_each(|sequence| bench.sample(sequence, key(1), ALIVE, b"data"));
        assert!(!bench.reader.has_backlog());
        bench.sample(256, key(1), ALIVE, b"data");
        assert_eq!(bench.reader.has_backlog(), expected);
        bench.take();
        assert!(!bench.reader.has_backlog());
    }
}

#[test]
fn news_do_not_push_out_data() {
    let mut bench = bench(keep_last(1));
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), DISPOSED, b"");
    bench.sample(3, key(1), DISPOSED, b"");
    assert_eq!(
        states(&bench.take()),
        [
            (1, true, ViewState::New, InstanceState::NotAliveDisposed),
            (2, false, ViewState::New, InstanceState::NotAliveDisposed),
        ]
    );
}

#[test]
fn a_change_without_end_of_lives_is_bounded() {
    let mut bench = bench(keep_last(1));
    for round in 0..1000 {
        bench.sample(2 * round + 1, key(1), ALIVE, b"data");
        bench.sample(2 * round + 2, key(1), DISPOSED, b"");
    }
    // The last data, and the news before and after it.
    let samples = bench.take();
    assert_eq!(sequences(&samples), [1998, 1999, 2000]);
    assert_eq!(samples[1].info.disposed_generation_count, 999);
}

#[test]
fn views_are_new_once_in_each_life() {
    let mut bench = bench(reliable());
    bench.sample(1, key(1), ALIVE, b"data");
    assert_eq!(bench.take()[0].info.view_state, ViewState::New);
    bench.sample(2, key(1), ALIVE, b"data");
    assert_eq!(bench.take()[0].info.view_state, ViewState::NotNew);
    bench.sample(3, key(1), DISPOSED, b"");
    let samples = bench.take();
    assert_eq!(
        states(&samples),
        [(3, false, ViewState::NotNew, InstanceState::NotAliveDisposed)]
    );
    assert!(samples[0].payload.is_empty());
    bench.sample(4, key(1), ALIVE, b"data");
    let info = bench.take()[0].info;
    assert_eq!(info.view_state, ViewState::New);
    assert_eq!(info.disposed_generation_count, 1);
    assert_eq!(info.no_writers_generation_count, 0);
}

#[test]
fn an_instance_lives_while_one_of_its_writers_does() {
    let mut bench = bench(reliable());
    bench
        .reader
        .match_writer(bench.now, &remote(writer(2), reliable()));
    bench.sample(1, key(1), ALIVE, b"data");
    bench.writer = writer(2);
    bench.sample(1, key(1), ALIVE, b"data");
    bench.take();
    bench.sample(2, key(1), UNREGISTERED, b"");
    assert!(bench.take().is_empty());
    bench.reader.unmatch_writer(bench.now, writer(1));
    let samples = bench.take();
    assert_eq!(
        samples[0].info.instance_state,
        InstanceState::NotAliveNoWriters
    );
    assert_eq!(samples[0].info.writer, writer(1));
    assert_eq!(bench.reader.cache.instances.len(), 0);
}

#[test]
fn no_writers_generations_are_counted() {
    let mut bench = bench(reliable());
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), UNREGISTERED, b"");
    bench.sample(3, key(1), ALIVE, b"data");
    let counts: Vec<_> = bench
        .take()
        .iter()
        .map(|sample| sample.info.no_writers_generation_count)
        .collect();
    assert_eq!(counts, [0, 0, 1]);
}

#[test]
fn ranks_count_what_follows() {
    let mut bench = bench(reliable());
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(2), ALIVE, b"data");
    bench.sample(3, key(1), DISPOSED, b"");
    bench.sample(4, key(1), ALIVE, b"data");
    bench.sample(5, key(1), DISPOSED, b"");
    bench.sample(6, key(1), ALIVE, b"data");
    let ranks: Vec<_> = bench
        .reader
        .read(4, &Selection::default())
        .iter()
        .map(|Sample { info, .. }| {
            (
                info.sample_rank,
                info.generation_rank,
                info.absolute_generation_rank,
            )
        })
        .collect();
    assert_eq!(ranks, [(2, 1, 2), (0, 0, 0), (1, 1, 2), (0, 0, 1)]);
}

#[test]
fn reading_leaves_what_taking_removes() {
    let mut bench = bench(reliable());
    bench.data(1);
    bench.data(2);
    assert!(bench.reader.has_data());
    let read = bench.reader.read(1, &Selection::default());
    assert_eq!(read[0].info.sample_state, SampleState::NotRead);
    assert_eq!(
        sequences(&bench.reader.read(9, &Selection::not_read())),
        [2]
    );
    assert!(!bench.reader.has_data());
    assert!(!bench.reader.has_matching(&Selection::not_read()));
    let taken = bench.take();
    assert_eq!(sequences(&taken), [1, 2]);
    assert_eq!(taken[0].info.sample_state, SampleState::Read);
    assert_eq!(taken[1].payload[..], 2i64.to_le_bytes());
    assert!(bench.reader.is_empty());
}

#[test]
fn selections_choose_by_instance_and_state() {
    let mut bench = bench(reliable());
    for (sequence, instance) in [(1, 1), (2, 2), (3, 1), (4, 3)] {
        bench.sample(sequence, key(instance), ALIVE, b"data");
    }
    bench.sample(5, key(2), DISPOSED, b"");
    let of_first = Selection {
        instance: Some(key(1)),
        ..Selection::default()
    };
    assert_eq!(sequences(&bench.reader.read(9, &of_first)), [1, 3]);
    let not_alive = Selection {
        instance_states: Mask::of(&[
            InstanceState::NotAliveDisposed,
            InstanceState::NotAliveNoWriters,
        ]),
        ..Selection::default()
    };
    assert_eq!(sequences(&bench.reader.take(9, &not_alive)), [2, 5]);
    let new = Selection {
        view_states: ViewState::New.into(),
        ..Selection::default()
    };
    assert_eq!(sequences(&bench.reader.take(9, &new)), [4]);
    let unknown = Selection {
        instance: Some(key(7)),
        ..Selection::default()
    };
    assert_eq!(bench.reader.take(9, &unknown), []);
    assert_eq!(bench.taken(), [1, 3]);
}

#[test]
fn instances_are_limited_and_idle_ones_make_room() {
    let limits = ResourceLimits {
        max_instances: Some(2),
        ..ResourceLimits::default()
    };
    let mut bench = bench(Qos {
        resource_limits: limits,
        ..reliable()
    });
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(2), ALIVE, b"data");
    bench.sample(3, key(2), DISPOSED, b"");
    bench.sample(4, key(3), ALIVE, b"data");
    assert_eq!(bench.progress(), 4);
    let rejected = ReaderEvent::SampleRejected {
        writer: bench.writer,
        instance: key(3),
        reason: RejectedReason::Instances,
    };
    assert!(bench.events().contains(&rejected));
    assert_eq!(bench.taken(), [1, 2, 3]);
    assert_eq!(bench.taken(), [4]);
    assert_eq!(bench.reader.cache.instances.len(), 2);
}

#[test]
fn samples_of_an_instance_are_limited() {
    let limits = ResourceLimits {
        max_samples_per_instance: Some(1),
        ..ResourceLimits::default()
    };
    let mut bench = bench(Qos {
        resource_limits: limits,
        ..reliable()
    });
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(1), ALIVE, b"data");
    bench.sample(3, key(2), ALIVE, b"data");
    assert_eq!(bench.taken(), [1]);
    assert_eq!(bench.taken(), [2, 3]);
}

#[test]
fn a_dispose_names_its_instance_by_key_hash_or_by_key() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.instance_of = Some(std::sync::Arc::new(|kind, payload| {
        let offset = if kind == PayloadKind::Key { 0 } else { 4 };
        payload.get(offset).copied().map(key)
    }));
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    let disposed = |key_hash| InlineQos {
        key_hash,
        status: DISPOSED,
        ..InlineQos::default()
    };
    bench.submit(1, InlineQos::default(), PayloadKind::Data, &[0, 0, 0, 0, 8]);
    bench.submit(2, InlineQos::default(), PayloadKind::Data, &[0, 0, 0, 0, 9]);
    bench.submit(3, disposed(None), PayloadKind::Key, &[8]);
    bench.submit(4, disposed(Some(key(9))), PayloadKind::None, &[]);
    bench.submit(5, disposed(None), PayloadKind::None, &[]);
    let samples = bench.take();
    let instances: Vec<_> = samples.iter().map(|sample| sample.info.instance).collect();
    assert_eq!(instances, [key(8), key(9), key(8), key(9)]);
    assert_eq!(samples[2].payload[..], [8]);
    assert!(
        samples
            .iter()
            .all(|sample| sample.info.instance_state == InstanceState::NotAliveDisposed)
    );
    assert!(bench.events().contains(&lost(1)));
}

#[test]
fn data_can_come_with_its_own_dispose() {
    let mut bench = bench(reliable());
    bench.sample(1, key(1), DISPOSED, b"data");
    assert_eq!(
        states(&bench.take()),
        [(1, true, ViewState::New, InstanceState::NotAliveDisposed)]
    );
}

#[test]
fn unknown_instances_can_be_disposed_but_not_unregistered() {
    let mut bench = bench(reliable());
    bench.sample(1, key(1), UNREGISTERED, b"");
    bench.sample(2, key(2), DISPOSED, b"");
    assert_eq!(
        states(&bench.take()),
        [(2, false, ViewState::New, InstanceState::NotAliveDisposed)]
    );
    assert_eq!(bench.progress(), 3);
}

#[test]
fn topics_without_key_have_one_instance() {
    let guid = Guid::new(
        READER_PREFIX,
        EntityId::of_app(1, 2, EntityKind::ReaderNoKey),
    );
    let mut bench = Bench::unmatched(ReaderConfig::new(guid, keep_last(1)));
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.sample(1, key(1), ALIVE, b"data");
    bench.sample(2, key(2), ALIVE, b"data");
    let samples = bench.take();
    assert_eq!(sequences(&samples), [2]);
    assert_eq!(samples[0].info.instance, KeyHash::default());
}

#[test]
fn samples_are_taken_one_by_one_as_by_many() {
    let mut bench = bench(reliable());
    for sequence in 1..=6 {
        bench.sample(sequence, key((sequence % 2) as u8), ALIVE, &[7]);
    }
    let of_one = Selection {
        instance: Some(key(1)),
        ..Selection::default()
    };
    let first = bench.reader.take_next(&of_one).unwrap();
    assert_eq!(first.info.sequence.0, 1);
    assert_eq!(first.info.view_state, ViewState::New);
    assert_eq!(first.info.sample_rank, 0);
    let second = bench.reader.take_next(&of_one).unwrap();
    assert_eq!(second.info.view_state, ViewState::NotNew);
    let next = std::iter::from_fn(|| bench.reader.take_next(&Selection::default()));
    assert_eq!(sequences(&next.collect::<Vec<_>>()), [2, 4, 5, 6]);
    assert!(bench.reader.is_empty());
}

#[test]
fn taking_one_makes_room_for_what_waits() {
    let qos = Qos {
        resource_limits: ResourceLimits {
            max_samples: Some(1),
            ..ResourceLimits::default()
        },
        ..reliable()
    };
    let mut bench = bench(qos);
    bench.data(1);
    bench.data(2);
    let take = |bench: &mut Bench| {
        let sample = bench.reader.take_next(&Selection::default());
        sample.map(|sample| sample.info.sequence.0)
    };
    assert_eq!(take(&mut bench), Some(1));
    assert_eq!(take(&mut bench), Some(2));
    assert_eq!(take(&mut bench), None);
}

#[test]
fn instances_can_be_kept_together() {
    for (scope, expected) in [
        (PresentationScope::Instance, [1, 3, 2, 4]),
        (PresentationScope::Topic, [1, 2, 3, 4]),
    ] {
        let mut bench = bench(Qos {
            presentation: Presentation {
                scope,
                coherent: false,
                ordered: true,
            },
            ..reliable()
        });
        for (sequence, instance) in [(1, 7), (2, 5), (3, 7), (4, 5)] {
            bench.sample(sequence, key(instance), ALIVE, b"data");
        }
        let samples = bench.take();
        assert_eq!(sequences(&samples), expected);
        assert_eq!(samples[0].info.sample_rank, 1);
        assert_eq!(samples[3].info.sample_rank, 0);
    }
}
