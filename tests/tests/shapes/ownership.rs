//! OWNERSHIP EXCLUSIVE, with DEADLINE: the strongest writer that is alive counts.

use anyhow::{Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::process::Process;

use crate::lines::{self, wait_line};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    the_stronger_writer_takes_over,
    a_missed_deadline_hands_over,
}

on_the_in_process_layer! {
    each_instance_has_an_owner,
    deadlines_are_missed_on_both_sides,
}

/// Waits for more samples of a size than there are.
pub(crate) fn wait_more(subscriber: &Process, size: u32, more: usize) -> Result<()> {
    let count =
        |samples: &[lines::Sample]| samples.iter().filter(|sample| sample.size == size).count();
    let wanted = count(&lines::samples(subscriber)) + more;
    let what = format!("{wanted} samples of size {size}");
    lines::wait_until(subscriber, &what, |samples| count(samples) >= wanted)?;
    Ok(())
}

pub(crate) fn the_stronger_writer_takes_over(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber("-s 0 -k 0")?;
    let _weak = ends.publisher("-s 3 -z 30")?;
    wait_more(&subscriber, 30, 5)?;
    let strong = ends.publisher("-s 4 -z 40")?;
    wait_more(&subscriber, 40, 20)?;
    // Once the stronger writer was heard, nothing of the weaker one was: they would alternate.
    let sizes = lines::sizes(&subscriber);
    let taken_over = sizes
        .iter()
        .position(|size| *size == 40)
        .unwrap_or_default();
    ensure!(!sizes[taken_over..].contains(&30), "{sizes:?}");
    lines::interrupt(strong)?;
    wait_more(&subscriber, 30, 5)
}

/// A writer that stands still is no owner any more, until it writes again.
fn a_missed_deadline_hands_over(ends: &Ends<'_>) -> Result<()> {
    let mut subscriber = ends.subscriber("-s 0 -k 0 -f 1000")?;
    let _weak = ends.publisher("-s 3 -z 30 -f 1000")?;
    let strong = ends.publisher("-s 4 -z 40 -f 1000")?;
    wait_more(&subscriber, 40, 10)?;
    strong.signal(Signal::SIGSTOP)?;
    wait_more(&subscriber, 30, 10)?;
    wait_line(
        &mut subscriber,
        "on_requested_deadline_missed() topic: 'Square'  type: 'ShapeType' : (total = ",
    )?;
    strong.signal(Signal::SIGCONT)?;
    wait_more(&subscriber, 40, 10)
}

/// The strongest of each instance: of an instance that only the weaker one writes, that one.
fn each_instance_has_an_owner(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber("-s 0 -k 0")?;
    let _weak = ends.publisher("-s 3 -z 30 --num-instances 2")?;
    wait_more(&subscriber, 30, 5)?;
    let _strong = ends.publisher("-s 4 -z 40")?;
    wait_more(&subscriber, 40, 5)?;
    wait_more(&subscriber, 30, 5)?;
    let samples = lines::samples(&subscriber);
    let taken_over = samples.iter().position(|sample| sample.size == 40);
    let later = &samples[taken_over.unwrap_or_default()..];
    for sample in later {
        let expected = if sample.color == "BLUE" { 40 } else { 30 };
        ensure!(sample.size == expected, "{later:?}");
    }
    Ok(())
}

/// A writer that is slower than it says, says so, and its reader too; totals count up.
fn deadlines_are_missed_on_both_sides(ends: &Ends<'_>) -> Result<()> {
    let mut publisher = ends.publisher("-f 200 --write-period 900")?;
    let mut subscriber = ends.subscriber("-f 300")?;
    for total in 1..=3 {
        let missed = format!("(total = {total}, change = 1)");
        let line = wait_line(&mut publisher, "on_offered_deadline_missed()")?;
        ensure!(line.ends_with(&missed), "{line}");
        let line = wait_line(&mut subscriber, "on_requested_deadline_missed()")?;
        ensure!(line.ends_with(&missed), "{line}");
    }
    Ok(())
}
