//! Samples that need many packets: from one writer to one reader on another host, reliable, also while packets get lost.

use anyhow::Result;
use rtps_tests::link::Host;
use rtps_tests::loss::{Direction, Loss, Lossy};

use super::exchange::{Exchange, Kind};
use super::hosts::Hosts;
use super::options::Options;
use super::plan::Plan;
use super::programs::Programs;
use super::rounds;
use super::row::{Case, Pinning, Row, Stack};

const WITHOUT_LOSS: Plan = Plan {
    bench: "large",
    stacks: &[
        Stack::Kernel,
        Stack::InProcess,
        Stack::Cyclone,
        Stack::Fastdds,
        Stack::Rustdds,
    ],
    pinnings: &[Pinning::Free],
    sizes: &[64 << 10, 1 << 20, 4 << 20, 16 << 20],
    readers: 1,
};
const LOSSY: &str = "large-loss";
const WITH_LOSS: Plan = Plan {
    bench: LOSSY,
    sizes: &[4 << 20],
    ..WITHOUT_LOSS
};
/// Of the packets that the writer's host sends.
const LOSS: Loss = Loss::Random(0.02);

pub(super) fn measure(options: &Options) -> Result<Vec<Row>> {
    let mut cases = WITHOUT_LOSS.cases(options);
    cases.extend(WITH_LOSS.cases(options));
    let programs = Programs::for_cases(&mut cases)?;
    let hosts = Hosts::pair()?;
    let _layers = hosts.load(&programs, &cases)?;
    rounds::measure(&cases, options, |case, run| {
        let sides = hosts.of(case.stack)?;
        let _loss = loss(case, sides.active)?;
        let exchange = Exchange {
            programs: &programs,
            kind: Kind::Stream,
            case,
            rate: None,
            sides,
        };
        exchange.run(run)
    })
}

fn loss(case: &Case, writer: &Host) -> Result<Option<Lossy>> {
    let Host { netns, interface } = writer;
    let lossy = case.bench == LOSSY;
    let loss = lossy.then(|| Lossy::attach(netns, interface, Direction::Egress, LOSS));
    loss.transpose()
}
