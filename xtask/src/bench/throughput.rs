//! Samples a second from one writer that writes as fast as it can to one reader on another host, reliable and KEEP_ALL.

use anyhow::Result;

use super::exchange::measure_streams;
use super::hosts::Hosts;
use super::options::Options;
use super::plan::Plan;
use super::programs::Programs;
use super::row::{Pinning, Row, Stack};

const PLAN: Plan = Plan {
    bench: "throughput",
    stacks: &[
        Stack::Udp,
        Stack::Kernel,
        Stack::KernelSpin,
        Stack::InProcess,
        Stack::Cyclone,
        Stack::Fastdds,
        Stack::Rustdds,
    ],
    pinnings: &[Pinning::Free],
    sizes: &[100, 1024, 8192],
    readers: 1,
};

pub(super) fn measure(options: &Options) -> Result<Vec<Row>> {
    let mut cases = PLAN.cases(options);
    let programs = Programs::for_cases(&mut cases)?;
    let hosts = Hosts::pair()?;
    let _layers = hosts.load(&programs, &cases)?;
    measure_streams(options, &cases, &programs, &hosts, None)
}
