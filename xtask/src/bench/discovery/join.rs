//! A host with many apps meets one remote participant, which is on Cyclone DDS whatever the host is on.
//!
//! The apps have been there for a while when the remote starts. Measured is from its start until it has matched every
//! endpoint of every app, and every app has matched its.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rtps_tests::process::Process;
use serde::Serialize;

use super::Stack;
use super::hosts::{Hosts, Running, START, Start};
use super::programs::Programs;
use super::tap::Tap;
use super::traffic::Traffic;
use super::usage::{self, ProgramStatistics};
use super::waiting;

/// When a match is given up.
const TIME_OUT: Duration = Duration::from_secs(60);
/// How long the apps may take to come to rest.
const SETTLING: Duration = Duration::from_secs(20);

/// One host, one stack.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub(super) stack: Stack,
    pub(super) apps: usize,
    /// At the remote's interface, both directions, until everything is matched or given up.
    pub(super) packets: u64,
    pub(super) bytes: u64,
    /// Packets with an announcement of a participant of the host.
    pub(super) participant_packets: u64,
    /// Samples that announce endpoints of the host, repetitions included.
    pub(super) endpoint_samples: u64,
    /// None when it took longer than the time-out.
    pub(super) match_seconds: Option<f64>,
    /// Of that, until the remote had made its endpoints.
    pub(super) remote_start_seconds: f64,
    /// Of the host: apps, rtpsd and its kernel programs.
    pub(super) cpu_seconds: f64,
    pub(super) remote_cpu_seconds: f64,
    /// False when the apps were still busy with each other when the remote came.
    pub(super) at_rest: bool,
    /// The apps were kept from finding each other.
    pub(super) apart: bool,
}

/// Measures both stacks with so many apps, size by size.
pub(super) fn measure(
    programs: &Programs,
    sizes: &[usize],
    notes: &mut Vec<String>,
) -> Result<Vec<Row>> {
    let _statistics = ProgramStatistics::take()?;
    notes.push(
        "join: packets and bytes are the kernel's counters of the remote's interface, both directions, all protocols; \
         cpu_seconds are those of the scheduler for rtpsd and the apps plus the run time of the layer's BPF programs, \
         which is part of remote_cpu_seconds too where they ran while the remote was sending"
            .to_owned(),
    );
    let mut rows = Vec::new();
    for apps in sizes {
        for stack in [Stack::Kernel, Stack::Cyclone] {
            eprintln!("join: {stack:?}, {apps} apps");
            let row = join(programs, stack, *apps)
                .with_context(|| format!("{stack:?} with {apps} apps"))?;
            if row.apart {
                notes.push(format!(
                    "join: {stack:?} with {apps} apps: they are kept from finding each other, which they never finish on a \
                     small machine; the remote finds them all the same"
                ));
            }
            if !row.at_rest {
                notes.push(format!(
                    "join: {stack:?} with {apps} apps was still busy with itself when the remote came"
                ));
            }
            if row.match_seconds.is_none() {
                notes.push(format!(
                    "join: {stack:?} with {apps} apps had not matched after {TIME_OUT:?}"
                ));
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

fn join(programs: &Programs, stack: Stack, apps: usize) -> Result<Row> {
    let hosts = Hosts::new()?;
    let start = Start {
        stack,
        apps,
        app_arguments: "--expect 1",
    };
    let apart = start.is_crowded();
    let mut running = hosts.start(programs, start)?;
    let at_rest = running.settle(SETTLING)?;
    let (traffic, cpu) = (Traffic::of(&hosts.remote)?, running.cpu_seconds()?);
    let tap = Tap::start(&hosts.remote, hosts.measured.interface.v4)?;
    let mut remote = start_remote(&hosts, programs, apps)?;
    let (begin, _) = waiting::require(&mut remote, "begin", START)?;
    let (ready, _) = waiting::require(&mut remote, "ready", START)?;
    let end = wait_for_matches(&mut remote, &mut running, begin + TIME_OUT)?;
    let traffic = Traffic::of(&hosts.remote)? - traffic;
    let discovered = tap.finish()?;
    Ok(Row {
        stack,
        apps,
        packets: traffic.packets,
        bytes: traffic.bytes,
        participant_packets: discovered.participant_packets,
        endpoint_samples: discovered.endpoint_samples,
        match_seconds: end.map(|end| (end - begin).as_secs_f64()),
        cpu_seconds: running.cpu_seconds()? - cpu,
        remote_cpu_seconds: usage::cpu_seconds(remote.pid())?,
        at_rest,
        apart,
        remote_start_seconds: (ready - begin).as_secs_f64(),
    })
}

fn start_remote(hosts: &Hosts, programs: &Programs, apps: usize) -> Result<Process> {
    let (netns, interface) = (&hosts.remote.netns, &hosts.remote.interface);
    let arguments = format!("--remote --expect {apps}");
    Process::spawn(
        "the remote",
        &mut programs.cyclone.command(netns, interface, &arguments),
    )
}

/// When the last one had matched.
fn wait_for_matches(
    remote: &mut Process,
    running: &mut Running<'_>,
    deadline: Instant,
) -> Result<Option<Instant>> {
    let mut last = None;
    for process in std::iter::once(remote).chain(&mut running.apps) {
        let Some((at, _)) = waiting::event(process, "matched", deadline)? else {
            return Ok(None);
        };
        last = last.max(Some(at));
    }
    Ok(last)
}
