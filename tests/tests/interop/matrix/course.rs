//! How the scenarios go with one peer, whichever end it is.

use anyhow::Result;
use rtps_tests::loss::Loss;
use rtps_tests::peers::Peer;
use rtps_tests::process::Process;

use super::Direction;
use crate::flow::{self, Arguments, EVERYTHING};
use crate::stage::{Host, Stage};
use crate::{best_effort, durability, instances, loss, matching};

/// One end is the peer's, the other ours.
pub(super) struct Ends<'a> {
    stage: &'a Stage,
    host: &'a Host<'a>,
    peer: &'a Peer,
    direction: Direction,
}

impl<'a> Ends<'a> {
    pub(super) fn new(
        stage: &'a Stage,
        host: &'a Host<'a>,
        peer: &'a Peer,
        direction: Direction,
    ) -> Self {
        Self {
            stage,
            host,
            peer,
            direction,
        }
    }

    /// It stays a moment when everything is acknowledged: RustDDS forgets what it has acknowledged and not handed out
    /// when the writer goes.
    fn publisher(&self, arguments: &str) -> Result<Process> {
        let arguments = &format!("--linger 0.3 {arguments}");
        match self.direction {
            Direction::FromPeer => self.stage.peer(self.peer, arguments),
            Direction::ToPeer => self.host.app(arguments),
        }
    }

    fn subscriber(&self, arguments: &str) -> Result<Process> {
        match self.direction {
            Direction::FromPeer => self.host.app(arguments),
            Direction::ToPeer => self.stage.peer(self.peer, arguments),
        }
    }
}

pub(super) fn best_effort(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber(&best_effort::subscriber())?;
    best_effort::ensure_order(ends.publisher(best_effort::PUBLISHER)?, subscriber)
}

pub(super) fn loss(ends: &Ends<'_>) -> Result<()> {
    const SAMPLES: u64 = 200;
    let lossy = ends.stage.lose(Loss::Random(0.1))?;
    let arguments = loss::arguments(SAMPLES, 0);
    let subscriber = ends.subscriber(&arguments.subscriber)?;
    let publisher = ends.publisher(&arguments.publisher)?;
    flow::complete(publisher, [subscriber], SAMPLES, 0)?;
    loss::ensure_lost(&lossy)
}

/// `end` is the option of the publisher, `event` what the subscriber says then.
pub(super) fn instances_end(ends: &Ends<'_>, end: &str, event: &str) -> Result<()> {
    let subscriber = ends.subscriber(&instances::subscriber())?;
    let publisher = ends.publisher(&instances::publisher(end))?;
    instances::ensure_ends(publisher, subscriber, event)
}

pub(super) fn late_joiner(ends: &Ends<'_>) -> Result<()> {
    let _publisher = ends.publisher(&durability::publisher("--history-keep-all"))?;
    // When the first reader has the last sample, all are written.
    let mut first = ends.subscriber(&durability::subscriber(0))?;
    flow::wait_sample(&mut first, durability::SAMPLES - 1)?;
    let late = ends.subscriber(&durability::subscriber(durability::SAMPLES))?;
    durability::ensure_kept(late, durability::SAMPLES)
}

pub(super) fn large(ends: &Ends<'_>, samples: u64, size: u64) -> Result<()> {
    let arguments = Arguments::reliable(samples, 1, &format!("--size {size}"));
    let subscriber = ends.subscriber(&arguments.subscriber)?;
    let publisher = ends.publisher(&arguments.publisher)?;
    flow::complete(publisher, [subscriber], samples, size)
}

pub(super) fn incompatible_qos(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber(matching::REQUEST)?;
    matching::ensure_told([ends.publisher(matching::OFFER)?, subscriber])
}

/// A reader in another partition is there before the one that gets everything, and gets nothing.
pub(super) fn partitions(ends: &Ends<'_>) -> Result<()> {
    const SAMPLES: u64 = 50;
    let both = format!("{EVERYTHING} --count {SAMPLES}");
    let subscriber = |partition| {
        let arguments = format!("--sub {both} --partition {partition} --linger 0.5");
        ends.subscriber(&arguments)
    };
    let elsewhere = subscriber("elsewhere")?;
    let here = subscriber("here")?;
    let publisher = ends.publisher(&format!("--pub {both} --partition here"))?;
    flow::complete(publisher, [here], SAMPLES, 0)?;
    matching::ensure_alone(&elsewhere)
}
