//! What rtpsd knows, and whether the kernel answers without it.

use std::fs;
use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::Host;
use rtps_tests::process::Process;
use rtps_tests::stage::{Stage, eventually};
use rtps_user::wire::GuidPrefix;
use serde_json::Value;

use crate::crowd::Crowd;

/// A lease that no test outlives.
pub(crate) const LONG_LEASE: Duration = Duration::from_secs(100);
/// How often a participant that waits for an answer announces itself.
const PERIOD: Duration = Duration::from_millis(100);

/// Does something while rtpsd stands still.
pub(crate) fn while_stopped<T>(
    layer: &mut KernelLayer<'_>,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let daemon: &Process = layer.process();
    daemon.signal(Signal::SIGSTOP)?;
    eventually("rtpsd stands still", || {
        Ok(is_stopped(daemon)?.then_some(()))
    })?;
    let result = work();
    daemon.signal(Signal::SIGCONT)?;
    result
}

fn is_stopped(process: &Process) -> Result<bool> {
    let text = fs::read_to_string(format!("/proc/{}/stat", process.pid()))?;
    // The name in parentheses may hold anything.
    let (_, state) = text.rsplit_once(')').context("no name in it")?;
    Ok(state.trim_start().starts_with('T'))
}

/// A participant that nobody has seen before announces itself on `from` while rtpsd stands still: it gets all that the
/// host at `to` tells of itself.
pub(crate) fn ensure_kernel_answers(
    layer: &mut KernelLayer<'_>,
    from: &Host,
    to: Ipv4Addr,
) -> Result<()> {
    let answered = while_stopped(layer, || {
        Crowd::new(from, to, 1, (PERIOD, LONG_LEASE))?.run_until_content()
    });
    answered.context("the kernel alone does not answer")
}

/// A crowd that has been discovered, and has discovered the host.
pub(crate) fn known_crowd(stage: &Stage, count: u32, times: (Duration, Duration)) -> Result<Crowd> {
    let mut crowd = Crowd::new(&stage.theirs, stage.ours.interface.v4, count, times)?;
    crowd.run_until_content()?;
    Ok(crowd)
}

/// What discovery of domain 0 tells of remote participants.
pub(crate) fn participants(layer: &KernelLayer<'_>) -> Result<Vec<Value>> {
    let status = layer.status()?;
    let domain = status.domains.first().context("there is no domain")?;
    let discovery = domain.discovery.as_ref().context("rtpsd does not run")?;
    let list = discovery["participants"].as_array();
    Ok(list.context("there is no list of participants")?.clone())
}

/// Whether rtpsd knows a participant.
pub(crate) fn knows(layer: &KernelLayer<'_>, prefix: GuidPrefix) -> Result<bool> {
    let prefix = prefix.to_string();
    let mut known = participants(layer)?.into_iter();
    Ok(known.any(|participant| participant["prefix"] == prefix))
}

/// How many of a crowd rtpsd knows.
pub(crate) fn count_known(layer: &KernelLayer<'_>, prefixes: &[GuidPrefix]) -> Result<usize> {
    let known = participants(layer)?;
    let is_known = |prefix: &&GuidPrefix| {
        let prefix = prefix.to_string();
        known.iter().any(|one| one["prefix"] == prefix)
    };
    Ok(prefixes.iter().filter(is_known).count())
}

/// The interfaces and who answers on them, as `status` tells it.
pub(crate) fn ensure_answers_from_kernel(layer: &KernelLayer<'_>, interfaces: usize) -> Result<()> {
    let status = layer.status()?;
    ensure!(
        status.interfaces.len() == interfaces,
        "{:?}",
        status.interfaces
    );
    for interface in &status.interfaces {
        ensure!(interface.answers == "kernel", "{interface:?}");
    }
    Ok(())
}

/// How often rtpsd is woken meanwhile, not counting that it is asked for it.
pub(crate) fn wakeups_during(
    layer: &KernelLayer<'_>,
    work: impl FnOnce() -> Result<()>,
) -> Result<u64> {
    let wakeups = || layer.status()?.wakeups.context("rtpsd does not run");
    let first = wakeups()?;
    let before = wakeups()?;
    let of_a_question = before - first;
    work()?;
    Ok((wakeups()? - before).saturating_sub(of_a_question))
}
