//! HISTORY, DURABILITY and LIFESPAN: what a reader still gets.

use anyhow::{Result, ensure};

use crate::lines::{self, are_ascending, are_consecutive, sizes, wait_until};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    late_reader_gets_the_last_samples,
    volatile_reader_gets_no_old_samples,
    keep_all_gets_everything,
}

on_the_in_process_layer! {
    every_durability_above_volatile_keeps_samples,
    slow_reader_gets_the_newest,
    old_samples_are_gone_at_the_writer,
    old_samples_are_gone_at_the_reader,
}

/// A late reader begins with as many samples as the writer keeps.
fn late_reader_gets_the_last_samples(ends: &Ends<'_>) -> Result<()> {
    let depth = 3;
    let publisher = ends.publisher("-D l -k 3 -z 0 --write-period 200")?;
    let written = lines::wait_samples(&publisher, 8)?.len();
    let subscriber = ends.subscriber("-D l -k 0")?;
    lines::wait_samples(&subscriber, 6)?;
    let (received, written_later) = (sizes(&subscriber), sizes(&publisher).len());
    let at_joining = received[0] as usize + depth - 1;
    ensure!(
        (written..=written_later).contains(&at_joining),
        "{written} {received:?}"
    );
    ensure!(are_consecutive(&received), "{received:?}");
    Ok(())
}

/// One sample of each instance is kept at least.
fn every_durability_above_volatile_keeps_samples(ends: &Ends<'_>) -> Result<()> {
    for kind in ["l", "t", "p"] {
        let arguments = format!("-D {kind} --num-instances 5 --write-period 3600000");
        let publisher = ends.publisher(&arguments)?;
        lines::wait_samples(&publisher, 5)?;
        let subscriber = ends.subscriber(&format!("-D {kind}"))?;
        let received = lines::wait_samples(&subscriber, 5)?;
        ensure!(received.len() == 5, "{received:?}");
    }
    Ok(())
}

fn volatile_reader_gets_no_old_samples(ends: &Ends<'_>) -> Result<()> {
    let publisher = ends.publisher("-D l --num-instances 5 --write-period 3600000")?;
    lines::wait_samples(&publisher, 5)?;
    let mut volatile = ends.subscriber("-D v")?;
    lines::wait_line(&mut volatile, "on_subscription_matched()")?;
    // What came to a reader that was matched later would have come to this one.
    lines::wait_samples(&ends.subscriber("-D l")?, 5)?;
    let received = lines::samples(&lines::interrupt(volatile)?);
    ensure!(received.is_empty(), "{received:?}");
    Ok(())
}

fn keep_all_gets_everything(ends: &Ends<'_>) -> Result<()> {
    let count = 300;
    let subscriber = ends.subscriber("-D l -k 0 --read-period 300")?;
    let arguments = format!("-D l -k 0 -z 0 --write-period 1 --num-iterations {count}");
    let _publisher = ends.publisher(&arguments)?;
    lines::wait_samples(&subscriber, count)?;
    let received = sizes(&subscriber);
    ensure!(
        received[0] == 1 && are_consecutive(&received),
        "{received:?}"
    );
    Ok(())
}

/// A reader that looks now and then finds the last sample only, or as many as it keeps.
fn slow_reader_gets_the_newest(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-k 0 -z 0 --write-period 5")?;
    let last = ends.subscriber("--read-period 500")?;
    let several = ends.subscriber("--read-period 500 -k 4")?;
    let all = ends.subscriber("--read-period 500 -k 0")?;
    lines::wait_samples(&all, 100)?;
    lines::wait_samples(&last, 4)?;
    lines::wait_samples(&several, 16)?;
    ensure!(are_consecutive(&sizes(&all)), "{:?}", sizes(&all));
    let last = sizes(&last);
    ensure!(are_ascending(&last) && !are_consecutive(&last), "{last:?}");
    let several = sizes(&several);
    ensure!(
        several[..16].chunks(4).skip(1).all(are_consecutive),
        "{several:?}"
    );
    ensure!(!are_consecutive(&several[..16]), "{several:?}");
    Ok(())
}

/// Who joins late does not get what is older than LIFESPAN.
fn old_samples_are_gone_at_the_writer(ends: &Ends<'_>) -> Result<()> {
    let publisher = ends.publisher("-D l -k 0 -z 0 --write-period 50 --lifespan 200")?;
    lines::wait_samples(&publisher, 30)?;
    // The last four at most: a publisher that is held up writes less in the same time.
    let subscriber = ends.subscriber("-D l -k 0")?;
    lines::wait_samples(&subscriber, 3)?;
    let received = sizes(&subscriber);
    ensure!(received[0] > 24, "{received:?}");
    Ok(())
}

/// Who reads late does not get it either.
pub(crate) fn old_samples_are_gone_at_the_reader(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher("-k 0 -z 0 --write-period 20 --lifespan 100")?;
    let subscriber = ends.subscriber("-k 0 --read-period 1000")?;
    let jumped = |samples: &[lines::Sample]| {
        let jumps = samples
            .windows(2)
            .filter(|pair| pair[1].size > pair[0].size + 1);
        jumps.count() >= 2
    };
    wait_until(&subscriber, "samples that were too old", jumped)?;
    Ok(())
}
