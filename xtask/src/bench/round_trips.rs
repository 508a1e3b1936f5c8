//! Round-trip times and their summary.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Round-trip times as they were measured.
#[derive(Debug, Default)]
pub(crate) struct RoundTrips {
    nanos: Vec<u64>,
}

/// What a run says of its round trips.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// Round trips.
    pub(crate) count: u64,
    /// Half of them took at most so many microseconds.
    pub(crate) p50_us: f64,
    /// 90 of 100 took at most so many microseconds.
    pub(crate) p90_us: f64,
    /// 99 of 100 took at most so many microseconds.
    pub(crate) p99_us: f64,
    /// 999 of 1,000 took at most so many microseconds.
    pub(crate) p999_us: f64,
    /// The slowest, in microseconds.
    pub(crate) max_us: f64,
}

impl RoundTrips {
    /// Adds one.
    pub(crate) fn add(&mut self, time: Duration) {
        self.nanos
            .push(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
    }

    /// Percentiles by rank; zeros when there was none.
    pub(crate) fn summary(mut self) -> Summary {
        self.nanos.sort_unstable();
        let at = |share: f64| -> f64 {
            let rank = ((self.nanos.len() as f64 * share).ceil() as usize)
                .clamp(1, self.nanos.len().max(1));
            self.nanos
                .get(rank - 1)
                .map_or(0.0, |nanos| *nanos as f64 / 1000.0)
        };
        Summary {
            count: self.nanos.len() as u64,
            p50_us: at(0.5),
            p90_us: at(0.9),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: at(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_by_rank() {
        let mut round_trips = RoundTrips::default();
        (1..=200)
            .rev()
            .for_each(|micros| round_trips.add(Duration::from_micros(micros)));
        let summary = round_trips.summary();
        assert_eq!(
            summary,
            Summary {
                count: 200,
                p50_us: 100.0,
                p90_us: 180.0,
                p99_us: 198.0,
                p999_us: 200.0,
                max_us: 200.0
            }
        );
        assert_eq!(RoundTrips::default().summary().p50_us, 0.0);
    }
}
