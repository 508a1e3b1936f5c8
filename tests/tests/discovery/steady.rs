//! A crowd that only says that it is still there costs rtpsd nothing, and who falls silent is forgotten in time.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use rtps_tests::stage::Stage;
use rtps_tests::{require, skip_unless};

use crate::support::{count_known, known_crowd, wakeups_during};

const CROWD: u32 = 120;
const PERIOD: Duration = Duration::from_secs(1);
const LEASE: Duration = Duration::from_secs(6);
const WATCHED: Duration = Duration::from_secs(15);
/// An ended lease is noticed so much later at the most.
const NOTICED: Duration = Duration::from_secs(1);
/// What a busy machine may add to that.
const SLACK: Duration = Duration::from_millis(700);

#[test]
fn a_crowd_is_kept_without_rtpsd_and_forgotten_by_it() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("steady")?;
    let layer = stage.load(&stage.ours)?;
    let mut crowd = known_crowd(&stage, CROWD, (PERIOD, LEASE))?;
    crowd.be_lively();
    let all = crowd.prefixes();
    // What discovery still had to say is said.
    crowd.run(2 * PERIOD)?;
    let count = wakeups_during(&layer, || crowd.run(WATCHED))?;
    ensure!(
        count <= WATCHED.as_secs(),
        "{count} wake-ups within {WATCHED:?}"
    );
    ensure!(count_known(&layer, &all)? == all.len(), "somebody is lost");

    let (alive, silent) = all.split_at(all.len() / 2);
    let silence = Instant::now();
    crowd.truncate(alive.len());
    // Each has announced itself within the last period.
    crowd.run(LEASE - 2 * PERIOD)?;
    ensure!(
        count_known(&layer, silent)? == silent.len(),
        "forgotten too soon"
    );
    let forgotten = silence + LEASE + NOTICED + SLACK;
    crowd.run(forgotten.saturating_duration_since(Instant::now()))?;
    ensure!(count_known(&layer, silent)? == 0, "not forgotten");
    ensure!(
        count_known(&layer, alive)? == alive.len(),
        "forgotten with the others"
    );
    Ok(())
}
