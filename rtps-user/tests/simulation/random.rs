//! Reproducible randomness (splitmix64).

use std::ops::Range;
use std::time::Duration;

/// The seeds of a test's runs: `runs` of them, or as many times more as SIMULATION_FACTOR says.
pub(crate) fn seeds(runs: u64) -> Range<u64> {
    let factor = std::env::var("SIMULATION_FACTOR");
    let factor = factor.map_or(1, |factor| factor.parse().expect("a number"));
    0..runs * factor
}

/// A stream of numbers that its seed determines.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    /// True in so many per cent of the cases.
    pub(crate) fn percent(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    /// A time span up to `max`.
    pub(crate) fn up_to(&mut self, max: Duration) -> Duration {
        Duration::from_nanos(self.below(max.as_nanos() as u64 + 1))
    }
}
