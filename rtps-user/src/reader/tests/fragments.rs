//! Samples in fragments: any order, any loss, any lie.

use super::*;
use crate::reader::reassembly::Reassembly;

const FRAGMENT: usize = 100;

/// The parts of a fragment that a liar may change.
struct Fragment<'a> {
    sequence: i64,
    first: u32,
    count: u16,
    size: u16,
    sample: &'a [u8],
}

impl Bench {
    fn fragment(&mut self, fragment: &Fragment<'_>) {
        let start = (fragment.first as usize - 1) * usize::from(fragment.size);
        let end = start + usize::from(fragment.count) * usize::from(fragment.size);
        let data = DataFrag {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(fragment.sequence),
            first_fragment: fragment.first,
            fragment_count: fragment.count,
            fragment_size: fragment.size,
            sample_size: fragment.sample.len() as u32,
            inline_qos: InlineQos::default(),
            kind: PayloadKind::Data,
            payload: &fragment.sample[start..end.min(fragment.sample.len())],
        };
        self.reader
            .handle_data_frag(self.now, self.writer, None, &data);
    }

    fn part(&mut self, sequence: i64, first: u32, sample: &[u8]) {
        self.fragment(&Fragment {
            sequence,
            first,
            count: 1,
            size: FRAGMENT as u16,
            sample,
        });
    }

    fn heartbeat_frag(&mut self, sequence: i64, last_fragment: u32) {
        let heartbeat = HeartbeatFrag {
            reader: EntityId::UNKNOWN,
            writer: self.writer.entity,
            sequence: SequenceNumber(sequence),
            last_fragment,
            count: 1,
        };
        self.reader
            .handle_heartbeat_frag(self.now, self.writer, &heartbeat);
    }

    /// What there is of samples of the writer that are not whole.
    fn reassembly(&self) -> &Reassembly {
        &self.reader.proxies.get(self.writer).unwrap().reassembly
    }
}

fn bench() -> Bench {
    Bench::started(reliable(), reliable())
}

fn sample(length: usize) -> Vec<u8> {
    (0..length).map(|index| (index * 31 / 7) as u8).collect()
}

#[test]
fn fragments_make_a_sample_in_any_order() {
    let whole = sample(950);
    for order in [
        [1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
        [10, 9, 8, 7, 6, 5, 4, 3, 2, 1],
        [3, 10, 1, 2, 9, 8, 4, 5, 7, 6],
    ] {
        let mut bench = bench();
        for first in order {
            assert!(bench.take().is_empty());
            bench.part(1, first, &whole);
            bench.part(1, first, &whole);
        }
        let samples = bench.take();
        assert_eq!(samples.len(), 1);
        assert_eq!(samples[0].payload, whole);
    }
}

#[test]
fn several_fragments_come_in_one_submessage() {
    let (mut bench, whole) = (bench(), sample(950));
    for (first, count) in [(1, 4), (3, 7), (10, 1)] {
        bench.fragment(&Fragment {
            sequence: 1,
            first,
            count,
            size: FRAGMENT as u16,
            sample: &whole,
        });
    }
    assert_eq!(bench.take()[0].payload, whole);
}

#[test]
fn fragmented_samples_keep_their_place_in_the_order() {
    let (mut bench, whole) = (bench(), sample(250));
    bench.part(1, 1, &whole);
    bench.data(2);
    bench.part(1, 3, &whole);
    assert_eq!(bench.taken(), [0; 0]);
    bench.part(1, 2, &whole);
    assert_eq!(bench.taken(), [1, 2]);
}

#[test]
fn fragments_that_contradict_the_first_are_dropped() {
    let (mut bench, whole) = (bench(), sample(250));
    bench.part(1, 1, &whole);
    let lies = sample(9000);
    bench.part(1, 2, &lies);
    bench.fragment(&Fragment {
        sequence: 1,
        first: 2,
        count: 1,
        size: 50,
        sample: &whole,
    });
    bench.part(1, 2, &whole);
    bench.part(1, 3, &whole);
    assert_eq!(bench.take()[0].payload, whole);
}

#[test]
fn a_lie_does_not_block_the_truth_for_ever() {
    let (mut bench, whole) = (bench(), sample(250));
    bench.part(1, 1, &sample(9000));
    bench.wait(1000);
    for first in 1..=3 {
        bench.part(1, first, &whole);
    }
    assert_eq!(bench.take()[0].payload, whole);
}

#[test]
fn samples_beyond_the_limit_are_lost_and_hold_nobody_up() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.max_sample_size = 1000;
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.part(1, 1, &sample(1001));
    bench.data(2);
    assert_eq!(bench.taken(), [2]);
    assert!(bench.events().contains(&lost(1)));
}

#[test]
fn memory_grows_with_what_arrives_and_not_with_what_is_promised() {
    let mut bench = bench();
    let whole = vec![0; 60 << 20];
    for sequence in 1..=100 {
        bench.part(sequence, 600_000, &whole);
        bench.part(sequence, 1, &whole);
    }
    let reassembly = bench.reassembly();
    assert!(
        reassembly.reserved() <= 64 * (64 << 10),
        "{}",
        reassembly.reserved()
    );
}

#[test]
fn a_whole_sample_replaces_its_fragments() {
    let (mut bench, whole) = (bench(), sample(250));
    bench.part(1, 1, &whole);
    bench.data(1);
    bench.part(1, 2, &whole);
    bench.part(1, 3, &whole);
    assert_eq!(bench.taken(), [1]);
    assert!(bench.reassembly().is_empty());
}

#[test]
fn what_is_missing_of_a_sample_is_asked_for_by_fragments() {
    let (mut bench, whole) = (bench(), sample(1000));
    for first in [1, 2, 4, 7] {
        bench.part(1, first, &whole);
    }
    bench.heartbeat(1, 2);
    // Fragments 8 to 10 may still be on their way.
    assert_eq!(
        bench.answers(),
        [
            Answer::AckNack(1, vec![2], 3, false),
            Answer::NackFrag(1, vec![3, 5, 6], 1)
        ]
    );
    bench.wait(5);
    assert_eq!(bench.answers(), [Answer::NackFrag(1, vec![8, 9, 10], 2)]);
    bench.wait(15);
    bench.heartbeat(1, 2);
    assert_eq!(bench.answers(), [Answer::AckNack(1, vec![2], 4, false)]);
    bench.wait(5);
    assert_eq!(
        bench.answers(),
        [Answer::NackFrag(1, vec![3, 5, 6, 8, 9, 10], 3)]
    );
}

#[test]
fn all_fragments_have_been_sent_of_a_sample_that_another_has_overtaken() {
    let (mut bench, whole) = (bench(), sample(500));
    bench.part(1, 2, &whole);
    bench.part(2, 2, &whole);
    bench.heartbeat(1, 2);
    assert_eq!(
        bench.answers(),
        [
            Answer::AckNack(1, vec![], 3, true),
            Answer::NackFrag(1, vec![1, 3, 4, 5], 1),
            Answer::NackFrag(2, vec![1], 2)
        ]
    );
}

#[test]
fn fragments_that_are_lost_again_are_soon_asked_for_again() {
    let (mut bench, whole) = (bench(), sample(500));
    for first in [1, 3, 5] {
        bench.part(1, first, &whole);
    }
    bench.heartbeat(1, 1);
    assert_eq!(asked(&mut bench), [2, 4]);
    bench.wait(1);
    bench.part(1, 4, &whole);
    assert_eq!(asked(&mut bench), [2]);
    // That is lost, too; but repairs are known to take a millisecond, and seldom twice as much more.
    bench.wait(2);
    assert_eq!(asked(&mut bench), [0; 0]);
    bench.wait(1);
    assert_eq!(asked(&mut bench), [2]);
}

#[test]
fn a_heartbeat_frag_tells_which_fragments_are_there() {
    let (mut bench, whole) = (bench(), sample(1000));
    bench.heartbeat_frag(1, 10);
    assert_eq!(bench.answers(), []);
    bench.part(1, 1, &whole);
    bench.heartbeat_frag(1, 3);
    let all_below = |count| Answer::NackFrag(1, Vec::new(), count);
    assert_eq!(
        bench.answers(),
        [Answer::NackFrag(1, vec![2, 3], 1), all_below(2)]
    );
    bench.part(1, 2, &whole);
    bench.part(1, 3, &whole);
    assert_eq!(
        bench.answers(),
        [],
        "it was told not to wait for the repairs"
    );
    bench.heartbeat_frag(1, 3);
    let again = "that seems not to have got through";
    assert_eq!(bench.answers(), [all_below(3)], "{again}");
}

#[test]
fn many_missing_fragments_take_many_sets() {
    let (mut bench, whole) = (bench(), sample(100_000));
    bench.part(1, 1000, &whole);
    bench.wait(5);
    bench.heartbeat(1, 1);
    let missing: Vec<u32> = bench
        .answers()
        .into_iter()
        .flat_map(|answer| match answer {
            Answer::NackFrag(1, missing, _) => {
                assert!(missing.len() <= 256);
                missing
            }
            _ => Vec::new(),
        })
        .collect();
    assert_eq!(missing, (1..=999).collect::<Vec<_>>());
}

/// All fragments that are asked for now.
fn asked(bench: &mut Bench) -> Vec<u32> {
    let fragments = bench.answers().into_iter().flat_map(|answer| match answer {
        Answer::NackFrag(1, missing, _) => missing,
        _ => Vec::new(),
    });
    fragments.collect()
}

#[test]
fn no_more_fragments_are_asked_for_at_once_than_find_room() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.timing.max_requested_bytes = 70_000;
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    bench.answers();
    let whole = sample(200_000);
    bench.part(1, 2000, &whole);
    bench.heartbeat(1, 1);
    assert_eq!(asked(&mut bench), (1..=700).collect::<Vec<_>>());
    bench.heartbeat(1, 1);
    assert_eq!(asked(&mut bench), [0; 0], "their repairs are on their way");
    for first in (1..=700).filter(|first| first % 100 != 50) {
        assert_eq!(asked(&mut bench), [0; 0]);
        bench.part(1, first, &whole);
    }
    let lost = (1..=700).filter(|first| first % 100 == 50);
    let next: Vec<u32> = lost.chain(701..=1393).collect();
    assert_eq!(asked(&mut bench), next);
    for first in next.into_iter().chain(1394..=1999) {
        bench.part(1, first, &whole);
    }
    assert_eq!(bench.take()[0].payload, whole);
}

#[test]
fn samples_of_which_nothing_came_wait_for_the_fragments_of_others() {
    let mut config = ReaderConfig::new(reader_guid(), reliable());
    config.timing.max_requested_bytes = 70_000;
    let mut bench = Bench::unmatched(config);
    bench
        .reader
        .match_writer(bench.now, &remote(bench.writer, reliable()));
    let whole = sample(70_000);
    bench.part(1, 700, &whole);
    bench.heartbeat(1, 2);
    bench.answers();
    for first in 1..=699 {
        assert_eq!(bench.answers(), []);
        bench.part(1, first, &whole);
    }
    assert_eq!(bench.answers(), [Answer::AckNack(2, vec![2], 2, false)]);
}

#[test]
fn best_effort_drops_what_newer_samples_overtake() {
    let mut bench = Bench::new(Qos::default(), Qos::default());
    let whole = sample(250);
    bench.part(1, 1, &whole);
    for first in 1..=3 {
        bench.part(2, first, &whole);
    }
    bench.part(1, 2, &whole);
    bench.part(1, 3, &whole);
    assert_eq!(bench.taken(), [2]);
    assert!(bench.reassembly().is_empty());
}

#[test]
fn best_effort_never_runs_out_of_room() {
    let mut bench = Bench::new(Qos::default(), Qos::default());
    let whole = sample(250);
    for sequence in 1..=64 {
        bench.part(sequence, 1, &whole);
    }
    for sequence in 65..=200 {
        bench.part(sequence, 1, &whole);
        bench.part(sequence, 2, &whole);
        bench.wait(1);
    }
    for first in 1..=3 {
        bench.part(201, first, &whole);
    }
    assert_eq!(bench.taken(), [201]);
    assert!(bench.reassembly().is_empty());
}
