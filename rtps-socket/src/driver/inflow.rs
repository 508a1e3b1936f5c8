//! Whether what arrives is a stream, in which nobody asks for an answer.
//!
//! Who waits for samples looks for them rather than to sleep. In a stream there are always some, so that such a thread
//! would keep a CPU busy all the time. It naps instead, and takes together what has come meanwhile. An app that writes
//! between two arrivals is one that answers, or waits for an answer, and never naps.

use std::time::Instant;

use super::batching::GAP;

/// Arrivals in a row after which they are taken for a stream.
const STREAM: u32 = 16;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Inflow {
    row: u32,
    last: Option<Instant>,
}

impl Inflow {
    /// So many datagrams have come since the last time.
    pub(super) fn arrived(&mut self, now: Instant, count: usize) {
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        let time = GAP.saturating_mul(count);
        let is_dense = self.last.is_some_and(|last| now - last <= time);
        self.last = Some(now);
        self.row = if is_dense {
            self.row.saturating_add(1)
        } else {
            0
        };
    }

    /// The app has written.
    pub(super) fn interrupt(&mut self) {
        self.row = 0;
    }

    /// Whether there will soon be more, and nobody is in a hurry.
    pub(super) fn is_stream(&self) -> bool {
        self.row >= STREAM
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Whether it is a stream when `count` datagrams come together a hundred times, `gap_us` apart.
    fn is_stream(count: usize, gap_us: u64) -> bool {
        let (mut inflow, mut now) = (Inflow::default(), Instant::now());
        for _ in 0..100 {
            now += Duration::from_micros(gap_us);
            inflow.arrived(now, count);
        }
        inflow.is_stream()
    }

    #[test]
    fn what_comes_close_together_is_a_stream() {
        assert!(is_stream(1, 5));
        assert!(is_stream(10, 100), "as when they are taken together");
        assert!(!is_stream(1, 50));
        assert!(!is_stream(2, 100));
    }

    #[test]
    fn who_answers_gets_no_stream() {
        let (mut inflow, mut now) = (Inflow::default(), Instant::now());
        for _ in 0..100 {
            now += Duration::from_micros(5);
            inflow.arrived(now, 1);
            inflow.interrupt();
            assert!(!inflow.is_stream());
        }
    }
}
