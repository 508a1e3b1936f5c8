//! How often we let others make us send.

use std::time::Instant;

/// A token bucket: so many at once, and as many again in each second.
#[derive(Debug)]
pub(super) struct Budget {
    per_second: u32,
    tokens: f64,
    filled: Instant,
}

impl Budget {
    /// A full bucket.
    pub(super) fn new(now: Instant, per_second: u32) -> Self {
        Self {
            per_second,
            tokens: f64::from(per_second),
            filled: now,
        }
    }

    /// Takes one, if there is one.
    pub(super) fn take(&mut self, now: Instant) -> bool {
        let elapsed = now.saturating_duration_since(self.filled).as_secs_f64();
        let limit = f64::from(self.per_second);
        self.tokens = (self.tokens + elapsed * limit).min(limit);
        self.filled = self.filled.max(now);
        let available = self.tokens >= 1.0;
        if available {
            self.tokens -= 1.0;
        }
        available
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_bucket_empties_and_fills() {
        let now = Instant::now();
        let mut budget = Budget::new(now, 4);
        let taken = |budget: &mut Budget, at| (0..9).filter(|_| budget.take(at)).count();
        assert_eq!(taken(&mut budget, now), 4);
        assert_eq!(taken(&mut budget, now + Duration::from_millis(500)), 2);
        assert_eq!(taken(&mut budget, now + Duration::from_secs(60)), 4);
    }
}
