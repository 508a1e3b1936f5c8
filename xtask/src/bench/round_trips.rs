//! Round-trip times and their summary.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Round-trip times as they were measured.
#[derive(Debug, Default)]
pub(crate) struct RoundTrips {
    nanos: Vec<u64>,
}

/// What a run says of its round trips; also what the latency example of rtps-socket prints.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// Round trips.
    pub(crate) count: u64,
    /// Half of them took at most so many microseconds.
    pub(crate) p50_us: f64,
    /// 99 of 100 took at most so many microseconds.
    pub(crate) p99_us: f64,
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
            p99_us: at(0.99),
            max_us: at(1.0),
        }
    }
}

impl Summary {
    /// The median of several runs, figure by figure; the counts are added up.
    pub(crate) fn median(runs: &[Self]) -> Option<Self> {
        let middle = |figure: fn(&Self) -> f64| -> Option<f64> {
            let mut figures: Vec<f64> = runs.iter().map(figure).collect();
            figures.sort_by(f64::total_cmp);
            figures.get(figures.len() / 2).copied()
        };
        Some(Self {
            count: runs.iter().map(|run| run.count).sum(),
            p50_us: middle(|run| run.p50_us)?,
            p99_us: middle(|run| run.p99_us)?,
            max_us: middle(|run| run.max_us)?,
        })
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
                p99_us: 198.0,
                max_us: 200.0
            }
        );
        assert_eq!(RoundTrips::default().summary().p50_us, 0.0);
    }

    #[test]
    fn the_median_run_by_figure() {
        let run = |p50_us: f64, max_us: f64| Summary {
            count: 1,
            p50_us,
            p99_us: 0.0,
            max_us,
        };
        let median = Summary::median(&[run(3.0, 10.0), run(1.0, 30.0), run(2.0, 20.0)]);
        assert_eq!(
            median,
            Some(Summary {
                count: 3,
                p50_us: 2.0,
                p99_us: 0.0,
                max_us: 20.0
            })
        );
        assert_eq!(Summary::median(&[]), None);
    }
}
