//! The counts of ACKNACK and NACK_FRAG, by which duplicates are known (RTPS 2.5 section 8.3.5.10).

use std::time::{Duration, Instant};

/// The last count that was accepted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastCount(Option<(i32, Instant)>);

impl LastCount {
    /// After so long a lower count is no duplicate but that of a reader that was restarted.
    const MEMORY: Duration = Duration::from_millis(500);

    /// Whether it is a new one. Counts may wrap around.
    pub(super) fn accept(&mut self, now: Instant, count: i32) -> bool {
        let is_new = self
            .0
            .is_none_or(|(last, at)| count.wrapping_sub(last) > 0 || at + Self::MEMORY <= now);
        if is_new {
            self.0 = Some((count, now));
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicates_are_refused_and_restarts_are_not() {
        let start = Instant::now();
        let mut count = LastCount::default();
        assert!(count.accept(start, i32::MAX));
        assert!(!count.accept(start, i32::MAX));
        assert!(count.accept(start, i32::MIN), "counts wrap around");
        assert!(!count.accept(start, i32::MAX));
        assert!(
            count.accept(start + LastCount::MEMORY, 1),
            "a restarted reader"
        );
    }
}
