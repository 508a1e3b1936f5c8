//! SIGINT as a flag that ends loops and sleeps.

use std::io;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use nix::sys::signal::{SigSet, Signal};

/// Raised by SIGINT; clones share it.
#[derive(Clone, Default)]
pub(crate) struct Interrupt {
    state: Arc<(Mutex<bool>, Condvar)>,
}

impl Interrupt {
    /// Catches SIGINT from now on. To be called before any thread is started, so that all of them block it.
    pub(crate) fn catch() -> io::Result<Self> {
        let interrupt = Self::default();
        let signals = SigSet::from(Signal::SIGINT);
        signals.thread_block()?;
        let caught = interrupt.clone();
        thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || {
                if signals.wait().is_ok() {
                    caught.raise();
                }
            })?;
        Ok(interrupt)
    }

    pub(crate) fn raise(&self) {
        let (raised, changed) = &*self.state;
        *raised.lock().unwrap_or_else(PoisonError::into_inner) = true;
        changed.notify_all();
    }

    pub(crate) fn is_raised(&self) -> bool {
        let (raised, _) = &*self.state;
        *raised.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sleeps, or not so long where it is raised.
    pub(crate) fn sleep(&self, time: Duration) {
        let (raised, changed) = &*self.state;
        let raised = raised.lock().unwrap_or_else(PoisonError::into_inner);
        drop(changed.wait_timeout_while(raised, time, |raised| !*raised));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sleep_ends_with_the_interrupt() {
        let interrupt = Interrupt::default();
        interrupt.sleep(Duration::from_millis(1));
        assert!(!interrupt.is_raised());
        let raiser = interrupt.clone();
        let thread = thread::spawn(move || raiser.raise());
        interrupt.sleep(Duration::from_secs(3600));
        assert!(interrupt.is_raised());
        thread.join().unwrap();
    }
}
