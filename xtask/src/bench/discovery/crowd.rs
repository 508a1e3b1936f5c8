//! A crowd of remote participants joins a host with a few apps, stays for a while, and half of it vanishes.
//!
//! The host knows everybody when every app has matched its endpoints with those of every member, and the layer's status
//! says the same. In the steady state the members do nothing but announce themselves.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::process::Process;
use serde::Serialize;
use serde_json::Value;

use super::Stack;
use super::hosts::{Hosts, Running, START, Start};
use super::member::LEASE;
use super::programs::Programs;
use super::usage::{self, ProgramStatistics};
use super::waiting;

const APPS: usize = 3;
/// Writers of a member and of an app, and as many readers.
const ENDPOINTS: usize = 2;
/// When discovery is given up.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long the apps may take to come to rest.
const SETTLING: Duration = Duration::from_secs(20);
/// From full discovery to the steady state.
const PAUSE: Duration = Duration::from_secs(5);
/// How often the status is looked at.
const LOOK: Duration = Duration::from_secs(5);
/// How long after its lease the end of a member is waited for.
const GRACE: Duration = Duration::from_secs(10);

/// One crowd.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub(super) participants: usize,
    pub(super) discovery_seconds: f64,
    /// Of the host until then: apps, rtpsd and its kernel programs.
    pub(super) cpu_seconds: f64,
    /// How often rtpsd was woken in the steady state, while nobody asked for its status.
    pub(super) wakeups_per_minute: f64,
    /// How often the apps were, each.
    pub(super) app_wakeups_per_minute: f64,
    /// CPU seconds of the host in a minute of the steady state.
    pub(super) steady_cpu_seconds_per_minute: f64,
    pub(super) steady_seconds: u64,
    /// Members that the host ever believed to be gone while they were there.
    pub(super) lost: usize,
    /// Members that fell silent in the end.
    pub(super) silenced: usize,
    /// From the end of a silent member's lease until the apps were told, the longest; none when one was never forgotten.
    pub(super) forgotten_seconds_after_lease: Option<f64>,
}

/// Measures small and large crowds; a long steady state is for the largest.
pub(super) fn measure(
    programs: &Programs,
    quick: bool,
    notes: &mut Vec<String>,
) -> Result<Vec<Row>> {
    let _statistics = ProgramStatistics::take()?;
    notes.push(
        "crowd: wakeups are voluntary context switches of rtpsd in the last third of the steady state, in which nobody \
         asks for its status; in the first two thirds it is asked each 5 s"
            .to_owned(),
    );
    let cases = match quick {
        true => [(100, 20), (1000, 20)],
        false => [(100, 60), (1000, 180)],
    };
    cases
        .into_iter()
        .map(|(members, steady)| {
            eprintln!("crowd: {members} participants, {steady} s");
            join_and_stay(programs, members, Duration::from_secs(steady))
                .with_context(|| format!("a crowd of {members}"))
        })
        .collect()
}

fn join_and_stay(programs: &Programs, members: usize, steady: Duration) -> Result<Row> {
    let hosts = Hosts::new()?;
    let arguments = format!("--endpoints {ENDPOINTS} --expect {members}");
    let start = Start {
        stack: Stack::Kernel,
        apps: APPS,
        app_arguments: &arguments,
    };
    let mut running = hosts.start(programs, start)?;
    running.settle(SETTLING)?;
    let cpu = running.cpu_seconds()?;
    let begin = Instant::now();
    let mut crowd = start_crowd(&hosts, programs, members)?;
    let discovery = wait_for_matches(&mut running, begin)?;
    let cpu_seconds = running.cpu_seconds()? - cpu;
    ensure!(
        known(&running)?.len() == members,
        "the status knows others than the apps do"
    );
    waiting::pause(PAUSE)?;
    let state = SteadyState::watch(&mut running, steady)?;
    let (silenced, forgotten) = wait_for_ends(&mut crowd, &mut running)?;
    Ok(Row {
        participants: members,
        discovery_seconds: discovery.as_secs_f64(),
        cpu_seconds,
        wakeups_per_minute: state.wakeups_per_minute,
        app_wakeups_per_minute: state.app_wakeups_per_minute,
        steady_cpu_seconds_per_minute: state.cpu_seconds_per_minute,
        steady_seconds: steady.as_secs(),
        lost: state.lost(&running, members, &silenced)?,
        silenced: silenced.len(),
        forgotten_seconds_after_lease: forgotten,
    })
}

fn start_crowd(hosts: &Hosts, programs: &Programs, members: usize) -> Result<Process> {
    let (own, host) = (hosts.remote.interface.v4, hosts.measured.interface.v4);
    let silent = members / 2;
    let arguments = format!(
        "discovery-crowd --members {members} --endpoints {ENDPOINTS} --own {own} --host {host}:7410 --silent {silent}"
    );
    let mut crowd = hosts.remote_role(programs, &arguments)?;
    waiting::require(&mut crowd, "started", START)?;
    Ok(crowd)
}

/// How long it took until all apps had matched all members.
fn wait_for_matches(running: &mut Running<'_>, begin: Instant) -> Result<Duration> {
    let mut longest = Duration::ZERO;
    for app in &mut running.apps {
        let left = (begin + PATIENCE).saturating_duration_since(Instant::now());
        let (at, _) = waiting::require(app, "matched", left)?;
        longest = longest.max(at - begin);
    }
    Ok(longest)
}

/// The participants that the layer knows with all of their endpoints.
fn known(running: &Running<'_>) -> Result<BTreeSet<String>> {
    let layer = running.layer.as_ref().context("the host has no layer")?;
    let domains = layer.status()?.domains;
    let discovery = domains
        .into_iter()
        .find_map(|domain| domain.discovery)
        .context("rtpsd says nothing of discovery")?;
    let participants = discovery["participants"].as_array().into_iter().flatten();
    let complete = participants.filter(|participant| {
        let endpoints = participant["endpoints"].as_array();
        endpoints.is_some_and(|endpoints| endpoints.len() == 2 * ENDPOINTS)
    });
    Ok(complete
        .filter_map(|participant| participant["prefix"].as_str().map(str::to_owned))
        .collect())
}

/// What was seen of a host while the crowd did nothing but announce itself.
struct SteadyState {
    wakeups_per_minute: f64,
    app_wakeups_per_minute: f64,
    cpu_seconds_per_minute: f64,
    /// The members that were missing at any look.
    missing: usize,
    end: Instant,
}

impl SteadyState {
    fn watch(running: &mut Running<'_>, time: Duration) -> Result<Self> {
        let everybody = known(running)?;
        let mut seen = everybody.clone();
        let begin = Instant::now();
        while begin.elapsed() < time * 2 / 3 {
            waiting::pause(LOOK)?;
            let now = known(running)?;
            seen.retain(|member| now.contains(member));
        }
        // The last answer may still be on its way out.
        waiting::pause(Duration::from_millis(500))?;
        let (before, begin) = (Wakeups::of(running)?, Instant::now());
        waiting::pause(time / 3)?;
        let (wakeups, minutes) = (Wakeups::of(running)?, begin.elapsed().as_secs_f64() / 60.0);
        let now = known(running)?;
        seen.retain(|member| now.contains(member));
        Ok(Self {
            wakeups_per_minute: (wakeups.daemon - before.daemon) as f64 / minutes,
            app_wakeups_per_minute: (wakeups.apps - before.apps) as f64 / minutes / APPS as f64,
            cpu_seconds_per_minute: (wakeups.cpu_seconds - before.cpu_seconds) / minutes,
            missing: everybody.len() - seen.len(),
            end: Instant::now(),
        })
    }

    /// How many members were lost: missing at a look, gone for an app, or gone in the end without having fallen silent.
    fn lost(
        &self,
        running: &Running<'_>,
        members: usize,
        silenced: &BTreeMap<String, Instant>,
    ) -> Result<usize> {
        let gone_for_apps: BTreeSet<_> = ends(running)
            .into_iter()
            .filter(|(member, at)| *at < self.end || !silenced.contains_key(member))
            .map(|(member, _)| member)
            .collect();
        let in_the_end = known(running)?;
        let speaking = in_the_end
            .iter()
            .filter(|member| !silenced.contains_key(*member));
        let gone_in_the_end = members - silenced.len() - speaking.count();
        Ok(self.missing.max(gone_for_apps.len()).max(gone_in_the_end))
    }
}

struct Wakeups {
    daemon: u64,
    apps: u64,
    cpu_seconds: f64,
}

impl Wakeups {
    fn of(running: &mut Running<'_>) -> Result<Self> {
        let daemon = running.daemon().context("the host has no layer")?;
        let mut apps = 0;
        for app in &running.apps {
            apps += usage::sleeps(app.pid())?;
        }
        Ok(Self {
            daemon: usage::sleeps(daemon)?,
            apps,
            cpu_seconds: running.cpu_seconds()?,
        })
    }
}

/// Ends of matches that apps were told, with the member whose endpoint it was.
fn ends(running: &Running<'_>) -> Vec<(String, Instant)> {
    let events = running.apps.iter().flat_map(Process::timed_events);
    let ends = events.filter(|(_, event)| event["event"] == "unmatched");
    ends.filter_map(|(at, event)| Some((event["participant"].as_str()?.to_owned(), at)))
        .collect()
}

/// Lets a part of the crowd fall silent and waits until the apps know. Gives the silent members with the ends of their
/// leases, and the longest time from there until the last app knew.
fn wait_for_ends(
    crowd: &mut Process,
    running: &mut Running<'_>,
) -> Result<(BTreeMap<String, Instant>, Option<f64>)> {
    const MATCHES: usize = APPS * 2 * ENDPOINTS;
    crowd.signal(Signal::SIGUSR1)?;
    let (at, event) = waiting::require(crowd, "silent", START)?;
    let silenced = leases(at, &event)?;
    let deadline = at + LEASE + GRACE;
    loop {
        let mut ended: BTreeMap<String, Vec<Instant>> = BTreeMap::new();
        for (member, end) in ends(running) {
            ended.entry(member).or_default().push(end);
        }
        let last = |member: &String| {
            let ends = ended.get(member).filter(|ends| ends.len() >= MATCHES)?;
            ends.iter().max().copied()
        };
        let late: Option<Vec<f64>> = silenced
            .iter()
            .map(|(member, lease)| {
                Some(
                    last(member)?
                        .saturating_duration_since(*lease)
                        .as_secs_f64(),
                )
            })
            .collect();
        if late.is_some() || Instant::now() > deadline {
            return Ok((
                silenced,
                late.map(|late| late.into_iter().fold(0.0, f64::max)),
            ));
        }
        waiting::pause(Duration::from_millis(500))?;
    }
}

/// The ends of the leases of members that have fallen silent at that time.
fn leases(silent_at: Instant, event: &Value) -> Result<BTreeMap<String, Instant>> {
    let members = event["members"].as_array().into_iter().flatten();
    members
        .map(|member| {
            let prefix = member["prefix"].as_str().context("a member has no name")?;
            let silence = member["silent_for_seconds"].as_f64().unwrap_or_default();
            let last_sign = silent_at - Duration::from_secs_f64(silence);
            Ok((prefix.to_owned(), last_sign + LEASE))
        })
        .collect()
}
