//! What tells the kernel that rtpsd lives, so that it may answer in its name.
//!
//! A dead host must not look alive for long: without a new sign the kernel stops answering after half a lease.

use std::time::{Duration, Instant};

use rtps_ebpf::abi::{Config, DISCOVERY_KERNEL};

use crate::kernel_maps::nanoseconds;

/// The time between two signs, and the shortest one, in parts of the lease: what is due soon is done with what is due
/// now, to wake less often.
const PERIOD: u32 = 8;
const SHORTEST: u32 = 16;

/// Says when a sign is due, and what it is.
pub(crate) struct SignOfLife {
    config: Config,
    lease: Duration,
    given: Option<Instant>,
}

impl SignOfLife {
    /// The first sign is what lets the programs act by `config`.
    pub(crate) fn new(config: Config, lease: Duration) -> Self {
        Self {
            config,
            lease,
            given: None,
        }
    }

    /// What is to be written to the map `config` now; nothing while the last sign is young. `monotonic` is now as the
    /// programs know it.
    pub(crate) fn give(&mut self, now: Instant, monotonic: Duration) -> Option<Config> {
        let is_wanted = match self.given {
            None => true,
            Some(given) => self.repeats() && now >= given + self.lease / SHORTEST,
        };
        if !is_wanted {
            return None;
        }
        self.given = Some(now);
        if self.repeats() {
            self.config.answer_until_ns = nanoseconds(monotonic + self.lease / 2);
        }
        Some(self.config)
    }

    /// When a sign is due.
    pub(crate) fn due(&self) -> Option<Instant> {
        let given = self.given.filter(|_| self.repeats())?;
        Some(given + self.lease / PERIOD)
    }

    /// What is to be written to the map `config` before rtpsd ends: the kernel falls silent.
    pub(crate) fn last(&self) -> Config {
        Config {
            answer_until_ns: 0,
            ..self.config
        }
    }

    fn repeats(&self) -> bool {
        self.config.discovery == DISCOVERY_KERNEL
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rtps_ebpf::abi::DISCOVERY_USER;

    const LEASE: Duration = Duration::from_secs(16);
    const MONOTONIC: Duration = Duration::from_secs(100);

    fn signs(discovery: u32) -> SignOfLife {
        let config = Config {
            abi_version: 7,
            discovery,
            ..Config::default()
        };
        SignOfLife::new(config, LEASE)
    }

    #[test]
    fn each_sign_is_good_for_half_a_lease_and_renewed_much_earlier() {
        let (mut life, start) = (signs(DISCOVERY_KERNEL), Instant::now());
        assert_eq!(life.due(), None);
        let first = life.give(start, MONOTONIC).unwrap();
        assert_eq!(
            (first.abi_version, first.answer_until_ns),
            (7, 108 * 1_000_000_000)
        );
        assert_eq!(life.due(), Some(start + LEASE / 8));
        let (early, soon) = (start + LEASE / 17, start + LEASE / 16);
        assert_eq!(life.give(early, MONOTONIC), None);
        assert!(life.give(soon, MONOTONIC).is_some());
        assert_eq!(life.due(), Some(soon + LEASE / 8));
        assert_eq!(life.last().answer_until_ns, 0);
    }

    #[test]
    fn where_only_rtpsd_answers_the_kernel_is_told_once() {
        let (mut life, start) = (signs(DISCOVERY_USER), Instant::now());
        assert_eq!(life.give(start, MONOTONIC).unwrap().answer_until_ns, 0);
        assert_eq!(life.due(), None);
        assert_eq!(life.give(start + LEASE, MONOTONIC), None);
    }
}
