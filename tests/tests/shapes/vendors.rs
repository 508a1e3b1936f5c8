//! `shape_main` and another vendor's program, whichever of them writes: samples, how instances end, and who matches whom.
//!
//! Each test plays all scenarios with one vendor on one layer: most take as long as it takes to start two programs.

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, eventually};
use rtps_tests::{require, skip_unless};
use serde_json::Value;

use crate::busy::Busy;
use crate::lines::{self, wait_line};
use crate::stage::{Ends, Stage, on_both_layers};

on_both_layers! {
    cyclone(with_near),
    fast_dds(with_near),
    rust_dds(with_near),
    // An IPv6 locator makes it end with a panic.
    dust_dds(with_near_over_ipv4),
}

/// What is late is complete all the same.
#[test]
fn cyclone_while_all_cpus_are_busy() -> Result<()> {
    skip_unless!(require::root());
    let (stage, peer) = (Stage::new("shapes-busy")?, peers::cyclone()?);
    let ends = &stage.with_near(Layer::Kernel)?;
    let _busy = Busy::start()?;
    let meeting = Meeting { ends, peer };
    meeting.instances_to_peer(1, DISPOSED)?;
    meeting.instances_from_peer(1, DISPOSED)?;
    meeting.best_effort()
}

fn cyclone(ends: &Ends<'_>) -> Result<()> {
    let peer = peers::cyclone()?;
    let meeting = Meeting { ends, peer };
    meeting.play()?;
    meeting.misfits_to_peer()?;
    // Its keys in XCDR2 are not those of the standard.
    for end in [DISPOSED, UNREGISTERED] {
        meeting.instances_to_peer(2, end)?;
        meeting.instances_from_peer(2, end)?;
    }
    Ok(())
}

/// It knows XCDR1 only.
fn fast_dds(ends: &Ends<'_>) -> Result<()> {
    let peer = peers::fast_dds()?;
    let meeting = Meeting { ends, peer };
    meeting.play()?;
    meeting.misfits_to_peer()
}

/// It knows XCDR1 only, and neither unregistering nor PARTITION.
fn rust_dds(ends: &Ends<'_>) -> Result<()> {
    let peer = peers::rust_dds()?;
    let meeting = Meeting { ends, peer };
    meeting.instances_to_peer(1, DISPOSED)?;
    meeting.instances_from_peer(1, DISPOSED)?;
    meeting.best_effort()?;
    meeting.misfits_to_peer()?;
    // A reader that is EXCLUSIVE, but has no strength, as readers do, says nothing to it.
    meeting.misfits_from_peer(&[])
}

fn dust_dds(ends: &Ends<'_>) -> Result<()> {
    let peer = peers::dust_dds()?;
    let meeting = Meeting { ends, peer };
    meeting.play()?;
    meeting.misfits_to_peer()?;
    for end in [DISPOSED, UNREGISTERED] {
        meeting.instances_to_peer(2, end)?;
        meeting.instances_from_peer(2, end)?;
    }
    Ok(())
}

/// The vendor's program is on the other host.
struct Meeting<'a> {
    ends: &'a Ends<'a>,
    peer: Peer,
}

/// How instances end, in the words of both programs.
#[derive(Clone, Copy)]
struct End {
    option: &'static str,
    line: &'static str,
    peer_option: &'static str,
    event: &'static str,
}

const DISPOSED: End = End {
    option: "d",
    line: "NOT_ALIVE_DISPOSED_INSTANCE_STATE",
    peer_option: "--dispose --linger 60",
    event: "disposed",
};
const UNREGISTERED: End = End {
    option: "u",
    line: "NOT_ALIVE_NO_WRITERS_INSTANCE_STATE",
    peer_option: "--unregister --linger 60",
    event: "unregistered",
};

/// Policies that do not fit: our option, theirs, and the policy in our words and theirs.
type Misfit = (&'static str, &'static str, &'static str, &'static str);

const OWNERSHIP: Misfit = ("-s 1", "--reliable", "6 (OWNERSHIP)", "OWNERSHIP");

const COLORS: [&str; 2] = ["BLUE", "BLUE1"];

impl Meeting<'_> {
    fn peer(&self, arguments: &str) -> Result<Process> {
        self.ends.peer(&self.peer, arguments)
    }

    fn play(&self) -> Result<()> {
        for end in [DISPOSED, UNREGISTERED] {
            self.instances_to_peer(1, end)?;
            self.instances_from_peer(1, end)?;
        }
        self.best_effort()?;
        self.partitions()?;
        self.misfits_from_peer(&[OWNERSHIP])
    }

    /// Their late reader gets every sample of ours, and sees the instances end.
    fn instances_to_peer(&self, xcdr: u8, end: End) -> Result<()> {
        let publisher = self.ends.publisher(&format!(
            "-x {xcdr} -D l -k 0 --num-instances 2 --final-instance-state {}",
            end.option
        ))?;
        let before = lines::wait_samples(&publisher, 10)?.len();
        let reader = self.peer(&format!(
            "--sub --xcdr {xcdr} --durability transient-local --timeout 60"
        ))?;
        let (events, of_both) = (|| reader.events(), 2 * COLORS.len());
        eventually("samples from before and after", || {
            let samples = events().iter().filter(|event| is_sample(event)).count();
            Ok((samples >= before + of_both).then_some(()))
        })?;
        let publisher = lines::interrupt(publisher)?;
        for color in COLORS {
            let is_end = |event: &Value| event["event"] == end.event && event["color"] == color;
            eventually("the end of an instance", || {
                Ok(events().iter().any(is_end).then_some(()))
            })?;
            let received = events();
            let received = received
                .iter()
                .filter(|event| is_sample(event) && event["color"] == color)
                .filter_map(|event| event["x"].as_i64());
            let written = places(&publisher, color);
            let is_same = received.eq(written.iter().copied().map(i64::from));
            ensure!(is_same, "{}\n{}", publisher.text(), reader.text());
        }
        Ok(())
    }

    /// Our reader gets every sample of theirs, and sees the instances end.
    fn instances_from_peer(&self, xcdr: u8, end: End) -> Result<()> {
        let subscriber = self.ends.near_subscriber(&format!("-x {xcdr} -D l -k 0"))?;
        let _publisher = self.peer(&format!(
            "--pub --xcdr {xcdr} --durability transient-local --count 20 --instances 2 {}",
            end.peer_option
        ))?;
        for (first, color) in (0..).zip(COLORS) {
            let line = format!("{:<10} {color:<10} {}", "Square", end.line);
            let written: Vec<i32> = (first..20).step_by(COLORS.len()).collect();
            // Where all is there at the first look, the end follows each sample.
            lines::wait_until(&subscriber, &line, |_| {
                lines::has_line(&subscriber, &line)
                    && places(&subscriber, color).len() >= written.len()
            })?;
            let received = places(&subscriber, color);
            ensure!(received == written, "{}", subscriber.text());
        }
        let samples = lines::samples(&subscriber);
        ensure!(
            samples.iter().all(|sample| sample.size == 30),
            "{samples:?}"
        );
        Ok(())
    }

    fn best_effort(&self) -> Result<()> {
        let _publisher = self.ends.publisher("-b -t Circle")?;
        let _theirs = self.peer("--pub --best-effort --period-us 20000")?;
        let mut theirs = self.peer("--sub --best-effort --topic Circle --count 10")?;
        lines::wait_samples(&self.ends.near_subscriber("-b")?, 10)?;
        theirs.wait_success(PATIENCE)
    }

    /// A wildcard of ours, a name of theirs.
    fn partitions(&self) -> Result<()> {
        let _other = self.ends.publisher("-p other -c RED")?;
        let _wild = self.ends.publisher("-p room* -c BLUE")?;
        let mut theirs = self.peer("--sub --partition room42 --count 10")?;
        theirs.wait_success(PATIENCE)?;
        let events = theirs.events();
        let mut samples = events.iter().filter(|event| is_sample(event));
        ensure!(
            samples.all(|sample| sample["color"] == "BLUE"),
            "{events:?}"
        );
        let _theirs = self.peer("--pub --partition room42 --period-us 20000 --topic Circle")?;
        let other = self.ends.near_subscriber("-t Circle -p other")?;
        let wild = self.ends.near_subscriber("-t Circle -p room4?")?;
        lines::wait_samples(&wild, 10)?;
        let other = lines::interrupt(other)?;
        ensure!(!lines::has_line(&other, "on_"), "{}", other.text());
        Ok(())
    }

    fn misfits_to_peer(&self) -> Result<()> {
        let misfits: [Misfit; 4] = [
            ("-b", "--reliable", "11 (RELIABILITY)", "RELIABILITY"),
            (
                "-D v",
                "--durability transient-local",
                "2 (DURABILITY)",
                "DURABILITY",
            ),
            ("-f 600", "--deadline-ms 500", "4 (DEADLINE)", "DEADLINE"),
            OWNERSHIP,
        ];
        ensure_misfits(
            &misfits,
            "on_offered_incompatible_qos()",
            |topic, options| self.ends.publisher(&format!("-t {topic} {options}")),
            |topic, options| self.peer(&format!("--sub --topic {topic} {options}")),
        )
    }

    fn misfits_from_peer(&self, more: &[Misfit]) -> Result<()> {
        let misfits: [Misfit; 3] = [
            ("-r", "--best-effort", "11 (RELIABILITY)", "RELIABILITY"),
            (
                "-D l",
                "--durability volatile",
                "2 (DURABILITY)",
                "DURABILITY",
            ),
            ("-f 500", "--deadline-ms 600", "4 (DEADLINE)", "DEADLINE"),
        ];
        ensure_misfits(
            &[&misfits, more].concat(),
            "on_requested_incompatible_qos()",
            |topic, options| self.ends.near_subscriber(&format!("-t {topic} {options}")),
            |topic, options| self.peer(&format!("--pub --topic {topic} {options}")),
        )
    }
}

/// Both sides name the policy; all pairs at once, each with a topic of its own.
fn ensure_misfits(
    misfits: &[Misfit],
    callback: &str,
    ours: impl Fn(&str, &str) -> Result<Process>,
    theirs: impl Fn(&str, &str) -> Result<Process>,
) -> Result<()> {
    let start = |(option, peer_option, _, name): &Misfit| {
        Ok((ours(name, option)?, theirs(name, peer_option)?))
    };
    let pairs: Vec<_> = misfits.iter().map(start).collect::<Result<_>>()?;
    for ((mut ours, mut theirs), (_, _, policy, name)) in pairs.into_iter().zip(misfits) {
        let line = wait_line(&mut ours, callback)?;
        ensure!(line.ends_with(policy), "{line} should name {policy}");
        let is_told = |event: &Value| event["event"] == "incompatible_qos";
        let told = theirs.wait_json_event(is_told, PATIENCE)?;
        ensure!(told["policy"] == *name, "{told} should name {name}");
    }
    Ok(())
}

fn is_sample(event: &Value) -> bool {
    event["event"] == "sample"
}

/// Where our program has printed an instance, from left to right, one sample after the other.
fn places(app: &Process, color: &str) -> Vec<i32> {
    let samples = lines::samples(app).into_iter();
    samples
        .filter(|sample| sample.color == color)
        .map(|sample| sample.x)
        .collect()
}
