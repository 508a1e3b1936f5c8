//! The time of day, for source timestamps: a stream of samples need not read a second clock for each.

use std::time::{Duration, Instant, SystemTime};

/// The clock is read again after that; a clock that is being adjusted runs off by half a microsecond meanwhile.
const TRUSTED: Duration = Duration::from_millis(1);

/// See the module.
#[derive(Debug, Default)]
pub(super) struct WallClock {
    read: Option<(Instant, SystemTime)>,
}

impl WallClock {
    /// The time of day at `now`.
    pub(super) fn at(&mut self, now: Instant) -> SystemTime {
        if let Some((instant, time)) = self.read
            && let Some(since) = now.checked_duration_since(instant)
            && since < TRUSTED
        {
            return time + since;
        }
        let time = SystemTime::now();
        self.read = Some((now, time));
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_on_and_is_read_again() {
        let (mut clock, now) = (WallClock::default(), Instant::now());
        let time = clock.at(now);
        let later = Duration::from_micros(10);
        assert_eq!(clock.at(now + later), time + later);
        assert!(clock.at(now + Duration::from_secs(5)) < time + Duration::from_secs(4));
        assert!(clock.at(now) >= time, "a time before the last reading");
    }
}
