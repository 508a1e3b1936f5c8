//! How much others may make the kernel do: rates with bursts.
//!
//! A budget's only state is the time until which it is spent (the generic cell rate algorithm): each unit
//! moves it on by the unit's share of a second, and it may run ahead of the clock by the burst.

/// A rate and a burst.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    ns_per_unit: u64,
    burst_ns: u64,
}

/// Bytes of answers to one participant: 2 MB a second, 1 MB at once.
pub const PEER: Budget = Budget::new(500, 1_000_000);
/// The same as long as it has not shown that it hears us, and may be an invention: 4 kB a second, 16 kB at once.
pub const UNPROVEN: Budget = Budget::new(250_000, 16_384);
/// Bytes of answers to all strangers: 4 MB a second, 2 MB at once.
pub const STRANGERS: Budget = Budget::new(250, 2_000_000);
/// Bytes of all answers: 16 MB a second, 8 MB at once.
pub const ALL: Budget = Budget::new(62, 8_000_000);
/// Strangers that are remembered: 1,000 a second, 2,048 at once.
pub const NEW: Budget = Budget::new(1_000_000, 2_048);
/// The same from one address: 200 a second, 1,024 at once.
pub const SOURCE: Budget = Budget::new(5_000_000, 1_024);

/// Messages of all strangers that rtpsd is given: 4,000 a second, 16,384 at once.
pub const NEWS: Budget = Budget::new(250_000, 16_384);

impl Budget {
    const fn new(ns_per_unit: u64, burst: u64) -> Self {
        Self {
            ns_per_unit,
            burst_ns: burst * ns_per_unit,
        }
    }

    /// Spends `units`, at most 2^32, at `now_ns`, where the budget is spent until `spent_until_ns`: returns until
    /// when it is then, or nothing if that is too much.
    #[inline(always)]
    pub const fn spend(&self, spent_until_ns: u64, now_ns: u64, units: u64) -> Option<u64> {
        // A time further ahead than any spending leads to was not written on this clock.
        let from = if spent_until_ns < now_ns || spent_until_ns - now_ns > self.burst_ns {
            now_ns
        } else {
            spent_until_ns
        };
        let until = from + units * self.ns_per_unit;
        if until - now_ns > self.burst_ns {
            return None;
        }
        Some(until)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    /// How many times `units` can be spent at `now_ns`.
    fn spent(budget: Budget, until: &mut u64, now_ns: u64, units: u64) -> u64 {
        let mut count = 0;
        while let Some(later) = budget.spend(*until, now_ns, units) {
            *until = later;
            count += 1;
        }
        count
    }

    #[test]
    fn a_burst_and_then_the_rate() {
        let mut until = 0;
        assert_eq!(spent(NEW, &mut until, 10 * SECOND, 1), 2_048);
        assert_eq!(spent(NEW, &mut until, 11 * SECOND, 1), 1_000);
        assert_eq!(spent(NEW, &mut until, 11 * SECOND + SECOND / 2, 1), 500);
        assert_eq!(spent(NEW, &mut until, 99 * SECOND, 1), 2_048, "no savings");
        assert_eq!(spent(PEER, &mut 0, 0, 1_000), 1_000);
        assert_eq!(spent(STRANGERS, &mut 0, 0, 1_000), 2_000);
        assert_eq!(spent(ALL, &mut 0, 0, 1_000), 8_000);
        assert_eq!(spent(SOURCE, &mut 0, 0, 1), 1_024);
    }

    #[test]
    fn what_is_too_much_spends_nothing() {
        let until = PEER.spend(0, SECOND, 999_000).unwrap();
        assert_eq!(PEER.spend(until, SECOND, 1_001), None);
        assert!(PEER.spend(until, SECOND, 1_000).is_some());
    }

    #[test]
    fn a_time_out_of_nowhere_does_not_block_for_ever() {
        assert!(PEER.spend(u64::MAX, SECOND, 1).is_some());
    }
}
