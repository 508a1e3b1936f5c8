//! Waiting for what processes print, with an eye on Ctrl-C.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rtps_tests::process::Process;
use serde_json::Value;

use crate::interrupt;

/// How long a signal may go unnoticed.
const SLICE: Duration = Duration::from_millis(200);

/// Waits until a process has printed an event of this name, and gives the first one with the time at which it was read;
/// `None` after the deadline.
///
/// # Errors
/// When the process ends without it, and after a signal to this process.
pub(super) fn event(
    process: &mut Process,
    name: &str,
    deadline: Instant,
) -> Result<Option<(Instant, Value)>> {
    let wanted = |event: &Value| event["event"] == name;
    loop {
        // Whatever was looked at before: events of several threads come in any order.
        let mut events = process.timed_events().into_iter();
        if let Some(found) = events.find(|(_, event)| wanted(event)) {
            return Ok(Some(found));
        }
        interrupt::check()?;
        let left = deadline.saturating_duration_since(Instant::now());
        match process.wait_json_event(wanted, SLICE.min(left)) {
            Err(error) if process.wait_exit(Duration::ZERO).is_ok() => return Err(error),
            Err(_) if left.is_zero() => return Ok(None),
            Ok(_) | Err(_) => {}
        }
    }
}

/// As [`event`], where nothing else will do.
pub(super) fn require(
    process: &mut Process,
    name: &str,
    patience: Duration,
) -> Result<(Instant, Value)> {
    event(process, name, Instant::now() + patience)?
        .with_context(|| format!("no {name:?} after {patience:?}:\n{}", process.last_text()))
}

/// Waits that long.
///
/// # Errors
/// After a signal to this process.
pub(super) fn pause(time: Duration) -> Result<()> {
    let deadline = Instant::now() + time;
    loop {
        interrupt::check()?;
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(());
        }
        std::thread::sleep(SLICE.min(left));
    }
}
