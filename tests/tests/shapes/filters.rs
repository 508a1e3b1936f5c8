//! Content filters and TIME_BASED_FILTER.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use crate::lines::{self, are_consecutive, wait_line};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    one_color,
    an_expression,
}

on_the_in_process_layer! {
    a_wrong_expression,
    a_minimum_separation,
    the_separation_is_of_each_instance,
}

/// `-c` filters; what does not pass is not lost but unwanted.
fn one_color(ends: &Ends<'_>) -> Result<()> {
    let _red = ends.publisher("-k 0 -z 0 -c RED --num-instances 2")?;
    let _blue = ends.publisher("-c BLUE -z 100")?;
    let mut subscriber = ends.subscriber("-k 0 -c RED")?;
    wait_line(&mut subscriber, "Create reader for topic: Square_filtered")?;
    let samples = lines::wait_samples(&subscriber, 20)?;
    for sample in &samples {
        ensure!(
            sample.color == "RED" && sample.topic == "Square_filtered",
            "{sample:?}"
        );
    }
    let sizes = lines::sizes(&subscriber);
    ensure!(are_consecutive(&sizes), "{sizes:?}");
    Ok(())
}

pub(crate) fn an_expression(ends: &Ends<'_>) -> Result<()> {
    let _publisher =
        ends.publisher("-D l -k 0 -z 0 --size-modulo 10 --num-instances 2 --write-period 10")?;
    let filter = "(shapesize BETWEEN 3 AND 5) AND color LIKE '%1'";
    let subscriber = ends.filtered_subscriber("-D l -k 0", filter)?;
    let samples = lines::wait_samples(&subscriber, 12)?;
    ensure!(
        samples.iter().all(|sample| sample.color == "BLUE1"),
        "{samples:?}"
    );
    let sizes: Vec<_> = samples[..12].iter().map(|sample| sample.size).collect();
    ensure!(sizes == [3, 4, 5].repeat(4), "{sizes:?}");
    Ok(())
}

/// It is said before a reader is created.
fn a_wrong_expression(ends: &Ends<'_>) -> Result<()> {
    for filter in ["shapesize <", "weight > 3"] {
        let mut subscriber = ends.filtered_subscriber("", filter)?;
        let status = subscriber.wait_exit(Duration::from_secs(20))?;
        ensure!(status.code() == Some(2), "{status}");
        ensure!(lines::has_line(
            &subscriber,
            "failed to create content filtered topic"
        ));
        ensure!(
            !lines::has_line(&subscriber, "Create reader"),
            "{}",
            subscriber.text()
        );
    }
    Ok(())
}

const SEPARATION: Duration = Duration::from_millis(500);

pub(crate) fn a_minimum_separation(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-k 0 -z 0 --write-period 10")?;
    let start = Instant::now();
    let subscriber = ends.subscriber("-k 0 --time-filter 500 --read-period 10")?;
    lines::wait_samples(&subscriber, 5)?;
    let received = lines::samples(&subscriber).len();
    let most = start.elapsed().as_millis() / SEPARATION.as_millis() + 1;
    ensure!(received as u128 <= most, "{received} > {most}");
    Ok(())
}

fn the_separation_is_of_each_instance(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-k 0 -z 0 --write-period 10 --num-instances 3")?;
    let subscriber = ends.subscriber("-k 0 --time-filter 500 --read-period 10")?;
    let samples = lines::wait_samples(&subscriber, 12)?;
    for color in ["BLUE", "BLUE1", "BLUE2"] {
        let of_color = samples
            .iter()
            .filter(|sample| sample.color == color)
            .count();
        ensure!(of_color >= 3, "{of_color} of {color} in {samples:?}");
    }
    Ok(())
}
