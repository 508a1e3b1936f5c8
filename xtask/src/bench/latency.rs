//! Round trips of a reliable sample, one at a time: between two hosts, and between two programs of one host.

use anyhow::Result;

use super::exchange::{Exchange, Kind};
use super::hosts::Hosts;
use super::options::Options;
use super::plan::Plan;
use super::programs::Programs;
use super::rounds;
use super::row::{Pinning, Row, Stack};

const SAME_HOST: &str = "same-host";
const BETWEEN_HOSTS: Plan = Plan {
    bench: "latency",
    stacks: &[
        Stack::Udp,
        Stack::UdpSpin,
        Stack::Kernel,
        Stack::KernelSpin,
        Stack::InProcess,
        Stack::Cyclone,
        Stack::Fastdds,
        Stack::Rustdds,
    ],
    pinnings: &[Pinning::OneCpu, Pinning::TwoCpus, Pinning::Free],
    sizes: &[100],
    readers: 1,
};
const ON_ONE_HOST: Plan = Plan {
    bench: SAME_HOST,
    pinnings: &[Pinning::OneCpu, Pinning::TwoCpus],
    ..BETWEEN_HOSTS
};

pub(super) fn measure(options: &Options) -> Result<Vec<Row>> {
    let mut cases = BETWEEN_HOSTS.cases(options);
    cases.extend(ON_ONE_HOST.cases(options));
    let programs = Programs::for_cases(&mut cases)?;
    let hosts = Hosts::pair()?;
    let _layers = hosts.load(&programs, &cases)?;
    rounds::measure(&cases, options, |case, run| {
        let sides = hosts.of(case.stack)?;
        let exchange = Exchange {
            programs: &programs,
            kind: Kind::RoundTrips,
            case,
            rate: None,
            sides: match case.bench {
                SAME_HOST => sides.on_one_host(),
                _ => sides,
            },
        };
        exchange.run(run)
    })
}
