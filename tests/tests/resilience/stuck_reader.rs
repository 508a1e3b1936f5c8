//! A reader that is read no more: its app does not take, or its process stands still (SIGSTOP). Its writer and the
//! other readers lose nothing, KEEP_ALL holds the writer up and KEEP_LAST does not, and nobody's memory grows.

use anyhow::{Context, Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::link::Host;
use rtps_tests::process::{Process, resident};
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::{require, skip_unless};
use serde_json::Value;

const SAMPLES: u64 = 1500;
/// All of them are more than [`GROWTH`].
const SIZE: u64 = 16_000;
/// What a program that keeps [`KEPT`] samples may grow by, its inbox included.
const GROWTH: u64 = 12 << 20;
/// What a reader that does not run for a while on a busy machine can still be sent again.
const KEPT: u64 = 100;

#[test]
fn on_the_kernel_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("stuck")?;
    let _layers = [stage.load(&stage.ours)?, stage.load(&stage.theirs)?];
    on(&stage, [&stage.theirs, &stage.ours], Layer::Kernel)
}

#[test]
fn on_the_in_process_layer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("stuck-in-process")?;
    on(&stage, [&stage.theirs, &stage.ours], Layer::InProcess)
}

#[test]
fn on_one_host() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("stuck-same-host")?;
    let _layer = stage.load(&stage.ours)?;
    on(&stage, [&stage.ours, &stage.ours], Layer::Kernel)
}

/// Each way to be stuck with each HISTORY, all at once; the writer is on the first host, both readers on the second.
fn on(stage: &Stage, hosts: [&Host; 2], layer: Layer) -> Result<()> {
    let start = |way, history| Scene::start(stage, hosts, layer, (way, history));
    let start_all = |history| -> Result<Vec<Scene>> {
        let ways = Way::ALL.into_iter();
        ways.map(|way| start(way, history)).collect()
    };
    let mut last = start_all(History::KeepLast)?;
    let mut all = start_all(History::KeepAll)?;
    for scene in last.iter_mut().chain(&mut all) {
        scene.stick()?;
    }
    for scene in last {
        let way = scene.way;
        let checked = scene.ensure_unhindered();
        checked.with_context(|| format!("KEEP_LAST, {way:?}"))?;
    }
    for scene in all {
        let way = scene.way;
        let checked = scene.ensure_held_up();
        checked.with_context(|| format!("KEEP_ALL, {way:?}"))?;
    }
    Ok(())
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    TakesNothing,
    IsStopped,
}

impl Way {
    const ALL: [Self; 2] = [Self::TakesNothing, Self::IsStopped];
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum History {
    KeepLast,
    /// With RESOURCE_LIMITS.
    KeepAll,
}

/// A writer, the reader that gets stuck, and one that does not.
struct Scene {
    way: Way,
    writer: Process,
    stuck: Process,
    other: Process,
    /// Resident memory of the writer and of the stuck reader before that.
    before: [u64; 2],
}

impl Scene {
    fn start(
        stage: &Stage,
        [from, to]: [&Host; 2],
        layer: Layer,
        (way, history): (Way, History),
    ) -> Result<Self> {
        let common = format!("--topic {way:?}{history:?} --reliable --size {SIZE} --timeout 120");
        let kept = match history {
            History::KeepLast => format!("--keep-last {KEPT}"),
            History::KeepAll => format!("--max-samples {KEPT}"),
        };
        let stuck = stage.app(to, layer, &format!("--sub {common} {kept}"))?;
        let other = stage.app(to, layer, &format!("--sub {common} --count {SAMPLES}"))?;
        let writer = stage.app(
            from,
            layer,
            &format!(
                "--pub {common} {kept} --count {SAMPLES} --period-us 1000 --wait-match 2 --max-blocking 0.3 --linger 1"
            ),
        )?;
        Ok(Self {
            way,
            writer,
            stuck,
            other,
            before: [0; 2],
        })
    }

    fn stick(&mut self) -> Result<()> {
        let started = |event: &Value| event["x"].as_u64() >= Some(50);
        for reader in [&mut self.stuck, &mut self.other] {
            reader
                .wait_json_event(started, PATIENCE)
                .with_context(|| format!("the writer's output:\n{}", self.writer.last_text()))?;
        }
        self.before = self.memory()?;
        self.stuck.signal(match self.way {
            Way::TakesNothing => Signal::SIGUSR1,
            Way::IsStopped => Signal::SIGSTOP,
        })
    }

    fn go_on(&self) -> Result<()> {
        self.stuck.signal(match self.way {
            Way::TakesNothing => Signal::SIGUSR1,
            Way::IsStopped => Signal::SIGCONT,
        })
    }

    /// The stuck reader has the newest samples in the end, and has not held up anybody.
    fn ensure_unhindered(mut self) -> Result<()> {
        let is_last = |event: &Value| event["x"].as_u64() == Some(SAMPLES - 1);
        self.other.wait_json_event(is_last, PATIENCE)?;
        self.ensure_little_memory()?;
        self.other.wait_success(PATIENCE)?;
        ensure_all(&self.other)?;
        self.go_on()?;
        self.stuck.wait_json_event(is_last, PATIENCE)?;
        self.writer.wait_success(PATIENCE)?;
        let timeouts = numbers(&self.writer, "timeout");
        ensure!(timeouts.is_empty(), "it waited to write {timeouts:?}");
        let got = numbers(&self.stuck, "sample");
        ensure!(got.is_sorted_by(|a, b| a < b), "{got:?}");
        let newest: Vec<u64> = (SAMPLES - KEPT..SAMPLES).collect();
        ensure!(got.ends_with(&newest), "{:?}", got.last_chunk::<200>());
        Ok(())
    }

    /// The writer waits for the stuck reader, and in the end all have all.
    fn ensure_held_up(mut self) -> Result<()> {
        let waits = |event: &Value| event["event"] == "timeout";
        let waits = self.writer.wait_json_event(waits, PATIENCE)?;
        let written = waits["x"].as_u64().context("no number")?;
        let stuck_with = numbers(&self.stuck, "sample").len() as u64;
        // Both histories are full, and neither held more than it may.
        ensure!(
            written <= stuck_with + 2 * KEPT,
            "{written} of {stuck_with}"
        );
        eventually("the other reader has all that is written", || {
            let got = numbers(&self.other, "sample");
            Ok((got.last() == Some(&(written - 1))).then_some(()))
        })?;
        self.ensure_little_memory()?;
        self.go_on()?;
        self.other.wait_success(PATIENCE)?;
        ensure_all(&self.other)?;
        let is_last = |event: &Value| event["x"].as_u64() == Some(SAMPLES - 1);
        self.stuck.wait_json_event(is_last, PATIENCE)?;
        ensure_all(&self.stuck)?;
        self.writer.wait_success(PATIENCE)
    }

    fn memory(&self) -> Result<[u64; 2]> {
        Ok([resident(self.writer.pid())?, resident(self.stuck.pid())?])
    }

    fn ensure_little_memory(&self) -> Result<()> {
        let now = self.memory()?;
        let grown = [0, 1].map(|end| now[end].saturating_sub(self.before[end]));
        ensure!(
            grown.iter().all(|growth| *growth < GROWTH),
            "writer and reader have grown by {grown:?}"
        );
        Ok(())
    }
}

fn ensure_all(reader: &Process) -> Result<()> {
    let got = numbers(reader, "sample");
    let wrong = got.iter().zip(0..).position(|(got, due)| *got != due);
    ensure!(
        wrong.is_none() && got.len() as u64 == SAMPLES,
        "{} samples, wrong from {wrong:?}",
        got.len()
    );
    Ok(())
}

/// The numbers of the samples that a program has told of.
fn numbers(program: &Process, what: &str) -> Vec<u64> {
    let events = program.events();
    let events = events.iter().filter(|event| event["event"] == what);
    events.filter_map(|event| event["x"].as_u64()).collect()
}
