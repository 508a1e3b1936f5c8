//! Who matches whom: domain, topic, partition, and policies that do not fit.

use anyhow::{Result, ensure};
use rtps_tests::process::Process;

use crate::lines::{self, wait_line};
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_the_in_process_layer! {
    another_domain,
    announced_as_often_as_asked,
}

on_both_layers! {
    apart,
    partitions_with_wildcards,
    incompatible_policies,
    compatible_policies,
}

/// Samples after which an endpoint that does not match would have got some.
const ENOUGH: usize = 20;

/// Another topic or partition is another world, and nothing is said of it.
fn apart(ends: &Ends<'_>) -> Result<()> {
    let elsewhere = ["-t Circle", "-p other", "-p square", ""];
    nobody_hears(ends, elsewhere, "-p Square")
}

/// The kernel layer serves the domains that it was loaded for.
fn another_domain(ends: &Ends<'_>) -> Result<()> {
    nobody_hears(ends, ["", "-d 1"], "-d 2")
}

/// Only who is in the same place hears a publisher.
fn nobody_hears<const N: usize>(ends: &Ends<'_>, elsewhere: [&str; N], here: &str) -> Result<()> {
    let elsewhere = elsewhere.map(|arguments| ends.subscriber(arguments));
    let _publisher = ends.publisher(here)?;
    lines::wait_samples(&ends.subscriber(here)?, ENOUGH)?;
    for subscriber in elsewhere {
        let subscriber = lines::interrupt(subscriber?)?;
        let text = subscriber.text();
        ensure!(lines::samples(&subscriber).is_empty(), "{text}");
        ensure!(!lines::has_line(&subscriber, "on_"), "{text}");
    }
    Ok(())
}

/// A wildcard may be on either side.
fn partitions_with_wildcards(ends: &Ends<'_>) -> Result<()> {
    let _named = ends.publisher("-p room42 -c BLUE")?;
    let _wild = ends.publisher("-p room* -c RED")?;
    lines::wait_samples(&ends.subscriber("-p room4?")?, ENOUGH)?;
    let subscriber = ends.subscriber("-p room42")?;
    lines::wait_until(&subscriber, "both colors", |samples| {
        ["BLUE", "RED"]
            .iter()
            .all(|color| samples.iter().any(|sample| sample.color == *color))
    })?;
    Ok(())
}

/// Both sides name the policy; all pairs at once, each with a topic of its own.
fn incompatible_policies(ends: &Ends<'_>) -> Result<()> {
    let cases = [
        ("-b", "-r", "11 (RELIABILITY)"),
        ("-D v", "-D l", "2 (DURABILITY)"),
        ("-D l", "-D t", "2 (DURABILITY)"),
        ("-D t", "-D p", "2 (DURABILITY)"),
        ("-f 600", "-f 500", "4 (DEADLINE)"),
        ("", "-f 500", "4 (DEADLINE)"),
        ("-s 1", "", "6 (OWNERSHIP)"),
        ("", "-s 1", "6 (OWNERSHIP)"),
        ("-x 1", "-x 2", "23 (DATAREPRESENTATION)"),
        ("-x 2", "-x 1", "23 (DATAREPRESENTATION)"),
        ("", "--coherent", "3 (PRESENTATION)"),
        ("--coherent", "--ordered", "3 (PRESENTATION)"),
        (
            "--coherent --access-scope t",
            "--coherent --access-scope g",
            "3 (PRESENTATION)",
        ),
    ];
    let pairs = start_pairs(
        ends,
        cases.map(|(offered, requested, _)| (offered, requested)),
    )?;
    for (number, ((mut publisher, mut subscriber), (_, _, policy))) in
        pairs.into_iter().zip(cases).enumerate()
    {
        let offered = wait_line(&mut publisher, "on_offered_incompatible_qos()")?;
        let requested = wait_line(&mut subscriber, "on_requested_incompatible_qos()")?;
        for line in [offered, requested] {
            let end = format!("() topic: 'Topic{number}'  type: 'ShapeType' : {policy}");
            ensure!(line.ends_with(&end), "{line:?} should end with {end:?}");
        }
        ensure!(
            lines::samples(&subscriber).is_empty(),
            "{}",
            subscriber.text()
        );
    }
    Ok(())
}

/// Who offers more than is asked for, matches.
fn compatible_policies(ends: &Ends<'_>) -> Result<()> {
    let cases = [
        ("-r", "-b"),
        ("-b", "-b"),
        ("-D p", "-D t"),
        ("-D l", "-D v"),
        ("-f 500", "-f 600"),
        ("-f 500", ""),
        ("-s 1", "-s 2"),
        ("-x 2", "-x 2"),
        ("--coherent --ordered --access-scope g", ""),
        ("--access-scope i", "--access-scope g"),
        ("--ordered --access-scope t", "--ordered --access-scope i"),
    ];
    for (_publisher, subscriber) in &start_pairs(ends, cases)? {
        lines::wait_samples(subscriber, 3)?;
    }
    Ok(())
}

/// Starts publishers and subscribers, of Topic0, Topic1 and so on.
fn start_pairs<const N: usize>(
    ends: &Ends<'_>,
    options: [(&str, &str); N],
) -> Result<Vec<(Process, Process)>> {
    let start = |(number, (offered, requested))| {
        let publisher = ends.publisher(&format!("-t Topic{number} {offered}"))?;
        let subscriber = ends.subscriber(&format!("-t Topic{number} {requested}"))?;
        Ok((publisher, subscriber))
    };
    options.into_iter().enumerate().map(start).collect()
}

/// The period holds for as long as the program runs, not only at first.
fn announced_as_often_as_asked(ends: &Ends<'_>) -> Result<()> {
    let capture = ends.capture()?;
    // An announcement each 100 ms, a sample each 300 ms.
    let publisher = ends.publisher("--periodic-announcement 100 --write-period 300")?;
    lines::wait_samples(&publisher, 20)?;
    drop(publisher);
    // The participant's writer; over IPv4 alone, so that each counts once.
    let announcements = capture
        .finish()?
        .frames("ip && rtps.sm.wrEntityId == 0x000100c2")?;
    ensure!(announcements >= 20, "{announcements}");
    Ok(())
}
