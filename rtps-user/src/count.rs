//! The counts of HEARTBEATs and ACKNACKs, by which their receivers know what is old (RTPS 2.5 section 8.3.5.10).
//!
//! Endpoints of apps count by one. Those of discovery follow the time as well: the low-level layer sends in their
//! name, and so does the next run of the layer, and neither knows how far the other has counted.

use std::time::{Duration, Instant};

use rtps_ebpf::discovery::count_at;

/// The time that counts follow.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct CountClock {
    start: Instant,
    age: Duration,
}

impl CountClock {
    /// At `start` counts were `age` old.
    pub fn new(start: Instant, age: Duration) -> Self {
        Self { start, age }
    }

    /// What a count is now at least: one less than in the low-level layer, whose answers to what we have just caused
    /// must not look old.
    fn count(self, now: Instant) -> u32 {
        let age = self.age + now.saturating_duration_since(self.start);
        let nanoseconds = u64::try_from(age.as_nanos()).unwrap_or(u64::MAX);
        count_at(nanoseconds).saturating_sub(1)
    }
}

/// A count that only grows, though it may wrap around.
#[derive(Clone, Copy, Debug, Default, Eq, Ord, PartialEq, PartialOrd)]
pub(crate) struct Count(u32);

impl Count {
    /// After one that was sent before.
    pub(crate) fn after(count: i32) -> Self {
        Self(count.cast_unsigned())
    }

    /// Counts on, with the time where there is a clock.
    pub(crate) fn advance(&mut self, now: Instant, clock: Option<CountClock>) -> Self {
        let least = clock.map_or(0, |clock| clock.count(now));
        self.0 = self.0.wrapping_add(1).max(least);
        *self
    }

    /// As it stands in a submessage.
    pub(crate) fn value(self) -> i32 {
        self.0.cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_clock_counts_go_up_by_one() {
        let now = Instant::now();
        let mut count = Count::default();
        assert_eq!(count.advance(now, None).value(), 1);
        assert_eq!(count.advance(now, None).value(), 2);
        let mut last = Count::after(-1);
        assert_eq!(last.advance(now, None).value(), 0, "counts wrap around");
    }

    #[test]
    fn with_a_clock_they_follow_the_time() {
        let start = Instant::now();
        let clock = Some(CountClock::new(start, Duration::from_secs(1)));
        let mut count = Count::default();
        let first = count.advance(start, clock).value();
        assert!(first > 100);
        assert_eq!(count.advance(start, clock).value(), first + 1);
        let later = count.advance(start + Duration::from_secs(1), clock);
        assert!(later.value() > first + 100);
        let mut next_run = Count::default();
        let start = start + Duration::from_secs(60);
        let clock = CountClock::new(start, Duration::from_secs(61));
        assert!(next_run.advance(start, Some(clock)) > later);
    }
}
