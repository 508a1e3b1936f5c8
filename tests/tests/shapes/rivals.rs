//! OWNERSHIP EXCLUSIVE with a writer of ours and one of another vendor: readers of either see the stronger alone, until it goes.

use anyhow::{Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtps_tests::stage::eventually;
use rtps_tests::{require, skip_unless};

use crate::lines;
use crate::ownership::wait_more;
use crate::stage::{Ends, Stage};

/// Sizes of shapes, by which our reader tells the writers apart.
const OURS: u32 = 20;
const THEIRS: u32 = 30;
/// Bytes of the additional payload, by which theirs does.
const OURS_IS_LARGER: u64 = 4;

#[test]
fn cyclone_0_10() -> Result<()> {
    compete(Layer::Kernel, peers::cyclone)
}

#[test]
fn cyclone_11() -> Result<()> {
    compete(Layer::InProcess, peers::cyclone11)
}

#[test]
fn fast_dds() -> Result<()> {
    compete(Layer::Kernel, peers::fast_dds)
}

fn compete(layer: Layer, peer: fn() -> Result<Peer>) -> Result<()> {
    skip_unless!(require::root());
    let (stage, peer) = (Stage::new("rivals")?, peer()?);
    let ends = &stage.with_near(layer)?;
    let contest = Contest { ends, peer };
    for goes in ["--unregister --linger 60", "--linger 0"] {
        contest.theirs_is_stronger(goes)?;
    }
    contest.theirs_stands_still()?;
    for goes in ["-s 4 --final-instance-state u", "-s 4"] {
        contest.ours_is_stronger(goes)?;
    }
    Ok(())
}

/// The vendor's programs are on the other host.
struct Contest<'a> {
    ends: &'a Ends<'a>,
    peer: Peer,
}

impl Contest<'_> {
    fn theirs(&self, arguments: &str) -> Result<Process> {
        let arguments = format!("{arguments} --period-us 20000 --timeout 60");
        self.ends.peer(&self.peer, &arguments)
    }

    fn theirs_is_stronger(&self, goes: &str) -> Result<()> {
        let subscriber = self.ends.near_subscriber("-s 0 -k 0")?;
        let _weak = self.ends.publisher("-s 3")?;
        wait_more(&subscriber, OURS, 5)?;
        let _strong = self.theirs(&format!("--pub --strength 4 --count 30 {goes}"))?;
        wait_more(&subscriber, THEIRS, 30)?;
        wait_more(&subscriber, OURS, 5)?;
        let mut sizes = lines::sizes(&subscriber);
        sizes.dedup();
        ensure!(sizes == [OURS, THEIRS, OURS], "{}", subscriber.text());
        Ok(())
    }

    /// It misses its deadline, and comes back.
    fn theirs_stands_still(&self) -> Result<()> {
        let subscriber = self.ends.near_subscriber("-s 0 -k 0 -f 1000")?;
        let _weak = self.ends.publisher("-s 3 -f 1000")?;
        let strong = self.theirs("--pub --strength 4 --deadline-ms 1000")?;
        wait_more(&subscriber, THEIRS, 10)?;
        strong.signal(Signal::SIGSTOP)?;
        wait_more(&subscriber, OURS, 5)?;
        strong.signal(Signal::SIGCONT)?;
        wait_more(&subscriber, THEIRS, 5)
    }

    fn ours_is_stronger(&self, goes: &str) -> Result<()> {
        let reader = self.theirs("--sub --strength 0")?;
        let count = |is_ours: bool| {
            let sizes = sizes(&reader).into_iter();
            sizes
                .filter(|size| (*size == OURS_IS_LARGER) == is_ours)
                .count()
        };
        let wait_more = |is_ours| {
            let wanted = count(is_ours) + 5;
            eventually("samples of one of them", || {
                Ok((count(is_ours) >= wanted).then_some(()))
            })
        };
        let _weak = self.theirs("--pub --strength 3")?;
        wait_more(false)?;
        let payload = format!("--additional-payload-size {OURS_IS_LARGER}");
        let strong = self.ends.publisher(&format!("{goes} {payload}"))?;
        wait_more(true)?;
        lines::interrupt(strong)?;
        wait_more(false)?;
        let mut sizes = sizes(&reader);
        sizes.dedup();
        ensure!(sizes == [0, OURS_IS_LARGER, 0], "{}", reader.text());
        Ok(())
    }
}

/// The sizes of the samples that a peer has told of.
fn sizes(peer: &Process) -> Vec<u64> {
    let events = peer.events().into_iter();
    let samples = events.filter(|event| event["event"] == "sample");
    samples
        .filter_map(|sample| sample["size"].as_u64())
        .collect()
}
