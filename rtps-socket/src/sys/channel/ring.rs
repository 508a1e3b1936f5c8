//! The two sides of the shared ring.

use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::ptr;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use crate::sys::mapping::{Mapping, page_size};

const HEADER: u64 = 8;
/// The longest record: no datagram is longer.
const MAX_RECORD: u64 = 65_535;
/// More than any channel has.
const MAX_RING: usize = 1 << 30;

/// Bytes that a record of `len` takes.
fn space(len: u64) -> u64 {
    (HEADER + len).next_multiple_of(8)
}

/// The pages of a ring.
#[derive(Debug)]
struct Pages {
    mapping: Mapping,
    page: usize,
    /// Of the data.
    size: u64,
}

impl Pages {
    /// Maps a ring; one side writes its position only, the other the data too.
    fn map(file: &File, is_producer: bool) -> io::Result<Self> {
        let page = page_size();
        let len = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX);
        let size = len.saturating_sub(2 * page);
        if !size.is_power_of_two() || !size.is_multiple_of(page) || size > MAX_RING {
            let what = format!("{len} bytes are no ring");
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        let mapping = Mapping::reserve(2 * page + 2 * size)?;
        let (fd, data) = (file.as_fd(), 2 * page);
        mapping.overlay(0, (fd, 0), page, is_producer)?;
        mapping.overlay(page, (fd, page), page, !is_producer)?;
        mapping.overlay(data, (fd, data), size, is_producer)?;
        mapping.overlay(data + size, (fd, data), size, is_producer)?;
        Ok(Self {
            mapping,
            page,
            size: size as u64,
        })
    }

    fn producer(&self) -> &AtomicU64 {
        // SAFETY: the first word of a page that lives as long as `self`, written to by the producer alone, which has
        // mapped it writable.
        unsafe { &*self.mapping.start().cast() }
    }

    fn consumer(&self) -> &AtomicU64 {
        // SAFETY: the first word of a page that lives as long as `self`, written to by the consumer alone, which has
        // mapped it writable.
        unsafe { &*self.mapping.start().wrapping_add(self.page).cast() }
    }

    /// Whether the consumer sleeps, or is about to.
    fn is_waiting(&self) -> &AtomicU32 {
        let place = self.page + size_of::<AtomicU64>();
        // SAFETY: as for the consumer's position, which it stands behind.
        unsafe { &*self.mapping.start().wrapping_add(place).cast() }
    }

    /// The first word of the record at `position`, a multiple of 8.
    fn length_at(&self, position: u64) -> &AtomicU32 {
        // SAFETY: `at` is within the mapping and aligned; only the producer, who has mapped it writable, stores.
        unsafe { &*self.at(position).cast() }
    }

    /// Where the byte at `position` is mapped for the first time; `size` bytes follow.
    fn at(&self, position: u64) -> *const u8 {
        let offset = 2 * self.page + (position & (self.size - 1)) as usize;
        self.mapping.start().wrapping_add(offset)
    }
}

/// Fills a ring.
#[derive(Debug)]
pub(super) struct Producer {
    pages: Pages,
    /// Where the next record goes.
    position: u64,
    published: u64,
    /// How far the consumer had read when it was last looked at.
    consumed: u64,
}

impl Producer {
    pub(super) fn map(file: &File) -> io::Result<Self> {
        Ok(Self {
            pages: Pages::map(file, true)?,
            position: 0,
            published: 0,
            consumed: 0,
        })
    }

    /// Writes a record, which the consumer does not see before [`publish`](Self::publish). False without room.
    pub(super) fn put(&mut self, record: &[u8]) -> bool {
        let len = record.len() as u64;
        if len > MAX_RECORD || !self.has_room(space(len)) {
            return false;
        }
        let header = self.pages.length_at(self.position);
        header.store(len as u32, Ordering::Relaxed);
        let place = self.pages.at(self.position + HEADER).cast_mut();
        // SAFETY: `size` writable bytes begin there, and the record takes no more; a consumer that reads them before
        // they are published reads any bytes, as from any other process.
        unsafe { ptr::copy_nonoverlapping(record.as_ptr(), place, record.len()) };
        self.position += space(len);
        true
    }

    fn has_room(&mut self, wanted: u64) -> bool {
        // A consumer that claims to be ahead, or further behind than there is room, gets nothing more.
        let is_room = |consumed: u64| {
            let used = self.position.wrapping_sub(consumed);
            used.saturating_add(wanted) <= self.pages.size
        };
        if !is_room(self.consumed) {
            let consumed = self.pages.consumer().load(Ordering::Acquire);
            if !is_room(consumed) {
                return false;
            }
            self.consumed = consumed;
        }
        true
    }

    /// Shows the consumer what was written; false when that is nothing.
    pub(super) fn publish(&mut self) -> bool {
        let is_new = self.published != self.position;
        if is_new {
            self.published = self.position;
            let producer = self.pages.producer();
            producer.store(self.position, Ordering::Release);
        }
        is_new
    }

    /// Whether the consumer wants to be woken.
    pub(super) fn is_awaited(&self) -> bool {
        self.pages.is_waiting().load(Ordering::Relaxed) != 0
    }

    /// How far the consumer has read, as it says.
    pub(super) fn consumed(&self) -> u64 {
        self.pages.consumer().load(Ordering::Relaxed)
    }
}

/// Empties a ring.
#[derive(Debug)]
pub(super) struct Consumer {
    pages: Pages,
    position: u64,
    /// The producer has published what cannot be; nothing of it is believed any more.
    is_broken: bool,
}

impl Consumer {
    pub(super) fn map(file: &File) -> io::Result<Self> {
        Ok(Self {
            pages: Pages::map(file, false)?,
            position: 0,
            is_broken: false,
        })
    }

    /// Copies up to `limit` records to `buffer`, one by one, and hands them to `take`; then frees their room. Returns how
    /// many there were.
    pub(super) fn drain(
        &mut self,
        limit: usize,
        buffer: &mut Vec<u8>,
        mut take: impl FnMut(&[u8]),
    ) -> usize {
        let start = self.position;
        let producer = self.pages.producer().load(Ordering::Acquire);
        let mut taken = 0;
        while taken < limit && self.position != producer && !self.is_broken {
            let Some(len) = self.record(producer) else {
                tracing::error!(
                    "another app has broken its ring to this one, which reads it no more"
                );
                self.is_broken = true;
                break;
            };
            self.copy(len, buffer);
            self.position += space(len as u64);
            taken += 1;
            take(buffer);
        }
        if self.position != start {
            let consumer = self.pages.consumer();
            consumer.store(self.position, Ordering::Release);
        }
        taken
    }

    /// The length of the next record, if it is one that can be there.
    fn record(&self, producer: u64) -> Option<usize> {
        let available = producer.wrapping_sub(self.position);
        if available < HEADER || available > self.pages.size || !available.is_multiple_of(8) {
            return None;
        }
        let header = self.pages.length_at(self.position);
        let len = u64::from(header.load(Ordering::Relaxed));
        (len <= MAX_RECORD && space(len) <= available).then_some(len as usize)
    }

    /// Copies the record of `len` bytes that comes next.
    fn copy(&self, len: usize, buffer: &mut Vec<u8>) {
        let record = self.pages.at(self.position + HEADER);
        buffer.clear();
        buffer.reserve(len);
        // SAFETY: the record's bytes are mapped, since it is no longer than the data; the buffer has room for them, and
        // whatever bytes the other process has or puts there, they are initialized.
        unsafe {
            ptr::copy_nonoverlapping(record, buffer.as_mut_ptr(), len);
            buffer.set_len(len);
        }
    }

    /// Says whether the consumer wants to be woken.
    pub(super) fn set_waiting(&self, is_waiting: bool) {
        let flag = self.pages.is_waiting();
        flag.store(is_waiting.into(), Ordering::Relaxed);
    }

    /// Whether something was published that has not been read.
    pub(super) fn has_record(&self) -> bool {
        !self.is_broken && self.pages.producer().load(Ordering::SeqCst) != self.position
    }
}
