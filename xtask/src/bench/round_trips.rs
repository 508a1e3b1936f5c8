//! Round-trip times and their summary.

use std::time::Duration;

use serde_json::{Value, json};

/// Round-trip times as they were measured.
#[derive(Debug, Default)]
pub(super) struct RoundTrips {
    nanos: Vec<u64>,
}

impl RoundTrips {
    /// Adds one.
    pub(super) fn add(&mut self, time: Duration) {
        self.nanos
            .push(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
    }

    /// As `rtps perf ping` prints it; percentiles by rank, zeros when there was none.
    pub(super) fn summary(mut self, measured: Duration, lost: u64) -> Value {
        self.nanos.sort_unstable();
        let at = |share: f64| -> f64 {
            let rank = ((self.nanos.len() as f64 * share).ceil() as usize)
                .clamp(1, self.nanos.len().max(1));
            self.nanos
                .get(rank - 1)
                .map_or(0.0, |nanos| *nanos as f64 / 1000.0)
        };
        json!({"event": "summary", "role": "ping", "count": self.nanos.len(), "lost": lost,
            "seconds": measured.as_secs_f64(), "p50_us": at(0.5), "p90_us": at(0.9), "p99_us": at(0.99),
            "p999_us": at(0.999), "max_us": at(1.0)})
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
        let summary = round_trips.summary(Duration::from_secs(1), 3);
        let figures = ["p50_us", "p90_us", "p99_us", "p999_us", "max_us", "lost"];
        let figures = figures.map(|name| summary[name].as_f64().unwrap());
        assert_eq!(figures, [100.0, 180.0, 198.0, 200.0, 200.0, 3.0]);
        let none = RoundTrips::default().summary(Duration::ZERO, 0);
        assert_eq!(none["p50_us"], 0.0);
    }
}
