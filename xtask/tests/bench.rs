//! `cargo xtask bench` in short: every case has its row, with the figures that it promises. What they are is nobody's
//! business here.

use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::process::Process;
use rtps_tests::{require, skip_unless};
use serde_json::Value;

/// The programs that are measured are built first, where they are missing.
const END: Duration = Duration::from_secs(600);
const STACKS: [&str; 2] = ["kernel", "udp"];
/// What each row of both benchmarks has.
const ALWAYS: [&str; 3] = ["cpu_ns_per_sample", "switches_per_sample", "rss_kb"];

#[test]
fn latency_has_round_trips_in_order() -> Result<()> {
    skip_unless!(require::root());
    let rows = rows("latency --pinning one-cpu")?;
    ensure_cases(&rows, &["latency", "same-host"], 100, "one-cpu")?;
    for row in &rows {
        let names = ["p50_us", "p90_us", "p99_us", "p999_us", "max_us"];
        let times = names.map(|name| figure(row, name));
        ensure!(times[0] > Some(0.0) && times.is_sorted(), "{row}");
    }
    Ok(())
}

#[test]
fn throughput_has_a_rate() -> Result<()> {
    skip_unless!(require::root());
    let rows = rows("throughput --size 1024")?;
    ensure_cases(&rows, &["throughput"], 1024, "free")?;
    for row in &rows {
        ensure!(figure(row, "samples_per_s") > Some(0.0), "{row}");
    }
    Ok(())
}

/// One short round.
fn rows(arguments: &str) -> Result<Vec<Value>> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.arg("bench").args(arguments.split_whitespace());
    command.args(["--json", "--quick"]);
    command.args(STACKS.iter().flat_map(|stack| ["--stack", stack]));
    let mut bench = Process::spawn("bench", &mut command)?;
    bench.wait_success(END)?;
    let text = bench.text();
    let last = text.lines().rfind(|line| line.starts_with('['));
    serde_json::from_str(last.context("no rows")?).with_context(|| text)
}

/// Each stack in each benchmark; reliable samples, of which none was lost.
fn ensure_cases(rows: &[Value], benches: &[&str], size: u64, pinning: &str) -> Result<()> {
    ensure!(rows.len() == benches.len() * STACKS.len(), "{rows:?}");
    for (bench, stack) in benches
        .iter()
        .flat_map(|bench| STACKS.map(|stack| (bench, stack)))
    {
        let mut cases = rows.iter();
        let row = cases.find(|row| row["bench"] == **bench && row["stack"] == stack);
        let row = row.with_context(|| format!("{bench} of {stack} is missing in {rows:?}"))?;
        let is_case = row["size"] == size && row["pinning"] == pinning && row["readers"] == 1;
        ensure!(is_case && (row["lost"] == 0 || stack == "udp"), "{row}");
        let missing = ALWAYS.iter().find(|name| figure(row, name).is_none());
        ensure!(missing.is_none(), "{missing:?} is missing in {row}");
    }
    Ok(())
}

fn figure(row: &Value, name: &str) -> Option<f64> {
    row[name].as_f64()
}
