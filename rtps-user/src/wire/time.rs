//! Time on the wire: seconds and a binary fraction (RTPS 2.5 sections 9.3.2.1 and 9.3.2.3).

use serde::{Deserialize, Serialize};

use super::{Cursor, WireError};

/// 2^-32 seconds to nanoseconds, rounded to the nearest.
fn fraction_to_nanos(fraction: u32) -> u32 {
    ((u64::from(fraction) * 1_000_000_000 + (1 << 31)) >> 32).min(999_999_999) as u32
}

/// Nanoseconds to 2^-32 seconds, rounded up so that nanoseconds survive a round trip.
fn nanos_to_fraction(nanos: u32) -> u32 {
    ((u64::from(nanos) << 32).div_ceil(1_000_000_000)) as u32
}

/// A duration as QoS policies carry it: seconds and 2^-32 seconds.
#[derive(
    Clone, Copy, Debug, Default, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize,
)]
pub struct Duration {
    /// Whole seconds.
    pub seconds: i32,
    /// 2^-32 seconds.
    pub fraction: u32,
}

impl Duration {
    /// DURATION_ZERO.
    pub const ZERO: Self = Self {
        seconds: 0,
        fraction: 0,
    };
    /// DURATION_INFINITE.
    pub const INFINITE: Self = Self {
        seconds: i32::MAX,
        fraction: u32::MAX,
    };

    /// Whether it never ends. Vendors write the fraction of an infinite duration differently, so seconds decide.
    pub fn is_infinite(self) -> bool {
        self.seconds == i32::MAX
    }

    /// As a time span of the standard library; `None` when infinite. Negative durations count as zero.
    pub fn to_std(self) -> Option<std::time::Duration> {
        if self.is_infinite() {
            return None;
        }
        let Ok(seconds) = u64::try_from(self.seconds) else {
            return Some(std::time::Duration::ZERO);
        };
        Some(std::time::Duration::new(
            seconds,
            fraction_to_nanos(self.fraction),
        ))
    }

    /// From a time span of the standard library; infinite where it exceeds 2^31 - 2 seconds.
    pub fn from_std(duration: std::time::Duration) -> Self {
        match i32::try_from(duration.as_secs()) {
            Ok(seconds) if seconds < i32::MAX => Self {
                seconds,
                fraction: nanos_to_fraction(duration.subsec_nanos()),
            },
            _ => Self::INFINITE,
        }
    }

    /// Reads seconds and fraction.
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        Ok(Self {
            seconds: cursor.i32()?,
            fraction: cursor.u32()?,
        })
    }

    /// Writes seconds and fraction, little endian.
    pub fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.seconds.to_le_bytes());
        out.extend_from_slice(&self.fraction.to_le_bytes());
    }
}

/// A point in time since 1970: seconds and 2^-32 seconds.
#[derive(
    Clone, Copy, Debug, Default, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize,
)]
pub struct Timestamp {
    /// Seconds since 1970-01-01.
    pub seconds: u32,
    /// 2^-32 seconds.
    pub fraction: u32,
}

impl Timestamp {
    /// From the time since 1970-01-01; wraps in 2106 as the wire format does.
    pub fn from_unix(since_epoch: std::time::Duration) -> Self {
        Self {
            seconds: since_epoch.as_secs() as u32,
            fraction: nanos_to_fraction(since_epoch.subsec_nanos()),
        }
    }

    /// The time since 1970-01-01.
    pub fn to_unix(self) -> std::time::Duration {
        std::time::Duration::new(u64::from(self.seconds), fraction_to_nanos(self.fraction))
    }

    /// Reads seconds and fraction.
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        Ok(Self {
            seconds: cursor.u32()?,
            fraction: cursor.u32()?,
        })
    }

    /// Writes seconds and fraction, little endian.
    pub fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.seconds.to_le_bytes());
        out.extend_from_slice(&self.fraction.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nanoseconds_survive(seconds in 0..i32::MAX as u64, nanos in 0..1_000_000_000u32) {
            let span = std::time::Duration::new(seconds, nanos);
            prop_assert_eq!(Duration::from_std(span).to_std(), Some(span));
            prop_assert_eq!(Timestamp::from_unix(span).to_unix(), span);
        }
    }

    #[test]
    fn odd_durations() {
        assert_eq!(Duration::INFINITE.to_std(), None);
        assert_eq!(
            Duration {
                seconds: i32::MAX,
                fraction: 0
            }
            .to_std(),
            None
        );
        assert_eq!(
            Duration {
                seconds: -5,
                fraction: 7
            }
            .to_std(),
            Some(std::time::Duration::ZERO)
        );
        assert_eq!(
            Duration {
                seconds: 0,
                fraction: u32::MAX
            }
            .to_std(),
            Some(std::time::Duration::from_nanos(999_999_999))
        );
        assert!(Duration::from_std(std::time::Duration::MAX).is_infinite());
    }
}
