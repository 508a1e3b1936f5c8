//! How fast a host answers the first announcement of a participant that it has never heard of.

use std::time::Duration;

use anyhow::{Context, Result};
use serde::Serialize;

use super::Stack;
use super::hosts::{Hosts, Running, Start};
use super::probe::Answers;
use super::programs::Programs;
use super::waiting;

/// Long enough for all announcements, answered or not.
const PATIENCE: Duration = Duration::from_secs(600);
/// How long the host may take to come to rest.
const SETTLING: Duration = Duration::from_secs(20);

/// One stack.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub(super) stack: Stack,
    pub(super) p50_us: f64,
    pub(super) p99_us: f64,
    pub(super) unicast_p50_us: f64,
    pub(super) unicast_p99_us: f64,
    pub(super) multicast_p50_us: f64,
    pub(super) multicast_p99_us: f64,
    /// What rtpsd says of its interface: "kernel", or "rtpsd: " and why.
    pub(super) answers_by: Option<String>,
    /// Announcements that were answered.
    pub(super) answers: u64,
    pub(super) unanswered: u32,
}

/// Measures the stacks that there are.
pub(super) fn measure(programs: &Programs, notes: &mut Vec<String>) -> Result<Vec<Row>> {
    notes.push(
        "answer: clock of the stranger's process, from before it sends to after it has received from a socket that it asks \
         without pause; half of the announcements go to the host's port, half to the group"
            .to_owned(),
    );
    let mut stacks = vec![Stack::Kernel, Stack::User, Stack::Cyclone];
    if !programs.has_user_discovery()? {
        stacks.retain(|stack| *stack != Stack::User);
        notes.push("answer: rtpsd has no --discovery, so there is no row for user".to_owned());
    }
    stacks
        .into_iter()
        .map(|stack| {
            eprintln!("answer: {stack:?}");
            row(programs, stack).with_context(|| format!("answers of {stack:?}"))
        })
        .collect()
}

fn row(programs: &Programs, stack: Stack) -> Result<Row> {
    let hosts = Hosts::new()?;
    let start = Start {
        stack,
        apps: 1,
        app_arguments: match stack {
            // The standard's first ports, which rtpsd has too.
            Stack::Cyclone => "--participant-index 0",
            Stack::Kernel | Stack::User => "",
        },
    };
    let mut running = hosts.start(programs, start)?;
    running.settle(SETTLING)?;
    let (own, host) = (hosts.remote.interface.v4, hosts.measured.interface.v4);
    let arguments = format!("discovery-probe --own {own} --host {host}:7410");
    let mut probe = hosts.remote_role(programs, &arguments)?;
    let (_, printed) = waiting::require(&mut probe, "answers", PATIENCE)?;
    let answers: Answers = serde_json::from_value(printed)?;
    Ok(Row {
        stack,
        p50_us: answers.all.p50_us,
        p99_us: answers.all.p99_us,
        unicast_p50_us: answers.unicast.p50_us,
        unicast_p99_us: answers.unicast.p99_us,
        multicast_p50_us: answers.multicast.p50_us,
        multicast_p99_us: answers.multicast.p99_us,
        answers_by: answers_by(&running)?,
        answers: answers.all.count,
        unanswered: answers.unanswered,
    })
}

fn answers_by(running: &Running<'_>) -> Result<Option<String>> {
    let Some(layer) = &running.layer else {
        return Ok(None);
    };
    let interfaces = layer.status()?.interfaces;
    Ok(interfaces
        .into_iter()
        .next()
        .map(|interface| interface.answers))
}
