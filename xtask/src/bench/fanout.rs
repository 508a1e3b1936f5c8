//! Samples a second from one writer to a reader on each of 8 other hosts behind a bridge, reliable, by unicast.

use anyhow::Result;

use super::exchange::measure_streams;
use super::hosts::Hosts;
use super::options::Options;
use super::plan::Plan;
use super::programs::Programs;
use super::row::{Pinning, Row, Stack};

const READERS: u8 = 8;
const PLAN: Plan = Plan {
    bench: "fanout",
    stacks: &[
        Stack::Udp,
        Stack::Kernel,
        Stack::InProcess,
        Stack::Cyclone,
        Stack::Fastdds,
        Stack::Rustdds,
    ],
    pinnings: &[Pinning::Free],
    sizes: &[1024],
    readers: READERS as usize,
};

pub(super) fn measure(options: &Options) -> Result<Vec<Row>> {
    let mut cases = PLAN.cases(options);
    let programs = Programs::for_cases(&mut cases)?;
    let hosts = Hosts::bridged(READERS + 1)?;
    let _layers = hosts.load(&programs, &cases)?;
    measure_streams(options, &cases, &programs, &hosts, None)
}
