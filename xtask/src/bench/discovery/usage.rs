//! What processes and kernel programs have used of the machine.
//!
//! CPU time of a process is what the scheduler accounts to its threads, in nanoseconds. Work of the kernel for arriving
//! packets is done in whichever process runs, between two namespaces mostly the sender; of it, the time of the layer's
//! BPF programs is known exactly while the kernel takes statistics, and is added to our side.

use std::fs;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Result};
use nix::unistd::Pid;

/// CPU seconds of all threads that a process has now.
pub(super) fn cpu_seconds(pid: Pid) -> Result<f64> {
    let mut nanoseconds = 0;
    for thread in threads(pid)? {
        let text = read_of_thread(&thread.join("schedstat"));
        nanoseconds += text.split(' ').next().map_or(0, parse_or_zero);
    }
    Ok(nanoseconds as f64 * 1e-9)
}

/// How often threads of a process have gone to sleep, which is how often they were woken.
pub(super) fn sleeps(pid: Pid) -> Result<u64> {
    let mut sleeps = 0;
    for thread in threads(pid)? {
        let text = read_of_thread(&thread.join("status"));
        sleeps += field(&text, "voluntary_ctxt_switches:");
    }
    Ok(sleeps)
}

/// CPU seconds of the BPF programs that a process holds, since [`ProgramStatistics`] are taken.
pub(super) fn program_seconds(pid: Pid) -> Result<f64> {
    let mut programs: Vec<(u64, u64)> = Vec::new();
    for entry in fs::read_dir(format!("/proc/{pid}/fdinfo"))? {
        let text = read_of_thread(&entry?.path());
        if text.contains("run_time_ns:") {
            programs.push((field(&text, "prog_id:"), field(&text, "run_time_ns:")));
        }
    }
    // Several descriptors may lead to one program.
    programs.sort_unstable();
    programs.dedup_by_key(|(id, _)| *id);
    let nanoseconds: u64 = programs.iter().map(|(_, nanoseconds)| nanoseconds).sum();
    Ok(nanoseconds as f64 * 1e-9)
}

fn threads(pid: Pid) -> Result<Vec<PathBuf>> {
    fs::read_dir(format!("/proc/{pid}/task"))
        .with_context(|| format!("process {pid} has ended"))?
        .map(|entry| Ok(entry?.path()))
        .collect()
}

/// A thread or descriptor that has just gone counts nothing.
fn read_of_thread(path: &PathBuf) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

fn field(text: &str, name: &str) -> u64 {
    text.lines()
        .find_map(|line| line.strip_prefix(name))
        .map_or(0, |value| parse_or_zero(value.trim()))
}

fn parse_or_zero(text: &str) -> u64 {
    u64::from_str(text).unwrap_or(0)
}

/// While the value lives the kernel measures the run time of BPF programs (kernel.bpf_stats_enabled), which costs them
/// some 20 ns a run.
pub(super) struct ProgramStatistics {
    before: String,
}

impl ProgramStatistics {
    const PATH: &str = "/proc/sys/kernel/bpf_stats_enabled";

    /// From now on.
    pub(super) fn take() -> Result<Self> {
        let before =
            fs::read_to_string(Self::PATH).context("BPF statistics need a kernel with BPF")?;
        fs::write(Self::PATH, "1").context("BPF statistics need root")?;
        Ok(Self { before })
    }
}

impl Drop for ProgramStatistics {
    fn drop(&mut self) {
        if let Err(error) = fs::write(Self::PATH, &self.before) {
            eprintln!("{} was not restored: {error}", Self::PATH);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_proc_files() {
        let text = "prog_id:\t12\nrun_time_ns:\t345\nnonvoluntary_ctxt_switches:\t9\n";
        assert_eq!(field(text, "run_time_ns:"), 345);
        assert_eq!(field(text, "voluntary_ctxt_switches:"), 0);
    }

    #[test]
    fn work_shows() {
        let this = Pid::this();
        let before = cpu_seconds(this).unwrap();
        let mut sum = 0_u64;
        while cpu_seconds(this).unwrap() <= before {
            sum = sum.wrapping_add(1);
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
        assert!(sleeps(this).unwrap() > 0);
    }
}
