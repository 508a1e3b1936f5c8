//! Standard output, written by a thread of its own: a reader that stops reading holds up nobody else.
//!
//! Each line leaves with one call as soon as it is there. Listeners never wait; [`Printer::print_patiently`] slows a
//! main loop down that is megabytes ahead of its reader.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

use crate::interrupt::Interrupt;

/// Octets that may wait for a reader that has stopped reading.
const PATIENCE: usize = 64 << 20;
/// How long one sleeps between two looks.
const LOOK: Duration = Duration::from_millis(20);
/// For how long what is left is written after an interrupt.
const FAREWELL: Duration = Duration::from_secs(1);

enum Item {
    Line(String),
    /// Answered when all before it is written.
    Mark(Sender<()>),
}

/// A handle for whoever prints.
#[derive(Clone)]
pub(crate) struct Printer {
    items: Sender<Item>,
    waiting: Arc<AtomicUsize>,
    interrupt: Interrupt,
}

impl Printer {
    /// Starts the thread. Where nobody reads any more, it raises the interrupt.
    pub(crate) fn start(interrupt: &Interrupt) -> io::Result<Self> {
        let (sender, items) = mpsc::channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let printer = Self {
            items: sender,
            waiting: Arc::clone(&waiting),
            interrupt: interrupt.clone(),
        };
        let interrupt = interrupt.clone();
        let thread = thread::Builder::new().name("output".to_owned());
        thread.spawn(move || {
            if write(&items, &waiting).is_err() {
                interrupt.raise();
            }
        })?;
        Ok(printer)
    }

    /// Prints a line without ever waiting.
    pub(crate) fn print(&self, line: impl Into<String>) {
        let mut line = line.into();
        line.push('\n');
        self.waiting.fetch_add(line.len(), Ordering::Relaxed);
        // The thread has ended where nobody reads any more.
        let _ = self.items.send(Item::Line(line));
    }

    /// Prints a line, when there is room for it.
    pub(crate) fn print_patiently(&self, line: impl Into<String>) {
        while self.waiting.load(Ordering::Relaxed) > PATIENCE && !self.interrupt.is_raised() {
            self.interrupt.sleep(LOOK);
        }
        self.print(line);
    }

    /// Waits until everything is written; not for long once the program is interrupted.
    pub(crate) fn finish(self) {
        let (sender, written) = mpsc::channel();
        let _ = self.items.send(Item::Mark(sender));
        while !self.interrupt.is_raised() {
            match written.recv_timeout(LOOK) {
                Err(RecvTimeoutError::Timeout) => {}
                Ok(()) | Err(RecvTimeoutError::Disconnected) => return,
            }
        }
        let _ = written.recv_timeout(FAREWELL);
    }
}

fn write(items: &Receiver<Item>, waiting: &AtomicUsize) -> io::Result<()> {
    for item in items {
        match item {
            Item::Line(line) => {
                io::stdout().lock().write_all(line.as_bytes())?;
                waiting.fetch_sub(line.len(), Ordering::Relaxed);
            }
            // Who asked may have gone.
            Item::Mark(sender) => drop(sender.send(())),
        }
    }
    Ok(())
}
