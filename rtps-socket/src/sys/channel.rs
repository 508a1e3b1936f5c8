//! A ring of datagrams in memory that two processes share: one fills it, the other empties it.
//!
//! It is laid out as a page with the producer's position, a page with the consumer's position and whether that sleeps,
//! and the data. Both positions count bytes since the ring was made. A record is its length (4 bytes, and 4 without meaning), its bytes,
//! which may go on where the data begin, and padding to a multiple of 8.
//!
//! The two sides need not trust each other. Each keeps its own position to itself and only publishes it; what the other
//! publishes is checked each time, and a record is copied before anybody looks at it. A ring whose producer breaks the rules
//! is not read any more.

mod ring;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};
use std::thread;
use std::time::{Duration, Instant};

pub(crate) use self::ring::Inlet;
use self::ring::{Consumer, Producer};

/// What sends to another process.
#[derive(Debug)]
pub(crate) struct Outbound {
    producer: Producer,
    wake: File,
    /// Where the other side had read to when it was woken last.
    woken_at: Option<u64>,
    /// Where the other side had read to when it was waited for in vain.
    stuck_at: Option<u64>,
}

/// How long another app is given, for one burst, to read what is in a full ring. One that runs makes room in less, and
/// one that reads on purpose so that it is waited for again and again does not stop this app.
const PATIENCE: Duration = Duration::from_micros(500);

impl Outbound {
    /// Maps the ring to fill; `wake` is the pipe that wakes the other side.
    pub(crate) fn map(ring: OwnedFd, wake: OwnedFd) -> io::Result<Self> {
        Ok(Self {
            producer: Producer::map(&File::from(ring))?,
            wake: wake.into(),
            woken_at: None,
            stuck_at: None,
        })
    }

    /// Sends datagrams, and wakes the other side if it sleeps. A side that reads more slowly than this one writes is
    /// waited for, but for a moment only. False when it has no room for all then: the rest is left out.
    pub(crate) fn send<'a>(&mut self, mut datagrams: impl Iterator<Item = &'a [u8]>) -> bool {
        let mut end = None;
        let have_fit = datagrams
            .all(|datagram| self.producer.put(datagram) || self.put_in_time(datagram, &mut end));
        self.publish();
        have_fit
    }

    fn publish(&mut self) {
        if self.producer.publish() {
            self.wake();
        }
    }

    /// Writes a datagram as soon as there is room, until `end`, which is set with the first wait. Who stands still is
    /// waited for only once.
    fn put_in_time(&mut self, datagram: &[u8], end: &mut Option<Instant>) -> bool {
        self.publish();
        let consumed = Some(self.producer.consumed());
        if self.stuck_at == consumed {
            return false;
        }
        let end = *end.get_or_insert_with(|| Instant::now() + PATIENCE);
        while !self.producer.put(datagram) {
            if Instant::now() >= end {
                self.stuck_at = Some(self.producer.consumed());
                return false;
            }
            thread::yield_now();
        }
        true
    }

    fn wake(&mut self) {
        // Between the record and this look: the other side goes the other way round.
        fence(Ordering::SeqCst);
        if !self.producer.is_awaited() {
            return;
        }
        // Who has not read since is on its way, and does not sleep again before it has. Who has read everything needs no
        // waking, and would be taken for being on its way without anything to read.
        let consumed = self.producer.consumed();
        if self.woken_at == Some(consumed) || self.producer.published() == consumed {
            return;
        }
        self.woken_at = Some(consumed);
        // A full pipe has not been read yet, and wakes.
        let _ = self.wake.write(&[0]);
    }
}

/// What receives from another process.
#[derive(Debug)]
pub(crate) struct Inbound {
    consumer: Consumer,
    pipe: File,
    /// How often the ring was emptied since the pipe was: at most so many bytes are in it.
    emptied: usize,
}

/// Far below the bytes that a pipe takes.
const PIPE_PERIOD: usize = 1024;

impl Inbound {
    /// Maps the ring to empty; `pipe` becomes readable when the other side wakes this one.
    pub(crate) fn map(ring: OwnedFd, pipe: OwnedFd) -> io::Result<Self> {
        Ok(Self {
            consumer: Consumer::map(&File::from(ring))?,
            pipe: pipe.into(),
            emptied: 0,
        })
    }

    /// Hands up to `limit` datagrams to `take`, which are copied to `buffer` one by one. Returns how many there were.
    pub(crate) fn drain(
        &mut self,
        limit: usize,
        buffer: &mut Vec<u8>,
        take: impl FnMut(&[u8]),
    ) -> usize {
        let taken = self.consumer.drain(limit, buffer, take);
        if taken > 0 {
            self.emptied += 1;
            if self.emptied >= PIPE_PERIOD {
                self.emptied = 0;
                // Fails only when nothing is there. Nobody looks at the bytes: what wakes is that they come.
                let _ = self.pipe.read(&mut [0; 2 * PIPE_PERIOD]);
            }
        }
        taken
    }

    /// Asks to be woken. Whatever [`has_record`](Self::has_record) does not see after this will do that.
    pub(crate) fn arm(&self) {
        self.consumer.set_waiting(true);
        fence(Ordering::SeqCst);
    }

    /// Awake: no wake-ups, please.
    pub(crate) fn disarm(&self) {
        self.consumer.set_waiting(false);
    }

    /// What other threads may look at to see whether a datagram waits.
    pub(crate) fn inlet(&self) -> &Arc<Inlet> {
        self.consumer.inlet()
    }

    /// Whether a datagram waits.
    pub(crate) fn has_record(&self) -> bool {
        self.inlet().has_record()
    }
}

impl AsFd for Inbound {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.pipe.as_fd()
    }
}
