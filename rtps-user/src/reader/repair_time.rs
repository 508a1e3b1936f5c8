//! How long the repairs of one writer take, from the request until the last of them has come; estimated as TCP
//! estimates its retransmission timeout (RFC 6298), so that what gets lost again is soon asked for again, and what
//! is only slow is not.

use std::time::Duration;

/// Below that the time when a reader gets to run says more than the network.
const LEAST_MARGIN: Duration = Duration::from_millis(1);

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RepairTime {
    estimate: Option<Estimate>,
}

#[derive(Clone, Copy, Debug)]
struct Estimate {
    smoothed: Duration,
    deviation: Duration,
}

impl RepairTime {
    /// Repairs that were asked for together took so long.
    pub(super) fn measured(&mut self, took: Duration) {
        self.estimate = Some(match self.estimate {
            None => Estimate {
                smoothed: took,
                deviation: took / 2,
            },
            Some(Estimate {
                smoothed,
                deviation,
            }) => Estimate {
                smoothed: (7 * smoothed + took) / 8,
                deviation: (3 * deviation + took.abs_diff(smoothed)) / 4,
            },
        });
    }

    /// After what time repairs count as lost: `most` at the most, and where nothing is known.
    pub(super) fn patience(&self, most: Duration) -> Duration {
        let patience = self
            .estimate
            .map(|known| known.smoothed + (4 * known.deviation).max(LEAST_MARGIN));
        patience.map_or(most, |patience| patience.min(most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: Duration = Duration::from_millis(1);
    const MOST: Duration = Duration::from_millis(20);

    #[test]
    fn patience_follows_what_is_measured() {
        let mut time = RepairTime::default();
        assert_eq!(time.patience(MOST), MOST);
        time.measured(2 * MILLISECOND);
        assert_eq!(time.patience(MOST), 6 * MILLISECOND);
        for _ in 0..50 {
            time.measured(2 * MILLISECOND);
        }
        let patience = time.patience(MOST);
        assert!(
            patience >= 3 * MILLISECOND && patience < 4 * MILLISECOND,
            "{patience:?}"
        );
        time.measured(Duration::from_secs(1));
        assert_eq!(time.patience(MOST), MOST);
    }
}
