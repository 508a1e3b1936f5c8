//! Best-effort readers: what arrives is in order and none comes twice. The [`matrix`](crate::matrix) has this with every
//! vendor.

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers;
use rtps_tests::process::Process;

use crate::flow;
use crate::layers::on_both_layers;
use crate::stage::Stage;

/// The publisher goes on until the subscriber has this many: which of them are first depends on the match.
const WANTED: u64 = 100;
pub(crate) const PUBLISHER: &str = "--pub --best-effort --period-us 1000 --timeout 50";

on_both_layers! { reliable_writer_to_best_effort_reader }

pub(crate) fn subscriber() -> String {
    format!("--sub --best-effort --count {WANTED} --timeout 50")
}

fn reliable_writer_to_best_effort_reader(layer: Layer) -> Result<()> {
    let publisher = "--pub --reliable --period-us 1000 --timeout 50";
    let stage = Stage::new("best-effort")?;
    let host = stage.near(layer)?;
    let app = host.app(&subscriber())?;
    ensure_order(stage.peer(&peers::cyclone()?, publisher)?, app)
}

pub(crate) fn ensure_order(publisher: Process, mut subscriber: Process) -> Result<()> {
    subscriber
        .wait_success(flow::END)
        .with_context(|| format!("the publisher's output:\n{}", publisher.text()))?;
    let numbers = flow::numbers(&subscriber);
    ensure!(numbers.len() as u64 >= WANTED, "{numbers:?}");
    ensure!(numbers.is_sorted_by(|one, next| one < next), "{numbers:?}");
    Ok(())
}
