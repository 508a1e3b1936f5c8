//! Buffers that are written into by the app and become payloads as they are (DDS extension, "zero copy writes").
//!
//! A payload that was serialized elsewhere, an image or a point cloud, need not be copied into the history: it is
//! there already. When no reader needs it any more the buffer is lent again, so that its memory is not asked of the
//! system anew. What leaves by a socket is copied once more, into datagrams.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use bytes::Bytes;

/// Buffers that are kept for the next loans.
const KEPT: usize = 8;
/// The encapsulation header of plain CDR, little endian (RTPS 2.5 section 10.2).
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// The buffers of a writer that are not lent.
#[derive(Debug, Default)]
pub(super) struct Pool {
    free: Mutex<Vec<Vec<u8>>>,
}

impl Pool {
    /// Lends a buffer of `len` bytes, at least the header.
    pub(super) fn lend(self: &Arc<Self>, len: usize) -> Loan {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let fitting = free.iter().position(|buffer| buffer.capacity() >= len);
        let place = fitting.or_else(|| free.len().checked_sub(1));
        let mut buffer = place.map_or_else(Vec::new, |place| free.swap_remove(place));
        drop(free);
        buffer.resize(len.max(HEADER.len()), 0);
        buffer[..HEADER.len()].copy_from_slice(&HEADER);
        Loan {
            buffer,
            pool: Arc::downgrade(self),
        }
    }

    fn take_back(&self, buffer: Vec<u8>) {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.len() < KEPT {
            free.push(buffer);
        }
    }
}

/// A buffer for one payload. It begins with the encapsulation header, which says plain CDR, little endian, unless it is
/// written over; what follows is whatever an earlier payload left there. Dropped, it is not sent.
#[derive(Debug)]
pub struct Loan {
    buffer: Vec<u8>,
    pool: Weak<Pool>,
}

impl Loan {
    /// Shortens the payload.
    pub fn truncate(&mut self, len: usize) {
        self.buffer.truncate(len);
    }

    pub(super) fn into_payload(self) -> Bytes {
        Bytes::from_owner(self)
    }
}

impl Deref for Loan {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.buffer
    }
}

impl DerefMut for Loan {
    fn deref_mut(&mut self) -> &mut [u8] {
        &mut self.buffer
    }
}

impl AsRef<[u8]> for Loan {
    fn as_ref(&self) -> &[u8] {
        &self.buffer
    }
}

impl Drop for Loan {
    fn drop(&mut self) {
        if let Some(pool) = self.pool.upgrade() {
            pool.take_back(std::mem::take(&mut self.buffer));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_comes_back_when_its_payload_is_gone() {
        let pool = Arc::new(Pool::default());
        let mut loan = pool.lend(1000);
        loan[999] = 7;
        let address = loan.as_ptr();
        let payload = loan.into_payload();
        assert_eq!(
            (payload.as_ptr(), payload.len()),
            (address, 1000),
            "not copied"
        );
        let other = payload.clone();
        drop(payload);
        assert_ne!(pool.lend(1000).as_ptr(), address, "still in use");
        drop(other);
        let addresses = [pool.lend(500), pool.lend(500)].map(|loan| loan.as_ptr());
        assert!(addresses.contains(&address));
    }

    #[test]
    fn the_header_is_there_whatever_was_before() {
        let pool = Arc::new(Pool::default());
        pool.lend(8).fill(0xff);
        assert_eq!(pool.lend(0)[..], HEADER);
        for _ in 0..2 * KEPT {
            pool.take_back(Vec::new());
        }
        assert_eq!(pool.free.lock().unwrap().len(), KEPT);
    }
}
