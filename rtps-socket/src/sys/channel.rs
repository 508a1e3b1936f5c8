//! A ring of datagrams in memory that two processes share: one fills it, the other empties it.
//!
//! It is laid out as a page with the producer's position, a page with the consumer's position, and the data. Both
//! positions count bytes since the ring was made. A record is its length (4 bytes, and 4 without meaning), its bytes,
//! and padding to a multiple of 8; the data are mapped twice, so that no record wraps.
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
use std::sync::atomic::{AtomicU32, Ordering, fence};

use self::ring::{Consumer, Producer};
use super::mapping::{Mapping, page_size};

/// What sends to another process.
#[derive(Debug)]
pub(crate) struct Outbound {
    producer: Producer,
    bell: PeerBell,
    wake: File,
    /// Where the other side had read to when it was woken last.
    woken_at: Option<u64>,
}

impl Outbound {
    /// Maps the ring to fill and the other side's bell; `wake` is the pipe that wakes it.
    pub(crate) fn map(ring: OwnedFd, wake: OwnedFd, bell: OwnedFd) -> io::Result<Self> {
        Ok(Self {
            producer: Producer::map(&File::from(ring))?,
            bell: PeerBell::map(bell.as_fd())?,
            wake: wake.into(),
            woken_at: None,
        })
    }

    /// Sends datagrams, and wakes the other side if it sleeps. False when it has no room for all: the rest is left out.
    pub(crate) fn send<'a>(&mut self, datagrams: impl Iterator<Item = &'a [u8]>) -> bool {
        let mut have_fit = true;
        for datagram in datagrams {
            have_fit = self.producer.put(datagram);
            if !have_fit {
                break;
            }
        }
        if self.producer.publish() {
            self.wake();
        }
        have_fit
    }

    fn wake(&mut self) {
        // Between the record and the bell: the other side goes the other way round.
        fence(Ordering::SeqCst);
        if !self.bell.is_armed() {
            return;
        }
        // Who has not read since is on its way, and does not sleep again before it has.
        let consumed = Some(self.producer.consumed());
        if self.woken_at == consumed {
            return;
        }
        self.woken_at = consumed;
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

    /// Whether a datagram waits.
    pub(crate) fn has_record(&self) -> bool {
        self.consumer.has_record()
    }
}

impl AsFd for Inbound {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.pipe.as_fd()
    }
}

/// Another process's [`Bell`](super::Bell).
#[derive(Debug)]
struct PeerBell {
    mapping: Mapping,
}

impl PeerBell {
    fn map(fd: BorrowedFd<'_>) -> io::Result<Self> {
        let mapping = Mapping::new(fd, 0, page_size(), false)?;
        Ok(Self { mapping })
    }

    /// Whether it wants to be woken.
    fn is_armed(&self) -> bool {
        // SAFETY: a page-aligned, readable page that lives as long as `self`; the word is only loaded.
        let need_wakeup: &AtomicU32 = unsafe { &*self.mapping.start().cast() };
        need_wakeup.load(Ordering::Relaxed) != 0
    }
}
