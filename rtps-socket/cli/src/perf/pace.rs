//! Events at a steady rate, and the lines of once a second.

use std::time::{Duration, Instant};

/// A sleep of less is not worth it: events are due together then, and sent one after the other.
const SHORTEST_SLEEP: Duration = Duration::from_micros(100);

/// Says when the next of equally spaced events is due. Who is late catches up.
#[derive(Debug)]
pub(crate) struct Pace {
    start: Instant,
    interval: f64,
    events: u64,
}

impl Pace {
    /// Events at `rate` a second from `start` on.
    pub(crate) fn new(start: Instant, rate: f64) -> Self {
        Self {
            start,
            interval: rate.recip(),
            events: 0,
        }
    }

    /// Counts an event, and says how long to sleep before the next.
    pub(crate) fn next_after(&mut self, now: Instant) -> Option<Duration> {
        self.events += 1;
        let due = self.start + Duration::from_secs_f64(self.interval * self.events as f64);
        let sleep = due.saturating_duration_since(now);
        (sleep >= SHORTEST_SLEEP).then_some(sleep)
    }
}

/// Comes once a second.
#[derive(Debug)]
pub(crate) struct Second {
    last: Instant,
}

impl Second {
    /// The first one comes a second after `now`.
    pub(crate) fn new(now: Instant) -> Self {
        Self { last: now }
    }

    /// The seconds since it came last, if it comes now.
    pub(crate) fn elapsed(&mut self, now: Instant) -> Option<Duration> {
        let elapsed = now.saturating_duration_since(self.last);
        (elapsed >= Duration::from_secs(1)).then(|| {
            self.last = now;
            elapsed
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_late_catches_up() {
        let start = Instant::now();
        let mut pace = Pace::new(start, 100.0);
        assert_eq!(pace.next_after(start), Some(Duration::from_millis(10)));
        let late = start + Duration::from_millis(35);
        assert_eq!(pace.next_after(late), None);
        assert_eq!(pace.next_after(late), None);
        assert_eq!(pace.next_after(late), Some(Duration::from_millis(5)));
    }

    #[test]
    fn a_high_rate_comes_in_bunches() {
        let start = Instant::now();
        let mut pace = Pace::new(start, 100_000.0);
        let sleeps = std::iter::repeat_with(|| pace.next_after(start));
        assert_eq!(sleeps.take_while(Option::is_none).count(), 9);
    }
}
