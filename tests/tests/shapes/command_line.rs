//! Usage, exit codes, signals and the lines of a run.

use std::process::{Command, Output};

use anyhow::{Result, ensure};
use rtps_tests::stage::{PATIENCE, binaries};

use crate::lines::{self, Sample};
use crate::stage::{Ends, on_both_layers};

on_both_layers! {
    lines_of_a_run,
    interrupted,
}

fn run(arguments: &str) -> Result<Output> {
    let mut command = Command::new(binaries()?.example("shape_main"));
    Ok(command.args(arguments.split_whitespace()).output()?)
}

#[test]
fn help_goes_to_standard_output() -> Result<()> {
    let output = run("-P --help")?;
    ensure!(output.status.code() == Some(0));
    let text = String::from_utf8(output.stdout)?;
    ensure!(text.contains("--final-instance-state"), "{text}");
    ensure!(output.stderr.is_empty());
    Ok(())
}

#[test]
fn a_wrong_command_line_shows_the_usage() -> Result<()> {
    for arguments in [
        "-P",
        "-t Square",
        "-P -S -t Square",
        "-P -t Square -D x",
        "-S -t Square -q",
    ] {
        let output = run(arguments)?;
        ensure!(output.status.code() == Some(1), "{arguments}: {output:?}");
        let text = String::from_utf8(output.stderr)?;
        ensure!(text.contains("--final-instance-state"), "{text}");
        ensure!(!text.contains("not supported"), "{text}");
    }
    Ok(())
}

#[test]
fn what_cannot_be_set_up_ends_with_2() -> Result<()> {
    for arguments in ["-P -t Square -d 233", &format!("-S -t {}", "x".repeat(256))] {
        let mut command = Command::new(binaries()?.example("shape_main"));
        command
            .args(arguments.split_whitespace())
            .env("RTPS_LAYER", "in-process");
        let output = command.output()?;
        ensure!(output.status.code() == Some(2), "{arguments}: {output:?}");
    }
    Ok(())
}

/// Both sides say what they do, in order, and end with `Done.` and exit code 0.
fn lines_of_a_run(ends: &Ends<'_>) -> Result<()> {
    let mut subscriber = ends.subscriber("--num-topics 2")?;
    let mut publisher = ends.publisher("--num-topics 2 -c RED")?;
    for topic in ["Square", "Square1"] {
        lines::wait_line(&mut publisher, &format!("Create topic: {topic}"))?;
        lines::wait_line(&mut subscriber, &format!("Create topic: {topic}"))?;
    }
    for topic in ["Square", "Square1"] {
        lines::wait_line(
            &mut publisher,
            &format!("Create writer for topic: {topic} color: RED"),
        )?;
        lines::wait_line(
            &mut subscriber,
            &format!("Create reader for topic: {topic}"),
        )?;
    }
    let matched = "on_publication_matched() topic: 'Square'  type: 'ShapeType' : matched readers 1 (change = 1)";
    lines::wait_until(&publisher, "matched", |_| {
        lines::has_line(&publisher, matched)
    })?;
    let matched = "on_subscription_matched() topic: 'Square1'  type: 'ShapeType' : matched writers 1 (change = 1)";
    lines::wait_until(&subscriber, "matched", |_| {
        lines::has_line(&subscriber, matched)
    })?;
    let received = lines::wait_samples(&subscriber, 20)?;
    let written = lines::samples(&lines::interrupt(publisher)?);
    ensure!(received.iter().all(|sample| written.contains(sample)));
    lines::interrupt(subscriber)?;
    Ok(())
}

/// SIGINT ends a long sleep, also that of a publisher whose reader has stopped.
fn interrupted(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber("--read-period 3600000")?;
    let publisher = ends.publisher("--write-period 3600000 --num-iterations 5")?;
    lines::wait_samples(&publisher, 1)?;
    lines::interrupt(publisher)?;
    lines::interrupt(subscriber)?;
    let mut short = ends.publisher("--num-iterations 3 --write-period 1")?;
    short.wait_success(PATIENCE)?;
    let printed: Vec<Sample> = lines::samples(&short);
    ensure!(printed.len() == 3, "{printed:?}");
    Ok(())
}
