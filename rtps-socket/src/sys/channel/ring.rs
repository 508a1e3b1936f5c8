//! The two sides of the shared ring.

use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

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
    /// Those of the producer and the consumer.
    control: Mapping,
    data: Mapping,
    page: usize,
    /// Of the data.
    size: u64,
}

impl Pages {
    /// Maps a ring; only the producer writes data.
    fn map(file: &File, is_producer: bool) -> io::Result<Self> {
        let page = page_size();
        let len = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX);
        let size = len.saturating_sub(2 * page);
        if !size.is_power_of_two() || !size.is_multiple_of(page) || size > MAX_RING {
            let what = format!("{len} bytes are no ring");
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        Ok(Self {
            control: Mapping::new(file.as_fd(), 0, 2 * page, true)?,
            data: Mapping::new(file.as_fd(), 2 * page, size, is_producer)?,
            page,
            size: size as u64,
        })
    }

    fn producer(&self) -> &AtomicU64 {
        // SAFETY: the first word of a writable page that lives as long as `self`.
        unsafe { &*self.control.start().cast() }
    }

    fn consumer(&self) -> &AtomicU64 {
        // SAFETY: the first word of a writable page that lives as long as `self`.
        unsafe { &*self.control.start().wrapping_add(self.page).cast() }
    }

    /// Whether the consumer sleeps, or is about to.
    fn is_waiting(&self) -> &AtomicU32 {
        let place = self.page + size_of::<AtomicU64>();
        // SAFETY: an aligned word behind the consumer's position, in the same page.
        unsafe { &*self.control.start().wrapping_add(place).cast() }
    }

    /// The first word of the record at `position`, a multiple of 8.
    fn length_at(&self, position: u64) -> &AtomicU32 {
        let (place, _) = self.at(position);
        // SAFETY: the place is within the mapping, as is the word, because the data end at a multiple of 8; only the
        // producer, who has mapped it writable, stores.
        unsafe { &*place.cast() }
    }

    /// Where the byte at `position` is, and how many follow to the end of the data.
    fn at(&self, position: u64) -> (*const u8, usize) {
        let offset = (position & (self.size - 1)) as usize;
        let place = self.data.start().wrapping_add(offset);
        (place, self.size as usize - offset)
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
        let (place, to_end) = self.pages.at(self.position + HEADER);
        let (first, wrapped) = record.split_at(record.len().min(to_end));
        let (begin, _) = self.pages.at(0);
        // SAFETY: the record is no longer than the data, which are writable; its first part ends with them at the latest,
        // and the rest begins with them. A consumer that reads them before they are published reads any bytes, as from
        // any other process.
        unsafe {
            ptr::copy_nonoverlapping(first.as_ptr(), place.cast_mut(), first.len());
            ptr::copy_nonoverlapping(wrapped.as_ptr(), begin.cast_mut(), wrapped.len());
        }
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

    /// How far the consumer may read.
    pub(super) fn published(&self) -> u64 {
        self.published
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

/// What a ring shows to any thread of its consumer.
#[derive(Debug)]
pub(crate) struct Inlet {
    pages: Pages,
    /// How far it was read. Only the one consumer moves it.
    position: AtomicU64,
    /// The producer has published what cannot be; nothing of it is believed any more.
    is_broken: AtomicBool,
}

impl Inlet {
    /// Whether something was published that has not been read.
    pub(crate) fn has_record(&self) -> bool {
        let position = self.position.load(Ordering::Relaxed);
        !self.is_broken.load(Ordering::Relaxed)
            && self.pages.producer().load(Ordering::SeqCst) != position
    }

    /// The length of the record at `position`, if it is one that can be there.
    fn record(&self, position: u64, producer: u64) -> Option<usize> {
        let available = producer.wrapping_sub(position);
        if available < HEADER || available > self.pages.size || !available.is_multiple_of(8) {
            return None;
        }
        let header = self.pages.length_at(position);
        let len = u64::from(header.load(Ordering::Relaxed));
        (len <= MAX_RECORD && space(len) <= available).then_some(len as usize)
    }

    /// Copies `len` bytes, at most as many as there are data.
    fn copy(&self, position: u64, len: usize, buffer: &mut Vec<u8>) {
        let (place, to_end) = self.pages.at(position);
        let (begin, _) = self.pages.at(0);
        let first = len.min(to_end);
        buffer.clear();
        buffer.reserve(len);
        // SAFETY: the first part ends with the data at the latest, the rest begins with them; the buffer has room for
        // both, and whatever bytes the other process has or puts there, they are initialized.
        unsafe {
            ptr::copy_nonoverlapping(place, buffer.as_mut_ptr(), first);
            ptr::copy_nonoverlapping(begin, buffer.as_mut_ptr().add(first), len - first);
            buffer.set_len(len);
        }
    }
}

/// Empties a ring.
#[derive(Debug)]
pub(super) struct Consumer {
    inlet: Arc<Inlet>,
}

impl Consumer {
    pub(super) fn map(file: &File) -> io::Result<Self> {
        let inlet = Inlet {
            pages: Pages::map(file, false)?,
            position: AtomicU64::new(0),
            is_broken: AtomicBool::new(false),
        };
        Ok(Self {
            inlet: Arc::new(inlet),
        })
    }

    /// What other threads may look at.
    pub(super) fn inlet(&self) -> &Arc<Inlet> {
        &self.inlet
    }

    /// Copies up to `limit` records to `buffer`, one by one, and hands them to `take`; then frees their room. Returns how
    /// many there were.
    pub(super) fn drain(
        &mut self,
        limit: usize,
        buffer: &mut Vec<u8>,
        mut take: impl FnMut(&[u8]),
    ) -> usize {
        let inlet = &*self.inlet;
        if inlet.is_broken.load(Ordering::Relaxed) {
            return 0;
        }
        let producer = inlet.pages.producer().load(Ordering::Acquire);
        let mut position = inlet.position.load(Ordering::Relaxed);
        let mut taken = 0;
        while taken < limit && position != producer {
            let Some(len) = inlet.record(position, producer) else {
                tracing::error!(
                    "another app has broken its ring to this one, which reads it no more"
                );
                inlet.is_broken.store(true, Ordering::Relaxed);
                break;
            };
            inlet.copy(position + HEADER, len, buffer);
            position += space(len as u64);
            taken += 1;
            take(buffer);
        }
        if taken > 0 {
            inlet.position.store(position, Ordering::Relaxed);
            let consumer = inlet.pages.consumer();
            consumer.store(position, Ordering::Release);
        }
        taken
    }

    /// Says whether the consumer wants to be woken.
    pub(super) fn set_waiting(&self, is_waiting: bool) {
        let flag = self.inlet.pages.is_waiting();
        flag.store(is_waiting.into(), Ordering::Relaxed);
    }
}
