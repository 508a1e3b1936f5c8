//! What a sample costs where the rate is given and nobody is out of breath, and what an app costs that does nothing.

use anyhow::Result;

use super::exchange::measure_streams;
use super::hosts::Hosts;
use super::idle;
use super::options::Options;
use super::plan::Plan;
use super::programs::Programs;
use super::row::{Pinning, Row, Stack};

/// Samples a second.
const RATE: u32 = 10_000;
const PLAN: Plan = Plan {
    bench: "cpu",
    stacks: &[
        Stack::Udp,
        Stack::Kernel,
        Stack::InProcess,
        Stack::Cyclone,
        Stack::Fastdds,
        Stack::Rustdds,
    ],
    pinnings: &[Pinning::Free],
    sizes: &[100],
    readers: 1,
};

pub(super) fn measure(options: &Options) -> Result<Vec<Row>> {
    let mut cases = PLAN.cases(options);
    let programs = Programs::for_cases(&mut cases)?;
    let hosts = Hosts::pair()?;
    let _layers = hosts.load(&programs, &cases)?;
    let mut rows = measure_streams(options, &cases, &programs, &hosts, Some(RATE))?;
    rows.extend(idle::measure(options, &programs, &hosts, &cases)?);
    Ok(rows)
}
