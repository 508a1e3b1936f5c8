//! An app with 20 matched readers, and as many writers, in which nothing happens: how often it wakes up nevertheless.

use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Result;
use rtps_tests::netns::Identity;
use rtps_tests::peers;
use rtps_tests::process::Process;
use serde_json::Value;

use super::figures::Figures;
use super::hosts::{Hosts, Sides};
use super::machine;
use super::options::Options;
use super::programs::Programs;
use super::row::{Case, Row, Stack};
use crate::interrupt;

const READERS: usize = 20;
/// What the start of the programs may take.
const START: Duration = Duration::from_secs(60);
/// Discovery is busy in the beginning, and announces itself more and more rarely.
const SETTLING: Duration = Duration::from_secs(10);
const WATCHED: Duration = Duration::from_secs(10);

/// Once for each of our layers that `cases` have; a quick run looks at the app while it still settles.
pub(super) fn measure(
    options: &Options,
    programs: &Programs,
    hosts: &Hosts,
    cases: &[Case],
) -> Result<Vec<Row>> {
    let ours = |case: &&Case| matches!(case.stack, Stack::Kernel | Stack::InProcess);
    let (settling, watched) = match options.quick {
        true => (SETTLING / 10, WATCHED / 10),
        false => (SETTLING, WATCHED),
    };
    let mut rows = Vec::new();
    for case in cases.iter().filter(ours) {
        let case = Case {
            bench: "idle",
            size: 0,
            readers: READERS,
            ..*case
        };
        interrupt::check()?;
        let sides = hosts.of(case.stack)?;
        let figures = watch(programs, case.stack, sides, (settling, watched))?;
        eprintln!("idle {}: {}", case.stack.name(), figures.in_short());
        rows.push(Row { case, figures });
    }
    Ok(rows)
}

fn watch(
    programs: &Programs,
    stack: Stack,
    sides: Sides<'_>,
    (settling, watched): (Duration, Duration),
) -> Result<Figures> {
    let remote = peers::cyclone_discovery()?;
    let host = &sides.passive[0];
    let arguments = format!("--remote --endpoints {READERS}");
    let mut remote = remote.command(&host.netns, &host.interface, &arguments);
    let _remote = Process::spawn("Cyclone DDS", &mut remote)?;
    let mut app = Process::spawn("the idle app", &mut app(programs, stack, sides)?)?;
    let matched = |event: &Value| event["event"] == "matched";
    app.wait_json_event(matched, START)?;
    thread::sleep(settling);
    let (before, start) = (machine::sleeps(app.pid())?, Instant::now());
    thread::sleep(watched);
    let sleeps = machine::sleeps(app.pid())? - before;
    Ok(Figures {
        wakeups_per_s: Some(sleeps as f64 / start.elapsed().as_secs_f64()),
        rss_kb: Some(machine::resident_kb(app.pid())?),
        ..Figures::default()
    })
}

/// As a user without any rights.
fn app(programs: &Programs, stack: Stack, sides: Sides<'_>) -> Result<Command> {
    let netns = &sides.active.netns;
    let mut command = netns.command_as(Identity::NOBODY, programs.this())?;
    command
        .args(["bench", "discovery-app"])
        .args(["--endpoints", &READERS.to_string()])
        .env("RTPS_LAYER", stack.layer());
    Ok(command)
}
