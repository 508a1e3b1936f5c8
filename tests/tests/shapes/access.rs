//! Taking or reading, by instance or all at once.

use anyhow::{Result, ensure};

use crate::lines::{self, sizes};
use crate::stage::{Ends, on_the_in_process_layer};

on_the_in_process_layer! {
    read_samples_stay,
    what_was_read_is_not_new,
    what_was_taken_is_gone,
    instance_by_instance,
    all_at_once,
}

/// One sample, for readers however late.
const ONE: &str = "-D l --write-period 3600000";

/// `-R` prints what is there in each iteration.
fn read_samples_stay(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher(ONE)?;
    let subscriber = ends.subscriber("-D l -R --read-period 10")?;
    let samples = lines::wait_samples(&subscriber, 5)?;
    ensure!(
        samples.iter().all(|sample| *sample == samples[0]),
        "{samples:?}"
    );
    Ok(())
}

/// `-R --take-read` comes to an end, and prints a sample once.
fn what_was_read_is_not_new(ends: &Ends<'_>) -> Result<()> {
    is_printed_once(ends, "-D l -R --take-read --read-period 10 --ordered")
}

fn what_was_taken_is_gone(ends: &Ends<'_>) -> Result<()> {
    is_printed_once(ends, "-D l --read-period 10 --ordered")
}

fn is_printed_once(ends: &Ends<'_>, arguments: &str) -> Result<()> {
    let _publisher = ends.publisher(&format!("{ONE} --ordered"))?;
    let mut subscriber = ends.subscriber(arguments)?;
    lines::wait_samples(&subscriber, 1)?;
    let iterations = lines::wait_line(&mut subscriber, "iteration")?;
    ensure!(iterations.starts_with("Reading with ordered access, iteration "));
    for _ in 0..5 {
        lines::wait_line(&mut subscriber, "iteration")?;
    }
    let samples = lines::samples(&lines::interrupt(subscriber)?);
    ensure!(samples.len() == 1, "{samples:?}");
    Ok(())
}

/// Without `--take-read` the samples of an instance come together.
fn instance_by_instance(ends: &Ends<'_>) -> Result<()> {
    let publisher = ends.publisher("-D l -k 0 -z 0 --num-instances 3 --write-period 1000")?;
    lines::wait_samples(&publisher, 9)?;
    let subscriber = ends.subscriber("-D l -k 0 --read-period 900")?;
    // The first three iterations come in one go, or in few.
    lines::wait_samples(&subscriber, 9)?;
    let samples = lines::samples(&subscriber);
    let first = samples
        .iter()
        .map(|sample| sample.color.clone())
        .collect::<Vec<_>>();
    let changes = first[..9]
        .windows(2)
        .filter(|pair| pair[0] != pair[1])
        .count();
    ensure!(changes < 8, "{first:?}");
    Ok(())
}

/// With it, the samples of each instance are in order.
fn all_at_once(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-D l -k 0 -z 0 --write-period 10")?;
    let subscriber = ends.subscriber("-D l -k 0 --take-read")?;
    lines::wait_samples(&subscriber, 30)?;
    let sizes = sizes(&subscriber);
    ensure!(sizes[0] == 1 && lines::are_consecutive(&sizes), "{sizes:?}");
    Ok(())
}
