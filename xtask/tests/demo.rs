//! `cargo xtask demo` as a user sees it: every sample arrives through the kernel layer, and nothing is left, not even
//! after a SIGKILL.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::process::Process;
use rtps_tests::stage::eventually;
use rtps_tests::{require, skip_unless};
use rtpsd::{PinFolder, RunFolder};
use serde_json::Value;

const SAMPLES: u64 = 300;
/// Programs have to be built perhaps, and Cyclone DDS to be installed.
const READY: Duration = Duration::from_secs(300);
const END: Duration = Duration::from_secs(60);

fn demo() -> Result<Process> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    Process::spawn("demo", command.args(["demo", "--seconds", "3", "--json"]))
}

#[test]
fn all_samples_arrive_and_nothing_is_left() -> Result<()> {
    skip_unless!(require::root());
    let mut killed = demo()?;
    let traces = Traces::of_running(&mut killed)?;
    killed.signal(Signal::SIGKILL)?;
    killed.wait_exit(END)?;
    eventually("all is gone after a SIGKILL", || {
        Ok(traces.are_gone()?.then_some(()))
    })?;

    let mut demo = demo()?;
    let traces = Traces::of_running(&mut demo)?;
    demo.wait_success(END)?;
    ensure!(traces.are_gone()?, "left: {traces:?}");
    let text = demo.text();
    let last = text.lines().last().context("no output")?;
    ensure_complete(&serde_json::from_str(last).with_context(|| text.clone())?)
}

fn ensure_complete(summary: &Value) -> Result<()> {
    ensure!(summary["layer"] == "kernel", "{summary}");
    ensure!(summary["xdp_mode"] == "native", "{summary}");
    let topics = summary["topics"].as_array().context("no topics")?;
    let named = |name: &str| topics.iter().filter(|flow| flow["topic"] == name).count();
    ensure!(named("Square") == 2 && named("Circle") == 1, "{summary}");
    for flow in topics {
        let is_complete =
            flow["sent"] == SAMPLES && flow["received"] == SAMPLES && flow["lost"] == 0;
        ensure!(is_complete, "{flow}");
    }
    let delivered = summary["kernel"]["delivered"].as_u64();
    ensure!(delivered > Some(0), "{summary}");
    Ok(())
}

/// Where to look for what a demo has started.
#[derive(Debug)]
struct Traces {
    /// Its child processes, each with the time of its start.
    processes: BTreeSet<(u32, u64)>,
    /// Inodes of their network namespaces; with the last process and pin goes what was attached there.
    namespaces: BTreeSet<u64>,
}

impl Traces {
    /// Waits until samples flow.
    fn of_running(demo: &mut Process) -> Result<Self> {
        demo.wait_line("Circle -> ", READY)?;
        let children: BTreeSet<_> = processes()?
            .into_iter()
            .filter(|process| process.parent == demo.pid().as_raw().cast_unsigned())
            .collect();
        let ours = fs::metadata("/proc/self/ns/net")?.ino();
        let traces = Self {
            processes: children
                .iter()
                .map(|child| (child.id, child.start))
                .collect(),
            namespaces: children
                .iter()
                .filter_map(|child| namespace(child.id))
                .filter(|inode| *inode != ours)
                .collect(),
        };
        // rtpsd, two apps, two programs of Cyclone DDS; what is looked for later is there now.
        let is_pinned = traces.namespaces.iter().any(|inode| is_pinned(*inode));
        ensure!(
            traces.processes.len() == 5 && traces.namespaces.len() == 2 && is_pinned,
            "{traces:?}"
        );
        Ok(traces)
    }

    fn are_gone(&self) -> Result<bool> {
        let running = processes()?;
        let runs = |(id, start)| {
            running
                .iter()
                .any(|process| (process.id, process.start) == (id, start))
        };
        let is_in_use = |inode| {
            let mut inside = running.iter().filter_map(|process| namespace(process.id));
            inside.any(|of_process| of_process == inode)
        };
        let run_folders = self
            .namespaces
            .iter()
            .map(|inode| RunFolder::of_namespace(*inode));
        Ok(!self.processes.iter().copied().any(runs)
            && !self
                .namespaces
                .iter()
                .any(|inode| is_pinned(*inode) || is_in_use(*inode))
            && !run_folders
                .into_iter()
                .any(|folder| folder.layer_socket().exists()))
    }
}

fn is_pinned(namespace: u64) -> bool {
    PinFolder::of_namespace(namespace).path().exists()
}

/// `None` when the process has ended.
fn namespace(process: u32) -> Option<u64> {
    let link = fs::metadata(format!("/proc/{process}/ns/net"));
    link.ok().map(|link| link.ino())
}

#[derive(Debug, Eq, Ord, PartialEq, PartialOrd)]
struct Running {
    id: u32,
    parent: u32,
    start: u64,
}

/// All processes of the machine.
fn processes() -> Result<Vec<Running>> {
    let entries = fs::read_dir("/proc")?.filter_map(Result::ok);
    let ids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    Ok(ids.filter_map(running).collect())
}

/// From proc(5), `/proc/PID/stat`: the fourth field is the parent, the 22nd the start.
fn running(id: u32) -> Option<Running> {
    let text = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The name before may hold anything.
    let (_, fields) = text.rsplit_once(") ")?;
    let fields: Vec<&str> = fields.split(' ').collect();
    Some(Running {
        id,
        parent: fields.get(1)?.parse().ok()?,
        start: fields.get(19)?.parse().ok()?,
    })
}
