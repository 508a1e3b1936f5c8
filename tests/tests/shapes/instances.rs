//! Instances and topics of one publisher, and how instances end.

use anyhow::{Result, ensure};
use rtps_tests::stage::PATIENCE;

use crate::lines::{self, Sample, wait_line};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    instances_are_disposed,
    instances_are_unregistered,
}

on_the_in_process_layer! {
    several_instances_and_topics,
    the_end_of_a_publisher_ends_its_instances,
    sizes_go_round,
}

const COLORS: [&str; 3] = ["BLUE", "BLUE1", "BLUE2"];

/// Each iteration shows the same shape in every instance of every topic, which are read in the same order.
fn several_instances_and_topics(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-D l -k 0 -z 0 --num-instances 3 --num-topics 2")?;
    let subscriber = ends.subscriber("-D l -k 0 --num-topics 2")?;
    let complete = |samples: &[Sample]| count(samples, "Square1", 5) == 3;
    let samples = lines::wait_until(&subscriber, "five iterations", complete)?;
    for size in 1..=4 {
        let iteration: Vec<_> = samples
            .iter()
            .filter(|sample| sample.size == size)
            .collect();
        ensure!(iteration.len() == 6, "{iteration:?}");
        let place = (iteration[0].x, iteration[0].y);
        ensure!(
            iteration.iter().all(|sample| (sample.x, sample.y) == place),
            "{iteration:?}"
        );
        let mut colors: Vec<_> = iteration
            .iter()
            .map(|sample| sample.color.as_str())
            .collect();
        ensure!(colors[..3] == colors[3..], "{colors:?}");
        colors[..3].sort_unstable();
        ensure!(colors[..3] == COLORS, "{colors:?}");
    }
    Ok(())
}

fn count(samples: &[Sample], topic: &str, size: u32) -> usize {
    let of_size = |sample: &&Sample| sample.topic == topic && sample.size == size;
    samples.iter().filter(of_size).count()
}

pub(crate) fn instances_are_disposed(ends: &Ends<'_>) -> Result<()> {
    instances_end(ends, "d", "NOT_ALIVE_DISPOSED_INSTANCE_STATE")
}

fn instances_are_unregistered(ends: &Ends<'_>) -> Result<()> {
    instances_end(ends, "u", "NOT_ALIVE_NO_WRITERS_INSTANCE_STATE")
}

/// Each instance ends as the publisher says, with its own color.
fn instances_end(ends: &Ends<'_>, option: &str, state: &str) -> Result<()> {
    let subscriber = ends.subscriber("-k 0")?;
    let arguments =
        format!("--num-instances 3 --num-iterations 60 --final-instance-state {option}");
    let mut publisher = ends.publisher(&arguments)?;
    publisher.wait_success(PATIENCE)?;
    for color in COLORS {
        let line = format!("{:<10} {color:<10} {state}", "Square");
        lines::wait_until(&subscriber, &line, |_| lines::has_line(&subscriber, &line))?;
    }
    let other = match option {
        "d" => "NO_WRITERS",
        _ => "DISPOSED",
    };
    let subscriber = lines::interrupt(subscriber)?;
    ensure!(
        !lines::has_line(&subscriber, other),
        "{}",
        subscriber.text()
    );
    Ok(())
}

/// An app that ends leaves nothing alive.
fn the_end_of_a_publisher_ends_its_instances(ends: &Ends<'_>) -> Result<()> {
    let mut subscriber = ends.subscriber("")?;
    let publisher = ends.publisher("")?;
    lines::wait_samples(&subscriber, 3)?;
    lines::interrupt(publisher)?;
    wait_line(&mut subscriber, "matched writers 0 (change = -1)")?;
    let ended = "NOT_ALIVE_";
    lines::wait_until(&subscriber, ended, |_| lines::has_line(&subscriber, ended))?;
    Ok(())
}

fn sizes_go_round(ends: &Ends<'_>) -> Result<()> {
    let publisher = ends.publisher("-z 0 --size-modulo 3 --num-iterations 7 --write-period 1")?;
    lines::wait_samples(&publisher, 7)?;
    ensure!(lines::sizes(&publisher) == [1, 2, 3, 1, 2, 3, 1]);
    Ok(())
}
