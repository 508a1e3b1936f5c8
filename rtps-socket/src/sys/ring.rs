//! The consumer of a BPF ring buffer (`BPF_MAP_TYPE_RINGBUF`).
//!
//! The kernel lays a ring out as a page with the consumer's position, which the app writes, a page with the
//! producer's position, and the data, all read-only to the app. Both positions count bytes since the ring was
//! made. A record is a header of 8 bytes (its length and two flag bits, then something of the kernel's own), its
//! bytes, and padding to a multiple of 8. The data could be mapped twice in a row, so that a record that wraps were
//! seen whole; but every mapped page counts as the app's memory, and one record of a lap is cheaper to copy.

use std::io::{self, Read};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use super::mapping::{Mapping, page_size};

/// The producer still writes the record.
const BUSY: u32 = 1 << 31;
/// The producer thought better of it.
const DISCARDED: u32 = 1 << 30;
const HEADER_LEN: u64 = 8;

/// Reads records in place. There is one consumer per ring.
#[derive(Debug)]
pub(crate) struct RingConsumer {
    fd: OwnedFd,
    ring: Arc<Ring>,
    /// A record that wraps, put together.
    wrapped: Vec<u8>,
}

/// What a ring shows to any thread of the app.
#[derive(Debug)]
pub(crate) struct Ring {
    position: Mapping,
    records: Mapping,
    /// Where the data begin in `records`.
    data: usize,
    size: u64,
}

impl RingConsumer {
    /// Maps a ring that was passed by the layer.
    pub(crate) fn map(fd: OwnedFd) -> io::Result<Self> {
        let size = ring_size(fd.as_fd())?;
        Self::map_sized(fd, size)
    }

    /// Maps a ring of `size` bytes of data.
    fn map_sized(fd: OwnedFd, size: usize) -> io::Result<Self> {
        let page = page_size();
        if !size.is_power_of_two() || !size.is_multiple_of(page) || size > 1 << 30 {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                format!("a ring cannot have {size} bytes"),
            ));
        }
        let ring = Arc::new(Ring {
            position: Mapping::new(fd.as_fd(), 0, page, true)?,
            records: Mapping::new(fd.as_fd(), page, page + size, false)?,
            data: page,
            size: size as u64,
        });
        let wrapped = Vec::new();
        Ok(Self { fd, ring, wrapped })
    }

    /// What other threads may look at.
    pub(crate) fn ring(&self) -> &Arc<Ring> {
        &self.ring
    }

    /// Hands up to `limit` records to `take`, oldest first, and frees the room of each one after that. Returns how
    /// many there were; fewer than `limit` means that the ring is empty.
    pub(crate) fn drain(&mut self, limit: usize, mut take: impl FnMut(&[u8])) -> usize {
        let ring = &*self.ring;
        let mut taken = 0;
        // Only this consumer moves its position.
        let mut consumer = ring.consumer_position().load(Ordering::Relaxed);
        while taken < limit && consumer < ring.producer_position().load(Ordering::Acquire) {
            let header = ring.header_at(consumer).load(Ordering::Acquire);
            if header & BUSY != 0 {
                break;
            }
            let len = u64::from(header & !DISCARDED);
            if len > ring.size - HEADER_LEN {
                // No kernel writes this; without a length there is no next record either.
                consumer = ring.producer_position().load(Ordering::Acquire);
                ring.consumer_position().store(consumer, Ordering::Release);
                break;
            }
            if header & DISCARDED == 0 {
                take(ring.record(consumer + HEADER_LEN, len as usize, &mut self.wrapped));
                taken += 1;
            }
            consumer += (HEADER_LEN + len).next_multiple_of(8);
            ring.consumer_position().store(consumer, Ordering::Release);
        }
        taken
    }
}

impl Ring {
    /// Whether a complete record waits.
    pub(crate) fn has_record(&self) -> bool {
        let consumer = self.consumer_position().load(Ordering::Relaxed);
        consumer < self.producer_position().load(Ordering::SeqCst)
            && self.header_at(consumer).load(Ordering::SeqCst) & BUSY == 0
    }

    fn consumer_position(&self) -> &AtomicU64 {
        // SAFETY: the first word of a writable page that lives as long as `self`; the kernel only reads it.
        unsafe { &*self.position.start().cast() }
    }

    fn producer_position(&self) -> &AtomicU64 {
        // SAFETY: the first word of a readable page that lives as long as `self`; it is only loaded.
        unsafe { &*self.records.start().cast() }
    }

    /// The first word of the record at `position`.
    fn header_at(&self, position: u64) -> &AtomicU32 {
        // SAFETY: `at` stays within the mapping; records begin at multiples of 8, as the end of the data is one, so
        // that the word does not wrap; it is only loaded.
        unsafe { &*self.at(position).cast() }
    }

    /// `len` bytes, at most the ring's size, of a record that the producer has finished. `wrapped` is where they are put
    /// together, should they wrap.
    fn record<'a>(&'a self, position: u64, len: usize, wrapped: &'a mut Vec<u8>) -> &'a [u8] {
        let to_end = (self.size - (position & (self.size - 1))) as usize;
        if len <= to_end {
            return self.bytes_at(position, len);
        }
        wrapped.clear();
        wrapped.extend_from_slice(self.bytes_at(position, to_end));
        wrapped.extend_from_slice(self.bytes_at(position + to_end as u64, len - to_end));
        wrapped
    }

    /// `len` bytes of a record that the producer has finished, which do not wrap.
    fn bytes_at(&self, position: u64, len: usize) -> &[u8] {
        debug_assert!((position & (self.size - 1)) + len as u64 <= self.size);
        // SAFETY: the bytes end within the mapping; the producer does not touch a finished record before the
        // consumer's position passes it, which happens in `drain`, after the last use of the record.
        unsafe { std::slice::from_raw_parts(self.at(position), len) }
    }

    /// Where the byte at `position` is mapped.
    fn at(&self, position: u64) -> *const u8 {
        let offset = self.data + (position & (self.size - 1)) as usize;
        self.records.start().wrapping_add(offset)
    }
}

impl AsFd for RingConsumer {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

/// The size of a ring as the kernel tells it, to any process, about a descriptor.
fn ring_size(fd: BorrowedFd<'_>) -> io::Result<usize> {
    const RINGBUF: &str = "27";
    let mut info = String::new();
    let path = format!("/proc/self/fdinfo/{}", fd.as_raw_fd());
    std::fs::File::open(path)?.read_to_string(&mut info)?;
    let field = |name: &str| {
        info.lines()
            .find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))
            .map(str::trim)
    };
    if field("map_type") != Some(RINGBUF) {
        let what = "the descriptor that the layer passed is no ring buffer";
        return Err(io::Error::new(io::ErrorKind::InvalidData, what));
    }
    field("max_entries")
        .and_then(|entries| entries.parse().ok())
        .ok_or_else(|| io::Error::other("the kernel does not tell the size of the ring"))
}

#[cfg(test)]
pub(super) mod tests;
