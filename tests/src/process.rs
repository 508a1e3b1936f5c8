//! A child process that ends with its value, and the lines it prints.
//!
//! Standard output and error are read by two threads from the start, so that a child never blocks
//! on a full pipe. A line of standard output that is a JSON object is an event.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::sys;

/// How often a child's exit is looked for.
const EXIT_POLL: Duration = Duration::from_millis(5);

/// A running child. Dropping it kills it (SIGKILL) and waits for it; it is also killed when the
/// thread that spawned it ends in any way.
pub struct Process {
    label: String,
    child: Child,
    output: Arc<Output>,
    readers: Vec<JoinHandle<()>>,
    next_line: usize,
}

impl Process {
    /// Starts the command; `label` appears in error messages.
    pub fn spawn(label: &str, command: &mut Command) -> Result<Self> {
        Self::spawn_to_end_by(Signal::SIGKILL, label, command)
    }

    /// As [`Process::spawn`], but when this process is killed the child gets `signal`, so that a
    /// child with something to clean up can do so.
    ///
    /// # Errors
    /// When the program cannot be started.
    pub fn spawn_to_end_by(signal: Signal, label: &str, command: &mut Command) -> Result<Self> {
        sys::end_with_parent(command, signal);
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("starting {label}: {}", command.get_program().display()))?;
        let output = Arc::new(Output::default());
        let readers = vec![
            read_lines(child.stdout.take(), &output, Stream::Stdout),
            read_lines(child.stderr.take(), &output, Stream::Stderr),
        ];
        Ok(Self {
            label: label.to_owned(),
            child,
            output,
            readers,
            next_line: 0,
        })
    }

    /// The process id.
    #[must_use]
    pub fn pid(&self) -> Pid {
        Pid::from_raw(self.child.id().cast_signed())
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) -> Result<()> {
        kill(self.pid(), signal).with_context(|| format!("sending {signal} to {}", self.label))
    }

    /// Waits for the next event that `wanted` accepts. Every event is looked at once: a later call
    /// continues behind the event that this one returned.
    ///
    /// # Errors
    /// When the time is over or the child has closed its output; the message holds the end of the output.
    pub fn wait_json_event(
        &mut self,
        wanted: impl Fn(&Value) -> bool,
        timeout: Duration,
    ) -> Result<Value> {
        let found = self.wait_for(timeout, |line| {
            parse_event(line).filter(|event| wanted(event))
        });
        found.with_context(|| format!("{} did not report what was waited for", self.label))
    }

    /// Waits for the next line, on either output, that contains `text`. Lines are looked at once,
    /// as in [`Process::wait_json_event`].
    ///
    /// # Errors
    /// When the time is over or the child has closed its output; the message holds the end of the output.
    pub fn wait_line(&mut self, text: &str, timeout: Duration) -> Result<String> {
        let found = self.wait_for(timeout, |line| {
            line.text.contains(text).then(|| line.text.clone())
        });
        found.with_context(|| format!("{} did not print {text:?}", self.label))
    }

    fn wait_for<T>(&mut self, timeout: Duration, accept: impl Fn(&Line) -> Option<T>) -> Result<T> {
        let deadline = Instant::now() + timeout;
        let mut state = self.output.lock();
        loop {
            while let Some(line) = state.lines.get(self.next_line) {
                self.next_line += 1;
                if let Some(accepted) = accept(line) {
                    return Ok(accepted);
                }
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if state.open_streams == 0 || left.is_zero() {
                let why = if left.is_zero() {
                    "time over"
                } else {
                    "it ended"
                };
                bail!("{why}; its output:\n{}", state.last_text());
            }
            let waited = self.output.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits for the exit and for the rest of the output.
    ///
    /// # Errors
    /// When the time is over; the child goes on running.
    pub fn wait_exit(&mut self, timeout: Duration) -> Result<ExitStatus> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(status) = self.child.try_wait()? {
                for reader in self.readers.drain(..) {
                    // A reader has nothing to lose; its panic would only hide the exit status.
                    let _ = reader.join();
                }
                return Ok(status);
            }
            if Instant::now() >= deadline {
                bail!(
                    "{} still runs after {timeout:?}; its output:\n{}",
                    self.label,
                    self.last_text()
                );
            }
            thread::sleep(EXIT_POLL);
        }
    }

    /// Waits for the exit and fails with the output unless the status is 0.
    pub fn wait_success(&mut self, timeout: Duration) -> Result<()> {
        let status = self.wait_exit(timeout)?;
        if !status.success() {
            bail!(
                "{}: {status}; its output:\n{}",
                self.label,
                self.last_text()
            );
        }
        Ok(())
    }

    /// All events printed so far.
    #[must_use]
    pub fn events(&self) -> Vec<Value> {
        self.output
            .lock()
            .lines
            .iter()
            .filter_map(parse_event)
            .collect()
    }

    /// All events printed so far, each with the time at which it was read.
    #[must_use]
    pub fn timed_events(&self) -> Vec<(Instant, Value)> {
        self.output
            .lock()
            .lines
            .iter()
            .filter_map(|line| Some((line.at, parse_event(line)?)))
            .collect()
    }

    /// Everything printed so far, standard error included, in the order of arrival.
    #[must_use]
    pub fn text(&self) -> String {
        self.output.lock().text()
    }

    /// The last lines of [`Process::text`].
    #[must_use]
    pub fn last_text(&self) -> String {
        self.output.lock().last_text()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Both fail only when the child has ended and been waited for.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Resident memory of a process in bytes.
///
/// # Errors
/// When the process has ended.
pub fn resident(pid: Pid) -> Result<u64> {
    memory(pid, "VmRSS:")
}

/// The most that [`resident`] has been.
///
/// # Errors
/// When the process has ended.
pub fn peak_resident(pid: Pid) -> Result<u64> {
    memory(pid, "VmHWM:")
}

fn memory(pid: Pid, name: &str) -> Result<u64> {
    let text = fs::read_to_string(format!("/proc/{pid}/status"))?;
    let mut lines = text.lines();
    let size = lines.find_map(|line| line.strip_prefix(name));
    let kilobytes = size.and_then(|size| size.trim().strip_suffix("kB"));
    Ok(1024 * kilobytes.context("no such line")?.trim().parse::<u64>()?)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stream {
    Stdout,
    Stderr,
}

struct Line {
    at: Instant,
    stream: Stream,
    text: String,
}

#[derive(Default)]
struct Output {
    state: Mutex<OutputState>,
    changed: Condvar,
}

impl Output {
    fn lock(&self) -> MutexGuard<'_, OutputState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[derive(Default)]
struct OutputState {
    lines: Vec<Line>,
    open_streams: usize,
}

impl OutputState {
    fn text(&self) -> String {
        let lines = self.lines.iter().map(|line| line.text.as_str());
        lines.collect::<Vec<_>>().join("\n")
    }

    /// The end of it, for error messages.
    fn last_text(&self) -> String {
        const LINES: usize = 40;
        let before = self.lines.len().saturating_sub(LINES);
        let lines = self.lines.iter().skip(before);
        let lines: Vec<&str> = lines.map(|line| line.text.as_str()).collect();
        format!("({before} lines before)\n{}", lines.join("\n"))
    }
}

fn parse_event(line: &Line) -> Option<Value> {
    if line.stream != Stream::Stdout {
        return None;
    }
    serde_json::from_str(&line.text)
        .ok()
        .filter(Value::is_object)
}

fn read_lines(
    pipe: Option<impl Read + Send + 'static>,
    output: &Arc<Output>,
    stream: Stream,
) -> JoinHandle<()> {
    output.lock().open_streams += 1;
    let output = Arc::clone(output);
    thread::spawn(move || {
        let lines = pipe
            .into_iter()
            .flat_map(|pipe| BufReader::new(pipe).split(b'\n'));
        for bytes in lines.map_while(Result::ok) {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let at = Instant::now();
            output.lock().lines.push(Line { at, stream, text });
            output.changed.notify_all();
        }
        output.lock().open_streams -= 1;
        output.changed.notify_all();
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_secs(5);

    fn shell(script: &str) -> Process {
        Process::spawn("shell", Command::new("sh").args(["-c", script])).unwrap()
    }

    #[test]
    fn events_are_looked_at_once() {
        let mut child = shell(r#"echo '{"n":1}'; echo noise; echo '{"n":2}'"#);
        let any = |_: &Value| true;
        assert_eq!(child.wait_json_event(any, SOON).unwrap()["n"], 1);
        assert_eq!(child.wait_json_event(any, SOON).unwrap()["n"], 2);
        let error = child.wait_json_event(any, SOON).unwrap_err();
        assert!(format!("{error:#}").contains("it ended"), "{error:#}");
        assert_eq!(child.events().len(), 2);
    }

    #[test]
    fn a_failure_shows_both_outputs() {
        let mut child = shell("echo out; echo err >&2; exit 3");
        let error = child.wait_success(SOON).unwrap_err().to_string();
        assert!(error.contains("out") && error.contains("err"), "{error}");
    }

    #[test]
    fn drop_kills() {
        let child = shell("sleep 100");
        let pid = child.pid();
        drop(child);
        assert!(kill(pid, None).is_err());
    }

    #[test]
    fn waiting_ends_with_the_time() {
        let mut child = shell("sleep 100");
        assert!(child.wait_line("never", Duration::from_millis(20)).is_err());
        assert!(child.wait_exit(Duration::from_millis(20)).is_err());
    }
}
