//! One end of a round-trip measurement: `--role ping` sends a sample and waits for it to come back from
//! `--role pong`, as often as it can for `--seconds`, and prints one JSON object with the percentiles.

use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use rtps_socket::{LayerChoice, LayerKind, Qos, RawReader, RawWriter, RtpsSocket};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const MATCH_TIMEOUT: Duration = Duration::from_secs(20);
const WARM_UP: Duration = Duration::from_millis(300);
/// How long a sample may take before it counts as lost.
const LOST_AFTER: Duration = Duration::from_millis(500);
/// The encapsulation header of little-endian CDR.
const HEADER: [u8; 4] = [0, 1, 0, 0];

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Ping,
    Pong,
}

#[derive(Clone, Copy, ValueEnum)]
enum Layer {
    Kernel,
    InProcess,
}

#[derive(Parser)]
struct Options {
    #[arg(long)]
    role: Role,
    #[arg(long, default_value_t = 0)]
    domain: u32,
    /// The layer to use; the best one there is unless given.
    #[arg(long)]
    layer: Option<Layer>,
    /// Bytes of a sample.
    #[arg(long, default_value_t = 100)]
    size: usize,
    /// How long to measure.
    #[arg(long, default_value_t = 3.0)]
    seconds: f64,
    /// The CPU to stay on.
    #[arg(long)]
    cpu: Option<usize>,
    #[arg(long)]
    reliable: bool,
}

fn main() -> Result<()> {
    let options = Options::parse();
    if let Some(cpu) = options.cpu {
        pin(cpu)?;
    }
    let layer = match options.layer {
        None => LayerChoice::Automatic,
        Some(Layer::Kernel) => LayerChoice::Kernel,
        Some(Layer::InProcess) => LayerChoice::InProcess,
    };
    let socket = RtpsSocket::builder()
        .domain(options.domain)
        .layer(layer)
        .open()?;
    let (sent, received) = match options.role {
        Role::Ping => ("LatencyPing", "LatencyPong"),
        Role::Pong => ("LatencyPong", "LatencyPing"),
    };
    let qos = match options.reliable {
        true => Qos::reliable(),
        false => Qos::best_effort(),
    };
    let writer = socket.create_writer(sent, "Latency", qos.clone(), false)?;
    let reader = socket.create_reader(received, "Latency", qos, None)?;
    writer.wait_for_matched(1, MATCH_TIMEOUT)?;
    reader.wait_for_matched(1, MATCH_TIMEOUT)?;
    match options.role {
        Role::Pong => pong(&writer, &reader),
        Role::Ping => {
            let report = ping(&options, &writer, &reader)?;
            let stack = match socket.layer() {
                LayerKind::Kernel => "kernel",
                LayerKind::InProcess => "in-process",
            };
            println!("{}", report.to_json(stack, options.size));
            Ok(())
        }
    }
}

/// Threads started later inherit it.
fn pin(cpu: usize) -> Result<()> {
    let mut set = nix::sched::CpuSet::new();
    set.set(cpu)?;
    nix::sched::sched_setaffinity(nix::unistd::Pid::from_raw(0), &set)?;
    Ok(())
}

/// Sends everything back until the other end is gone.
fn pong(writer: &RawWriter, reader: &RawReader) -> Result<()> {
    loop {
        match reader.recv(Duration::from_millis(500)) {
            Some(sample) if sample.info.valid_data => drop(writer.send(sample.payload)?),
            Some(_) => {}
            None if reader.matched().is_empty() => return Ok(()),
            None => {}
        }
    }
}

/// Round-trip times, ascending.
struct Report {
    times: Vec<Duration>,
    lost: u64,
}

fn ping(options: &Options, writer: &RawWriter, reader: &RawReader) -> Result<Report> {
    let mut payload = HEADER.to_vec();
    payload.resize(HEADER.len() + options.size, 0);
    let payload = rtps_socket::Bytes::from(payload);
    // The other end may match later and miss what comes before.
    while reader.recv(Duration::from_millis(50)).is_none() {
        writer.send(payload.clone())?;
    }
    while reader.recv(Duration::from_millis(50)).is_some() {}
    let warm = Instant::now() + WARM_UP;
    let end = warm + Duration::from_secs_f64(options.seconds);
    let mut report = Report {
        times: Vec::with_capacity(1 << 20),
        lost: 0,
    };
    loop {
        let start = Instant::now();
        writer.send(payload.clone())?;
        let came_back = reader.recv(LOST_AFTER).is_some();
        let now = Instant::now();
        match came_back {
            true if start >= warm => report.times.push(now - start),
            true => {}
            false => report.lost += 1,
        }
        if now >= end {
            report.times.sort_unstable();
            return Ok(report);
        }
    }
}

impl Report {
    fn to_json(&self, stack: &str, size: usize) -> serde_json::Value {
        serde_json::json!({
            "bench": "latency",
            "stack": stack,
            "size": size,
            "count": self.times.len(),
            "lost": self.lost,
            "p50_us": self.percentile(0.5),
            "p99_us": self.percentile(0.99),
            "max_us": self.percentile(1.0),
        })
    }

    fn percentile(&self, part: f64) -> f64 {
        let last = self.times.len().saturating_sub(1);
        let time = self.times.get((last as f64 * part).round() as usize);
        time.map_or(f64::NAN, |time| time.as_nanos() as f64 / 1000.0)
    }
}
