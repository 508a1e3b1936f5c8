//! What a run costs the machine: CPU time of everybody, context switches and system calls of the programs, memory.

use std::fs;
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::unistd::Pid;

/// The kernel tells CPU times in these units, whatever its own tick is.
const TICKS_PER_SECOND: f64 = 100.0;

/// CPUs in use when no case is running.
#[derive(Clone, Copy, Debug)]
pub(super) struct Baseline(f64);

impl Baseline {
    /// Looks at the machine for a moment in which nobody measures.
    pub(super) fn measure() -> Result<Self> {
        let before = Usage::of(&[])?;
        thread::sleep(Duration::from_millis(300));
        Ok(Self(before.rates(&Usage::of(&[])?).cpus))
    }
}

/// What has been used so far.
#[derive(Clone, Debug)]
pub(super) struct Usage {
    at: Instant,
    /// CPU seconds of the whole machine.
    cpu: f64,
    /// Context switches of the programs.
    switches: u64,
}

/// What is used in a second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates {
    /// CPU seconds of the whole machine.
    pub(super) cpus: f64,
    /// Context switches of the programs.
    pub(super) switches: f64,
}

impl Usage {
    /// By the machine, and by these programs.
    pub(super) fn of(programs: &[Pid]) -> Result<Self> {
        let stat = fs::read_to_string("/proc/stat")?;
        let switches = programs.iter().map(|program| switches(*program));
        Ok(Self {
            at: Instant::now(),
            cpu: busy_ticks(&stat)? as f64 / TICKS_PER_SECOND,
            switches: switches.sum::<Result<u64>>()?,
        })
    }

    /// From here to a later one.
    pub(super) fn rates(&self, later: &Self) -> Rates {
        let seconds = (later.at - self.at).as_secs_f64();
        Rates {
            cpus: (later.cpu - self.cpu) / seconds,
            switches: later.switches.saturating_sub(self.switches) as f64 / seconds,
        }
    }
}

impl Rates {
    /// CPU nanoseconds and context switches of one of so many samples a second.
    pub(super) fn of_a_sample(&self, baseline: Baseline, samples_per_s: f64) -> (f64, f64) {
        let cpus = (self.cpus - baseline.0).max(0.0);
        (cpus * 1e9 / samples_per_s, self.switches / samples_per_s)
    }
}

/// User, nice, system and both interrupt times of all CPUs.
fn busy_ticks(stat: &str) -> Result<u64> {
    let line = stat
        .lines()
        .next()
        .and_then(|line| line.strip_prefix("cpu "));
    let numbers: Vec<u64> = line
        .context("/proc/stat does not begin with the sum of all CPUs")?
        .split_whitespace()
        .map_while(|number| number.parse().ok())
        .collect();
    ensure!(numbers.len() >= 7, "/proc/stat has another form");
    Ok([0, 1, 2, 5, 6]
        .map(|column: usize| numbers[column])
        .iter()
        .sum())
}

/// How often the threads of a program have given up a CPU, by themselves or not.
fn switches(program: Pid) -> Result<u64> {
    Ok(of_threads(program, "voluntary_ctxt_switches:")?
        + of_threads(program, "nonvoluntary_ctxt_switches:")?)
}

/// How often the threads of a program have gone to sleep.
pub(super) fn sleeps(program: Pid) -> Result<u64> {
    of_threads(program, "voluntary_ctxt_switches:")
}

fn of_threads(program: Pid, name: &str) -> Result<u64> {
    let threads = fs::read_dir(format!("/proc/{program}/task"))
        .with_context(|| format!("process {program} has ended"))?;
    threads
        .map(|thread| {
            // A thread that has just gone counts nothing.
            let status = fs::read_to_string(thread?.path().join("status")).unwrap_or_default();
            Ok(field(&status, name).unwrap_or(0))
        })
        .sum()
}

/// Resident memory of a program in kB.
pub(super) fn resident_kb(program: Pid) -> Result<u64> {
    let status = fs::read_to_string(format!("/proc/{program}/status"))?;
    field(&status, "VmRSS:").context("no such line")
}

fn field(status: &str, name: &str) -> Option<u64> {
    let value = status.lines().find_map(|line| line.strip_prefix(name))?;
    value.split_whitespace().next()?.parse().ok()
}

/// Whether [`syscalls_per_second`] works here.
pub(super) fn counts_syscalls() -> bool {
    static WORKS: LazyLock<bool> = LazyLock::new(|| {
        let count = perf(&["true"]);
        count.is_ok_and(|count| count > 0.0)
    });
    *WORKS
}

/// System calls that these programs make in a second, watched for a while.
///
/// # Errors
/// Without perf, and where the kernel has no tracepoints.
pub(super) fn syscalls_per_second(programs: &[Pid], watched: Duration) -> Result<f64> {
    let programs: Vec<String> = programs.iter().map(Pid::to_string).collect();
    let seconds = watched.as_secs_f64();
    let count = perf(&[
        "-p",
        &programs.join(","),
        "--",
        "sleep",
        &seconds.to_string(),
    ])?;
    Ok(count / seconds)
}

fn perf(whom: &[&str]) -> Result<f64> {
    let output = Command::new("perf")
        .args(["stat", "-x,", "-e", "raw_syscalls:sys_enter"])
        .args(whom)
        .stdin(Stdio::null())
        .output()
        .context("perf cannot be started (Debian: linux-perf)")?;
    let text = String::from_utf8_lossy(&output.stderr);
    count(&text).with_context(|| format!("perf counted nothing: {text}"))
}

/// The first number of perf's `-x,` form. A program that did nothing was not counted.
fn count(text: &str) -> Option<f64> {
    text.lines().find_map(|line| match line.split(',').next()? {
        "<not counted>" => Some(0.0),
        number => number.parse().ok(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn idle_waiting_and_stolen_time_is_not_busy() {
        let stat = "cpu  1 20 300 4000 50000 600000 7000000 80000000 0 0\ncpu0 1 2 3\n";
        assert_eq!(busy_ticks(stat).unwrap(), 7_600_321);
        assert!(busy_ticks("cpu  1 2 3\n").is_err());
    }

    #[test]
    fn fields_of_proc_files() {
        let status =
            "VmRSS:\t  5120 kB\nvoluntary_ctxt_switches:\t7\nnonvoluntary_ctxt_switches:\t9\n";
        assert_eq!(field(status, "VmRSS:"), Some(5120));
        assert_eq!(field(status, "voluntary_ctxt_switches:"), Some(7));
        assert_eq!(field(status, "VmHWM:"), None);
    }

    #[test]
    fn sleeping_shows() {
        let before = Usage::of(&[Pid::this()]).unwrap();
        thread::sleep(Duration::from_millis(5));
        let rates = before.rates(&Usage::of(&[Pid::this()]).unwrap());
        assert!(rates.switches > 0.0);
        assert!(sleeps(Pid::this()).unwrap() > 0 && resident_kb(Pid::this()).unwrap() > 0);
    }

    #[test]
    fn what_is_used_at_rest_is_not_a_samples_fault() {
        let rates = Rates {
            cpus: 1.5,
            switches: 10.0,
        };
        assert_eq!(rates.of_a_sample(Baseline(0.5), 1000.0), (1e6, 0.01));
        assert_eq!(rates.of_a_sample(Baseline(2.0), 1000.0).0, 0.0);
    }

    #[test]
    fn the_form_of_perf() {
        assert_eq!(
            count("29,,raw_syscalls:sys_enter,740844,100.00,,\n"),
            Some(29.0)
        );
        assert_eq!(
            count("<not counted>,,raw_syscalls:sys_enter,0\n"),
            Some(0.0)
        );
        assert_eq!(count("event syntax error\n"), None);
    }
}
