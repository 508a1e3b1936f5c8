//! How often which time span was measured, in a fixed amount of memory.

use std::time::Duration;

/// Buckets are at most 1/1024 of their value wide.
const PRECISION: u32 = 10;
const STEPS: usize = 1 << PRECISION;
/// More nanoseconds than this (69 s) count as this.
const LARGEST: u64 = (1 << 36) - 1;

/// See the module.
#[derive(Debug)]
pub(crate) struct Histogram {
    /// Of each bucket, [`STEPS`] at a time; those that no span ever came near cost no memory.
    counts: Vec<Option<Box<[u32; STEPS]>>>,
    count: u64,
    max: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            counts: vec![None; bucket(LARGEST) / STEPS + 1],
            count: 0,
            max: Duration::ZERO,
        }
    }
}

impl Histogram {
    /// Counts a time span.
    pub(crate) fn record(&mut self, span: Duration) {
        let nanos = u64::try_from(span.as_nanos()).unwrap_or(LARGEST);
        let bucket = bucket(nanos.min(LARGEST));
        let counts = self.counts[bucket / STEPS].get_or_insert_with(no_counts);
        let count = &mut counts[bucket % STEPS];
        *count = count.saturating_add(1);
        self.count += 1;
        self.max = self.max.max(span);
    }

    /// Counts all that `other` has counted, which then begins anew.
    pub(crate) fn absorb(&mut self, other: &mut Self) {
        for (own, added) in self.counts.iter_mut().zip(&mut other.counts) {
            let Some(added) = added else {
                continue;
            };
            let own = own.get_or_insert_with(no_counts);
            for (own, added) in own.iter_mut().zip(added.iter_mut()) {
                *own = own.saturating_add(std::mem::take(added));
            }
        }
        self.count += std::mem::take(&mut other.count);
        self.max = self.max.max(std::mem::take(&mut other.max));
    }

    /// How many spans were counted.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// The longest span.
    pub(crate) fn max(&self) -> Duration {
        self.max
    }

    /// What this part of all spans, 0 to 1, does not exceed; zero where there is none.
    pub(crate) fn percentile(&self, part: f64) -> Duration {
        let rank = (self.count as f64 * part).ceil().max(1.0) as u64;
        let mut seen = 0;
        let found = self.occupied().find(|(_, count)| {
            seen += u64::from(*count);
            seen >= rank
        });
        found.map_or(self.max, |(bucket, _)| {
            Duration::from_nanos(upper_end(bucket)).min(self.max)
        })
    }

    /// The buckets that have counts, and some beside them.
    fn occupied(&self) -> impl Iterator<Item = (usize, u32)> + '_ {
        let counts = (0..).zip(&self.counts);
        counts.flat_map(|(row, counts)| {
            let counts = counts.iter().flat_map(|counts| counts.iter());
            (row * STEPS..).zip(counts.copied())
        })
    }
}

fn no_counts() -> Box<[u32; STEPS]> {
    Box::new([0; STEPS])
}

/// Up to 2 * STEPS each value has a bucket, then every power of two has STEPS of them.
fn bucket(nanos: u64) -> usize {
    let shift = (u64::BITS - nanos.leading_zeros()).saturating_sub(PRECISION + 1);
    shift as usize * STEPS + (nanos >> shift) as usize
}

/// The largest value of a bucket.
fn upper_end(bucket: usize) -> u64 {
    let shift = (bucket / STEPS).saturating_sub(1);
    (((bucket - shift * STEPS + 1) as u64) << shift) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_follow_each_other_and_are_narrow() {
        let mut last = 0;
        for nanos in (0..5000).chain([1 << 20, (1 << 20) + 1024, 1 << 35, LARGEST]) {
            let bucket = bucket(nanos);
            assert!(bucket == last || bucket == last + 1 || nanos >= 5000);
            let end = upper_end(bucket);
            assert!(end >= nanos && end - nanos <= nanos / 1024, "{nanos} {end}");
            last = bucket;
        }
    }

    #[test]
    fn percentiles() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.percentile(0.5), Duration::ZERO);
        for nanos in 1..=1000 {
            histogram.record(Duration::from_nanos(nanos));
        }
        histogram.record(Duration::from_secs(100));
        assert_eq!(histogram.percentile(0.5), Duration::from_nanos(501));
        assert_eq!(histogram.percentile(0.99), Duration::from_nanos(991));
        assert_eq!(histogram.max(), Duration::from_secs(100));
        assert_eq!(histogram.count(), 1001);
    }

    #[test]
    fn what_is_absorbed_is_counted_once() {
        let (mut all, mut second) = (Histogram::default(), Histogram::default());
        second.record(Duration::from_micros(3));
        all.absorb(&mut second);
        second.record(Duration::from_micros(5));
        all.absorb(&mut second);
        assert_eq!((all.count(), second.count()), (2, 0));
        assert_eq!(all.max(), Duration::from_micros(5));
        assert_eq!(all.percentile(1.0), Duration::from_micros(5));
        assert_eq!(second.max(), Duration::ZERO);
    }
}
