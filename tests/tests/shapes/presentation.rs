//! PRESENTATION: coherent sets come whole, ordered samples in order.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};
use rtps_tests::loss::Loss;
use rtps_tests::process::Process;
use rtps_tests::{require, skip_unless};

use crate::lines::{self, Sample};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    sets_of_a_topic_are_whole,
    sets_of_a_group_are_whole,
}

on_the_in_process_layer! {
    sets_of_an_instance_are_whole,
    repeated_sets_are_whole,
    lost_sets_are_absent,
    ordered_within_a_topic,
    ordered_within_an_instance,
    an_open_set_is_not_seen,
}

/// Iterations of a set.
const SET: u32 = 4;

fn publisher(ends: &Ends<'_>, scope: char, topics: u32) -> Result<Process> {
    ends.publisher(&format!(
        "--coherent --ordered --access-scope {scope} --coherent-sample-count {SET} -D l -k 0 -z 0 \
         --num-instances 2 --num-topics {topics} --write-period 20"
    ))
}

fn subscriber(ends: &Ends<'_>, scope: char, topics: u32) -> Result<Process> {
    let arguments =
        format!("--access-scope {scope} -D l -k 0 --num-topics {topics} --read-period 50");
    ends.subscriber(&format!("--coherent --ordered {arguments}"))
}

/// The samples of each iteration that is over; `begin` is in the first line of each.
fn iterations(app: &Process, begin: &str) -> Vec<Vec<Sample>> {
    let text = app.text();
    let mut iterations: Vec<_> = text
        .split(begin)
        .skip(1)
        .map(|text| text.lines().filter_map(Sample::parse).collect())
        .collect();
    iterations.pop();
    iterations
}

/// Waits until so many samples came in iterations that are over.
fn wait_iterations(app: &Process, begin: &str, samples: usize) -> Result<Vec<Vec<Sample>>> {
    let count = || iterations(app, begin).iter().map(Vec::len).sum::<usize>();
    lines::wait_until(app, "iterations with samples", |_| count() >= samples)?;
    Ok(iterations(app, begin))
}

/// As [`wait_iterations`], of a subscriber with coherent access.
fn wait_sets(app: &Process, samples: usize) -> Result<Vec<Vec<Sample>>> {
    wait_iterations(app, "Reading coherent sets, iteration ", samples)
}

/// Samples by topic and color, in their order.
fn by_instance(samples: &[Sample]) -> BTreeMap<(&str, &str), Vec<u32>> {
    let mut instances = BTreeMap::<_, Vec<_>>::new();
    for sample in samples {
        let instance = (sample.topic.as_str(), sample.color.as_str());
        instances.entry(instance).or_default().push(sample.size);
    }
    instances
}

/// Sizes begin with the first of a set, end with the last of one, and miss none.
fn ensure_whole(sizes: &[u32]) -> Result<()> {
    let (first, last) = (
        sizes.first().context("no sample")?,
        sizes.last().context("no sample")?,
    );
    ensure!(
        first % SET == 1 && last % SET == 0 && lines::are_consecutive(sizes),
        "{sizes:?}"
    );
    Ok(())
}

fn sets_of_an_instance_are_whole(ends: &Ends<'_>) -> Result<()> {
    let _publisher = publisher(ends, 'i', 1)?;
    let subscriber = subscriber(ends, 'i', 1)?;
    for iteration in wait_sets(&subscriber, 60)? {
        for sizes in by_instance(&iteration).values() {
            ensure_whole(sizes)?;
        }
    }
    Ok(())
}

fn sets_of_a_topic_are_whole(ends: &Ends<'_>) -> Result<()> {
    let _publisher = publisher(ends, 't', 1)?;
    let subscriber = subscriber(ends, 't', 1)?;
    for iteration in wait_sets(&subscriber, 60)? {
        let instances = by_instance(&iteration);
        for sizes in instances.values() {
            ensure_whole(sizes)?;
            ensure!(Some(sizes) == instances.values().next(), "{instances:?}");
        }
        ensure!([0, 2].contains(&instances.len()), "{instances:?}");
    }
    Ok(())
}

/// What one iteration shows of one topic, it shows of all.
pub(crate) fn sets_of_a_group_are_whole(ends: &Ends<'_>) -> Result<()> {
    let _publisher = publisher(ends, 'g', 3)?;
    let subscriber = subscriber(ends, 'g', 3)?;
    ensure_whole_groups(&subscriber)
}

fn ensure_whole_groups(subscriber: &Process) -> Result<()> {
    let iterations = wait_sets(subscriber, 400)?;
    // Readers that match later than others are behind with what was written before.
    let is_matched = |iteration: &Vec<Sample>| by_instance(iteration).len() == 6;
    let all_matched = iterations.iter().position(is_matched);
    let later = &iterations[all_matched.context("a topic without samples")? + 1..];
    for iteration in later {
        let instances = by_instance(iteration);
        for sizes in instances.values() {
            ensure_whole(sizes)?;
            ensure!(Some(sizes) == instances.values().next(), "{instances:?}");
        }
        ensure!([0, 6].contains(&instances.len()), "{instances:?}");
    }
    let whole = later.iter().filter(|iteration| is_matched(iteration));
    ensure!(whole.count() >= 3, "{iterations:?}");
    Ok(())
}

/// Losses delay sets and break none.
fn repeated_sets_are_whole(ends: &Ends<'_>) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let _publisher = publisher(ends, 'g', 3)?;
    let subscriber = subscriber(ends, 'g', 3)?;
    wait_sets(&subscriber, 24)?;
    let _lossy = ends.lose(Loss::Random(0.2))?;
    ensure_whole_groups(&subscriber)
}

/// A set that best effort loses a sample of is lost, and the next one is whole.
fn lost_sets_are_absent(ends: &Ends<'_>) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let both = "-b --coherent --access-scope t -k 0";
    let _publisher = ends.publisher(&format!(
        "{both} --coherent-sample-count {SET} -z 0 --write-period 10 --num-instances 2"
    ))?;
    let subscriber = ends.subscriber(&format!("{both} --read-period 20"))?;
    wait_sets(&subscriber, 1)?;
    let lossy = ends.lose(Loss::Random(0.1))?;
    let mut sets = BTreeMap::<_, usize>::new();
    for sample in wait_sets(&subscriber, 200)?.concat() {
        *sets.entry((sample.size - 1) / SET).or_default() += 1;
    }
    ensure!(
        sets.values().all(|samples| *samples == 2 * SET as usize),
        "{sets:?}"
    );
    let dropped = lossy[0].count()?.dropped;
    let (first, last) = (sets.keys().min(), sets.keys().max());
    let spanned = last
        .zip(first)
        .map(|(last, first)| (last - first + 1) as usize);
    ensure!(
        dropped > 0 && spanned > Some(sets.len()),
        "{dropped} {sets:?}"
    );
    Ok(())
}

/// All that there is at once is in the order of writing, across instances.
fn ordered_within_a_topic(ends: &Ends<'_>) -> Result<()> {
    for scope in ['t', 'g'] {
        let arguments = format!("--ordered --access-scope {scope} -D l -k 0");
        let publisher = format!("{arguments} -z 0 --num-instances 3 --write-period 5");
        let _publisher = ends.publisher(&publisher)?;
        let subscriber = ends.subscriber(&format!("{arguments} --take-read --read-period 200"))?;
        let samples = lines::wait_samples(&subscriber, 60)?;
        let colors = ["BLUE", "BLUE1", "BLUE2"];
        for (number, sample) in samples.iter().enumerate() {
            ensure!(sample.color == colors[number % 3], "{samples:?}");
            ensure!(sample.size as usize == number / 3 + 1, "{samples:?}");
        }
    }
    Ok(())
}

/// With INSTANCE scope what there is at once comes instance by instance.
fn ordered_within_an_instance(ends: &Ends<'_>) -> Result<()> {
    let arguments = "--ordered --access-scope i -D l -k 0";
    let publisher = format!("{arguments} -z 0 --num-instances 3 --write-period 5");
    let _publisher = ends.publisher(&publisher)?;
    let subscriber = ends.subscriber(&format!("{arguments} --take-read --read-period 500"))?;
    let begin = "Reading with ordered access, iteration ";
    for iteration in wait_iterations(&subscriber, begin, 60)? {
        let colors = iteration.iter().map(|sample| &sample.color);
        let changes = iteration
            .windows(2)
            .filter(|pair| pair[0].color != pair[1].color);
        let (changes, colors) = (changes.count(), BTreeSet::from_iter(colors).len());
        ensure!(changes + 1 == colors.max(1), "{iteration:?}");
        for sizes in by_instance(&iteration).values() {
            ensure!(lines::are_consecutive(sizes), "{iteration:?}");
        }
    }
    Ok(())
}

/// A set that its publisher does not end is never seen.
fn an_open_set_is_not_seen(ends: &Ends<'_>) -> Result<()> {
    let access = "--coherent --access-scope t -D l -k 0";
    let arguments = format!("{access} --coherent-sample-count 10 -z 0 --write-period 20");
    let mut publisher = ends.publisher(&format!("{arguments} --num-iterations 25"))?;
    let mut subscriber = ends.subscriber(access)?;
    publisher.wait_success(rtps_tests::stage::PATIENCE)?;
    lines::wait_line(&mut subscriber, "matched writers 0")?;
    lines::wait_line(&mut subscriber, "iteration")?;
    lines::wait_line(&mut subscriber, "iteration")?;
    let sizes = lines::sizes(&lines::interrupt(subscriber)?);
    ensure!(
        sizes.last() == Some(&20) && lines::are_consecutive(&sizes),
        "{sizes:?}"
    );
    Ok(())
}
