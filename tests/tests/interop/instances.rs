//! Keyed instances and their ends, seen on the other side. The [`matrix`](crate::matrix) has this with every vendor.

use std::collections::BTreeSet;

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;

use crate::flow::{self, EVERYTHING};
use crate::layers::on_both_layers;
use crate::stage::Stage;

const SAMPLES: u64 = 30;
const COLORS: [&str; 3] = ["BLUE", "BLUE1", "BLUE2"];

on_both_layers! { app_disposes_for_app }

fn app_disposes_for_app(layer: Layer) -> Result<()> {
    let stage = Stage::new("instances")?;
    let (near, far) = (stage.near(layer)?, stage.far(layer)?);
    let subscriber = near.app(&subscriber())?;
    let publisher = far.app(&publisher("dispose"))?;
    ensure_ends(publisher, subscriber, "disposed")
}

/// Runs on when the samples are there: the ends come after them.
pub(crate) fn subscriber() -> String {
    format!("--sub {EVERYTHING}")
}

/// Stays after the ends: a writer that goes takes its instances with it.
pub(crate) fn publisher(end: &str) -> String {
    format!(
        "--pub {EVERYTHING} --count {SAMPLES} --instances {} --period-us 500 --{end} --linger 50",
        COLORS.len()
    )
}

pub(crate) fn ensure_ends(publisher: Process, mut subscriber: Process, event: &str) -> Result<()> {
    let mut missing = BTreeSet::from(COLORS);
    while !missing.is_empty() {
        let end = subscriber.wait_json_event(|seen| seen["event"] == event, flow::END)?;
        let color = end["color"].as_str().unwrap_or_default();
        ensure!(missing.remove(color), "{end}; {}", subscriber.text());
    }
    let mut numbers = flow::numbers(&subscriber);
    // A reader may hand out one instance after the other.
    for instance in 0..COLORS.len() as u64 {
        let of_instance = |number: &&u64| **number % COLORS.len() as u64 == instance;
        ensure!(
            numbers.iter().filter(of_instance).is_sorted(),
            "{numbers:?}"
        );
    }
    numbers.sort_unstable();
    ensure!(numbers == Vec::from_iter(0..SAMPLES), "{numbers:?}");
    let others = ["disposed", "unregistered"];
    let wrong = subscriber.events().into_iter().find(|seen| {
        let name = seen["event"].as_str().unwrap_or_default();
        name != event && others.contains(&name)
    });
    ensure!(wrong.is_none(), "{wrong:?}");
    drop(publisher);
    Ok(())
}
