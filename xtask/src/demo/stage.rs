//! Who plays in the demo, and where: processes of ours and of Cyclone DDS, in namespaces or on loopback.

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result};
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::Veth;
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use serde_json::{Map, Value};

use super::RATE;
use super::summary::{Flow, Summary, with_sums};
use rtps_tests::binaries;

/// Two hosts joined by veth.
pub(crate) struct Hosts {
    peer: Peer,
    rtpsd: PathBuf,
    ours: Netns,
    theirs: Netns,
    veth: Veth,
}

impl Hosts {
    /// Installs Cyclone DDS where it is missing, then makes the hosts.
    pub(crate) fn new() -> Result<Self> {
        let peer = peers::cyclone()?;
        let rtpsd = binaries::build()?.rtpsd();
        let (ours, theirs) = (Netns::new("apps")?, Netns::new("cyclone")?);
        let veth = Veth::between(
            &ours,
            &theirs,
            Ipv4Addr::new(10, 1, 0, 1),
            Ipv4Addr::new(10, 1, 0, 2),
            1500,
        )?;
        Ok(Self {
            peer,
            rtpsd,
            ours,
            theirs,
            veth,
        })
    }
}

/// All processes of a running demo.
pub(crate) struct Stage<'a> {
    layer: Option<KernelLayer<'a>>,
    receiver: Process,
    both: Process,
    squares: Process,
    circles: Process,
    others: &'static str,
}

impl<'a> Stage<'a> {
    /// The apps run as nobody, through the kernel layer; Cyclone DDS is on the other host.
    pub(crate) fn on_kernel_layer(hosts: &'a Hosts, samples: u64, slack: Duration) -> Result<Self> {
        let layer = KernelLayer::start(
            &hosts.rtpsd,
            &hosts.ours,
            &hosts.veth.a.name,
            // What is to be seen at work here, and what a network card has.
            &["--mode", "native"],
        )?;
        let program = std::env::current_exe()?;
        let app = |label: &str, circles: u64| {
            let mut command = hosts.ours.command_as(Identity::NOBODY, &program)?;
            command
                .args(app_arguments(samples, circles, slack, 0))
                .env("RTPS_LAYER", "kernel");
            Process::spawn(label, &mut command)
        };
        let cyclone = |label: &str, arguments: &str| {
            Process::spawn(
                label,
                &mut hosts.peer.command(&hosts.theirs, &hosts.veth.b, arguments),
            )
        };
        let (squares, circles) = peer_arguments(samples, slack, 0);
        Ok(Self {
            layer: Some(layer),
            circles: cyclone("Cyclone DDS, reading circles", &circles)?,
            receiver: app("app 1", 0)?,
            both: app("app 2", samples)?,
            squares: cyclone("Cyclone DDS, writing squares", &squares)?,
            others: "Cyclone DDS",
        })
    }

    /// Everybody is on the loopback interface of this host.
    pub(crate) fn in_process(samples: u64, slack: Duration) -> Result<Self> {
        let (program, extra, others) = other_program()?;
        let app = |label: &str, circles: u64| {
            let mut command = Command::new(std::env::current_exe()?);
            command
                .args(app_arguments(samples, circles, slack, LOOPBACK_DOMAIN))
                .env("RTPS_LAYER", "in-process");
            Process::spawn(label, command.env("RTPS_INTERFACES", "lo"))
        };
        let other = |label: &str, arguments: &str| {
            let mut command = Command::new(&program);
            command.args(arguments.split_whitespace()).args(extra);
            Process::spawn(label, command.env("RTPS_INTERFACES", "lo"))
        };
        let (squares, circles) = peer_arguments(samples, slack, LOOPBACK_DOMAIN);
        Ok(Self {
            layer: None,
            circles: other("reader of circles", &circles)?,
            receiver: app("app 1", 0)?,
            both: app("app 2", samples)?,
            squares: other("writer of squares", &squares)?,
            others,
        })
    }

    /// Whether every process has ended.
    pub(crate) fn is_over(&mut self) -> bool {
        [
            &mut self.receiver,
            &mut self.both,
            &mut self.squares,
            &mut self.circles,
        ]
        .into_iter()
        .all(|process| process.wait_exit(Duration::ZERO).is_ok())
    }

    /// How far everything is.
    pub(crate) fn summary(&self, samples: u64) -> Result<Summary> {
        let (xdp_mode, kernel) = match &self.layer {
            Some(layer) => kernel_status(layer)?,
            None => (None, Map::new()),
        };
        let topics = vec![
            Flow::new(
                "Square",
                self.others,
                "app 1",
                samples,
                reported(&self.receiver),
            ),
            Flow::new(
                "Square",
                self.others,
                "app 2",
                samples,
                reported(&self.both),
            ),
            Flow::new(
                "Circle",
                "app 2",
                self.others,
                samples,
                samples_of_peer(&self.circles),
            ),
        ];
        let layer = if self.layer.is_some() {
            "kernel"
        } else {
            "in-process"
        };
        Ok(Summary {
            layer: layer.into(),
            xdp_mode,
            topics,
            kernel,
        })
    }
}

/// Apart from other DDS programs of the host.
const LOOPBACK_DOMAIN: u32 = 77;

fn app_arguments(squares: u64, circles: u64, slack: Duration, domain: u32) -> Vec<String> {
    let timeout = squares / RATE + slack.as_secs();
    let period = 1_000_000 / RATE;
    format!(
        "demo-app --squares {squares} --circles {circles} --period-us {period} --domain {domain} \
         --timeout-seconds {timeout}"
    )
    .split_whitespace()
    .map(str::to_owned)
    .collect()
}

/// Arguments of the writer of squares and of the reader of circles.
fn peer_arguments(samples: u64, slack: Duration, domain: u32) -> (String, String) {
    let timeout = samples / RATE + slack.as_secs();
    let common = format!(
        "--domain {domain} --count {samples} --timeout {timeout} --reliable --durability transient-local --linger 0.5"
    );
    let period = 1_000_000 / RATE;
    (
        format!("--pub --topic Square --color BLUE --period-us {period} --wait-match 2 {common}"),
        format!("--sub --topic Circle {common}"),
    )
}

/// Cyclone DDS where it is there; else the shapes example, which takes the same arguments but one.
fn other_program() -> Result<(PathBuf, &'static [&'static str], &'static str)> {
    match peers::cyclone() {
        Ok(peer) => Ok((
            peer.program().to_owned(),
            &["--interface", "lo"],
            "Cyclone DDS",
        )),
        Err(error) => {
            println!("Cyclone DDS cannot be had ({error:#}); an app of ours takes its part");
            Ok((binaries::build()?.example("shapes"), &[], "shapes"))
        }
    }
}

/// What an app of the demo last said it received.
fn reported(app: &Process) -> u64 {
    let events = app.events();
    events
        .iter()
        .rev()
        .find_map(|event| event["received"].as_u64())
        .unwrap_or(0)
}

fn samples_of_peer(peer: &Process) -> u64 {
    peer.events()
        .iter()
        .filter(|event| event["event"] == "sample")
        .count() as u64
}

/// The mode that XDP works in, and the counters of all interfaces added up.
fn kernel_status(layer: &KernelLayer<'_>) -> Result<(Option<String>, Map<String, Value>)> {
    let status = layer.status()?;
    let mode = status
        .interfaces
        .first()
        .context("XDP is attached nowhere")?
        .mode
        .name();
    let mut sums = Map::new();
    for (name, value) in status.counters.values().flatten() {
        let sum = sums.get(name).and_then(Value::as_u64).unwrap_or(0) + value;
        sums.insert(name.clone(), sum.into());
    }
    Ok((Some(mode.to_owned()), with_sums(sums)))
}
