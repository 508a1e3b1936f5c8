//! SIGINT and SIGTERM end a measurement, whose result is printed all the same.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context, Result};
use nix::sys::signal::{SigSet, Signal};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on the signals are reported by [`requested`]. To be called before any thread is started, so that all
/// block them.
pub(crate) fn catch_signals() -> Result<()> {
    let signals = SigSet::from_iter([Signal::SIGINT, Signal::SIGTERM]);
    signals
        .thread_block()
        .context("signals cannot be blocked")?;
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            if signals.wait().is_ok() {
                REQUESTED.store(true, Ordering::Relaxed);
            }
        })
        .context("no thread for signals")?;
    Ok(())
}

/// Whether there was a signal.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
