//! An app that has nothing to do sleeps.

use std::fs;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage, spawn_app};
use rtps_tests::{require, skip_unless};

const WATCHED: Duration = Duration::from_secs(5);
/// Two wake-ups a second.
const WAKEUPS: u64 = 10;

#[test]
fn on_the_kernel_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("idle")?;
    let _layer = stage.load(&stage.ours)?;
    stays_asleep(&stage, Layer::Kernel)
}

#[test]
fn on_the_in_process_layer() -> Result<()> {
    skip_unless!(require::root());
    stays_asleep(&Stage::new("idle-in-process")?, Layer::InProcess)
}

/// A reader that has got a sample, and whose writer has gone; on the other host somebody else is idle, too.
fn stays_asleep(stage: &Stage, layer: Layer) -> Result<()> {
    let _other = spawn_app(
        &stage.theirs.netns,
        Layer::InProcess,
        "hello_subscriber",
        "",
    )?;
    let mut app = spawn_app(&stage.ours.netns, layer, "hello_subscriber", "")?;
    spawn_app(&stage.theirs.netns, Layer::InProcess, "hello_publisher", "")?.wait_exit(PATIENCE)?;
    // Discovery is busy in the beginning, and announces itself more and more rarely.
    thread::sleep(2 * WATCHED);
    let before = wakeups(&app)?;
    thread::sleep(WATCHED);
    let count = wakeups(&app)? - before;
    ensure!(count <= WAKEUPS, "{count} wake-ups within {WATCHED:?}");
    ensure!(app.wait_exit(Duration::ZERO).is_err(), "it has ended");
    Ok(())
}

/// How often the threads of a process have slept.
fn wakeups(app: &Process) -> Result<u64> {
    let threads = fs::read_dir(format!("/proc/{}/task", app.pid()))?;
    threads
        .map(|thread| voluntary_switches(&thread?.path().join("status")))
        .sum()
}

fn voluntary_switches(status: &std::path::Path) -> Result<u64> {
    let text = fs::read_to_string(status)?;
    let mut lines = text.lines();
    let number = lines.find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    Ok(number.context("no such line")?.trim().parse()?)
}
