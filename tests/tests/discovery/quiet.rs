//! What is not news wakes nobody, yet an app that waits for signs of life gets them.

use std::thread;
use std::time::Duration;

use anyhow::{Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage};
use rtps_tests::{require, skip_unless};

use crate::support::{LONG_LEASE, known_crowd, wakeups_during};

/// Fifty announcements and as many assertions of liveliness a second.
const PERIOD: Duration = Duration::from_millis(20);
const WATCHED: Duration = Duration::from_secs(8);

#[test]
fn what_is_known_wakes_nobody() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("quiet")?;
    let layer = stage.load(&stage.ours)?;
    let mut crowd = known_crowd(&stage, 1, (PERIOD, LONG_LEASE))?;
    crowd.be_lively();
    crowd.run(Duration::from_secs(1))?;
    let count = wakeups_during(&layer, || crowd.run(WATCHED))?;
    ensure!(
        count <= WATCHED.as_secs(),
        "{count} wake-ups within {WATCHED:?}"
    );
    Ok(())
}

/// Cyclone asserts the liveliness of its writer several times in each lease.
const LIVELINESS: Duration = Duration::from_secs(1);

#[test]
fn an_app_notices_life_and_silence_of_a_writer() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("liveliness")?;
    let _layer = stage.load(&stage.ours)?;
    let common = format!(
        "--reliable --durability transient-local --liveliness-ms {} --timeout 100",
        LIVELINESS.as_millis()
    );
    let mut reader = stage.app(&stage.ours, Layer::Kernel, &format!("--sub {common}"))?;
    let writer = stage.cyclone(&format!("--pub {common} --count 1 --linger 100"))?;
    wait_alive(&mut reader, 1)?;
    thread::sleep(4 * LIVELINESS);
    ensure!(changes(&reader) == [1], "{:?}", changes(&reader));
    for round in 0..2 {
        writer.signal(Signal::SIGSTOP)?;
        wait_alive(&mut reader, 0)?;
        writer.signal(Signal::SIGCONT)?;
        // The first life is over when the participant's lease is not: it goes on where it was.
        wait_alive(&mut reader, 1)?;
        ensure!(
            changes(&reader).len() == 3 + 2 * round,
            "{:?}",
            changes(&reader)
        );
    }
    Ok(())
}

fn wait_alive(reader: &mut Process, count: u64) -> Result<()> {
    let wanted =
        |event: &serde_json::Value| event["event"] == "liveliness" && event["alive"] == count;
    reader.wait_json_event(wanted, PATIENCE).map(drop)
}

/// How many writers were alive, each time that this changed.
fn changes(reader: &Process) -> Vec<u64> {
    let events = reader.events();
    let changes = events.iter().filter(|event| event["event"] == "liveliness");
    changes
        .filter_map(|event| event["alive"].as_u64())
        .collect()
}
