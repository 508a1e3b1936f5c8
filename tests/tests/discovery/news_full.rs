//! More news than the kernel can keep for rtpsd: what it could not keep it has not acknowledged.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::stage::{Stage, counter, eventually};
use rtps_tests::{require, skip_unless};

use crate::support::{LONG_LEASE, known_crowd, participants, while_stopped};

/// Together more than the ring for news holds: each takes 2,056 bytes of 4 MiB.
const CROWD: u32 = 10;
const ENDPOINTS: usize = 250;
/// Long enough to repeat everything several times.
const ASKING: Duration = Duration::from_secs(3);

#[test]
fn what_rtpsd_was_not_given_comes_again() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("news-full")?;
    let mut layer = stage.load_with(&stage.ours, "--lease 60")?;
    let mut crowd = known_crowd(&stage, CROWD, (Duration::from_secs(1), LONG_LEASE))?;
    let all = i64::from(CROWD) * i64::try_from(ENDPOINTS)?;
    while_stopped(&mut layer, || {
        crowd.add_endpoints(ENDPOINTS)?;
        crowd.run(ASKING)?;
        let acknowledged: i64 = crowd
            .remotes
            .iter()
            .map(|remote| remote.acknowledged())
            .sum();
        ensure!(acknowledged > 0, "nothing is acknowledged");
        ensure!(acknowledged < all, "there was room for everything");
        Ok(())
    })?;
    crowd.run_until_content()?;
    ensure!(counter(&layer.status()?, "lost_news_full") > 0);
    let wanted = Some(ENDPOINTS);
    eventually("all endpoints are known", || {
        let known = participants(&layer)?;
        let counts = crowd.remotes.iter().map(|remote| {
            let prefix = remote.prefix.to_string();
            let participant = known.iter().find(|one| one["prefix"] == prefix);
            Some(participant?["endpoints"].as_array()?.len())
        });
        let counts: Vec<_> = counts.collect();
        Ok(counts.iter().all(|count| *count == wanted).then_some(()))
    })
    .context("what was acknowledged has not been discovered")
}
