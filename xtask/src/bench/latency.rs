//! Round-trip times of a reliable sample between two hosts: each stack in turn, round after round, so that noise
//! of the machine meets all of them alike; the medians of the rounds are what counts.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Args;
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::Veth;
use rtps_tests::netns::Netns;
use rtps_tests::process::Process;
use serde::Serialize;

use super::round_trips::Summary;
use crate::interrupt;
use rtps_tests::binaries::{self, Binaries};

/// Bytes of a sample's serialized payload.
const SIZE: usize = 100;
/// How often each stack is measured in each pinning.
const ROUNDS: u32 = 5;
/// What discovery and start of both ends may take beside the measurement.
const START: Duration = Duration::from_secs(20);

/// `cargo xtask bench latency`.
#[derive(Args, Debug)]
pub(crate) struct Latency {
    /// Seconds of measurement for each stack and pinning, all rounds together.
    #[arg(long, default_value_t = 5.0)]
    seconds: f64,
    /// Print a JSON array of rows as the last line instead of a table.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Stack {
    Udp,
    Kernel,
    InProcess,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Pinning {
    OneCpu,
    TwoCpus,
}

#[derive(Debug, Serialize)]
struct Row {
    bench: &'static str,
    stack: Stack,
    size: usize,
    pinning: Pinning,
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
}

impl Latency {
    /// Measures and prints.
    pub(crate) fn run(&self) -> Result<()> {
        interrupt::catch()?;
        let hosts = Hosts::new(binaries::build()?)?;
        let _layers = hosts.load()?;
        let rows = self.measure(&hosts)?;
        if self.json {
            println!("{}", serde_json::to_string(&rows)?);
        } else {
            print_table(&rows);
        }
        Ok(())
    }

    fn measure(&self, hosts: &Hosts) -> Result<Vec<Row>> {
        let cases: Vec<_> = [Pinning::OneCpu, Pinning::TwoCpus]
            .into_iter()
            .flat_map(|pinning| {
                [Stack::Udp, Stack::Kernel, Stack::InProcess].map(|stack| (stack, pinning))
            })
            .collect();
        let seconds = self.seconds / f64::from(ROUNDS);
        let mut runs = vec![Vec::new(); cases.len()];
        for round in 1..=ROUNDS {
            for ((stack, pinning), runs) in cases.iter().zip(&mut runs) {
                interrupt::check()?;
                let summary = hosts.round(*stack, *pinning, seconds)?;
                if !self.json {
                    eprintln!(
                        "round {round}: {stack:?} {pinning:?}: p50 {:.1} us",
                        summary.p50_us
                    );
                }
                runs.push(summary);
            }
        }
        cases
            .iter()
            .zip(&runs)
            .map(|(case, runs)| row(*case, runs))
            .collect()
    }
}

fn row((stack, pinning): (Stack, Pinning), runs: &[Summary]) -> Result<Row> {
    let Summary {
        p50_us,
        p99_us,
        max_us,
        ..
    } = Summary::median(runs).context("no round was run")?;
    Ok(Row {
        bench: "latency",
        stack,
        size: SIZE,
        pinning,
        p50_us,
        p99_us,
        max_us,
    })
}

fn print_table(rows: &[Row]) {
    println!(
        "Round trip of a reliable sample of {SIZE} B, veth, blocking; microseconds, medians of {ROUNDS} rounds"
    );
    println!(
        "{:<12} {:<10} {:>9} {:>9} {:>9} {:>9}",
        "stack", "pinning", "p50", "p99", "max", "p50/udp"
    );
    for row in rows {
        let floor = rows
            .iter()
            .find(|floor| floor.stack == Stack::Udp && floor.pinning == row.pinning);
        let ratio = floor.map_or(0.0, |floor| row.p50_us / floor.p50_us);
        let [stack, pinning] = [format!("{:?}", row.stack), format!("{:?}", row.pinning)];
        println!(
            "{stack:<12} {pinning:<10} {:>9.1} {:>9.1} {:>9.1} {ratio:>9.2}",
            row.p50_us, row.p99_us, row.max_us
        );
    }
}

/// Two hosts, each with a kernel layer. The in-process layer uses another domain, so both are there side by side.
#[derive(Debug)]
struct Hosts {
    binaries: Binaries,
    pong: Netns,
    ping: Netns,
    veth: Veth,
}

impl Hosts {
    fn new(binaries: Binaries) -> Result<Self> {
        let (pong, ping) = (Netns::new("pong")?, Netns::new("ping")?);
        let veth = Veth::between(
            &pong,
            &ping,
            Ipv4Addr::new(10, 1, 0, 1),
            Ipv4Addr::new(10, 1, 0, 2),
            1500,
        )?;
        Ok(Self {
            binaries,
            pong,
            ping,
            veth,
        })
    }

    /// The kernel layers, which go when the value does.
    fn load(&self) -> Result<[KernelLayer<'_>; 2]> {
        let rtpsd = self.binaries.rtpsd();
        Ok([
            KernelLayer::start(&rtpsd, &self.pong, &self.veth.a.name, &[])?,
            KernelLayer::start(&rtpsd, &self.ping, &self.veth.b.name, &[])?,
        ])
    }

    fn round(&self, stack: Stack, pinning: Pinning, seconds: f64) -> Result<Summary> {
        let pong_cpu = match pinning {
            Pinning::OneCpu => 0,
            Pinning::TwoCpus => 1,
        };
        let (pong, ping) = match stack {
            Stack::Udp => self.udp_ends(seconds),
            Stack::Kernel => self.sample_ends("kernel", 0, seconds),
            Stack::InProcess => self.sample_ends("in-process", 1, seconds),
        };
        let _pong = pinned(&self.pong, "pong", pong_cpu, &pong)?;
        let mut ping = pinned(&self.ping, "ping", 0, &ping)?;
        ping.wait_success(START + Duration::from_secs_f64(seconds))?;
        let printed = ping
            .events()
            .pop()
            .context("the pinging end printed no result")?;
        serde_json::from_value(printed).context("the pinging end's result has another form")
    }

    fn udp_ends(&self, seconds: f64) -> (Vec<String>, Vec<String>) {
        let program = std::env::current_exe()
            .unwrap_or_default()
            .display()
            .to_string();
        let (pong, ping) = (self.veth.a.v4, self.veth.b.v4);
        let end = |arguments: String| {
            let arguments = format!("bench udp-end --size {SIZE} --seconds {seconds} {arguments}");
            std::iter::once(program.clone())
                .chain(arguments.split_whitespace().map(str::to_owned))
                .collect()
        };
        (
            end(format!("--bind {pong}:9000")),
            end(format!("--bind {ping}:9000 --ping {pong}:9000")),
        )
    }

    fn sample_ends(&self, layer: &str, domain: u32, seconds: f64) -> (Vec<String>, Vec<String>) {
        let program = self.binaries.example("latency").display().to_string();
        let end = |role: &str| {
            let arguments = format!(
                "--role {role} --layer {layer} --domain {domain} --size {SIZE} --seconds {seconds} --reliable"
            );
            std::iter::once(program.clone())
                .chain(arguments.split_whitespace().map(str::to_owned))
                .collect()
        };
        (end("pong"), end("ping"))
    }
}

/// Starts a program on one CPU of the machine.
fn pinned(netns: &Netns, label: &str, cpu: u32, program: &[String]) -> Result<Process> {
    Process::spawn(
        label,
        netns
            .command("taskset")
            .arg("-c")
            .arg(cpu.to_string())
            .args(program),
    )
}
