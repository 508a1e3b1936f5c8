//! Policies in every combination, small enough for their limits to be met.

use std::time::Duration;

use arbitrary::Arbitrary;
use rtps_user::qos::{
    Deadline, DestinationOrder, Durability, History, Lifespan, Ownership, Presentation,
    PresentationScope, Qos, ReaderDataLifecycle, Reliability, ResourceLimits, TimeBasedFilter,
};
use rtps_user::wire;

/// Of RESOURCE_LIMITS.
pub const MOST_SAMPLES: u32 = 16;

/// What is varied of a [`Qos`].
#[derive(Arbitrary, Clone, Copy, Debug)]
pub struct Policies {
    is_reliable: bool,
    is_transient_local: bool,
    is_unlimited: bool,
    depth: Option<u8>,
    scope: u8,
    is_coherent: bool,
    is_by_source: bool,
    strength: Option<i8>,
    deadline: Option<u8>,
    lifespan: Option<u8>,
    separation: Option<u8>,
    purge_delay: Option<u8>,
}

impl Policies {
    /// Whether a reader shows the samples of each writer as they were written, one after the other.
    pub fn keeps_order(&self) -> bool {
        !self.is_coherent && !self.is_by_source && self.strength.is_none()
    }

    /// The policies; a writer and a reader with the same ones match.
    pub fn qos(&self) -> Qos {
        let purge_delay = of_milliseconds(self.purge_delay);
        Qos {
            reliability: match self.is_reliable {
                true => Reliability::RELIABLE,
                false => Reliability::BestEffort,
            },
            durability: match self.is_transient_local {
                true => Durability::TransientLocal,
                false => Durability::Volatile,
            },
            history: match self.depth {
                Some(depth) => History::KeepLast(u32::from(depth % 8) + 1),
                None => History::KeepAll,
            },
            resource_limits: ResourceLimits {
                max_samples: (!self.is_unlimited).then_some(MOST_SAMPLES),
                ..ResourceLimits::default()
            },
            presentation: Presentation {
                scope: match self.scope % 3 {
                    0 => PresentationScope::Instance,
                    1 => PresentationScope::Topic,
                    _ => PresentationScope::Group,
                },
                coherent: self.is_coherent,
                ordered: false,
            },
            destination_order: match self.is_by_source {
                true => DestinationOrder::BySourceTimestamp,
                false => DestinationOrder::ByReceptionTimestamp,
            },
            ownership: self.strength.map_or(Ownership::Shared, |strength| {
                let strength = strength.into();
                Ownership::Exclusive { strength }
            }),
            deadline: Deadline(of_milliseconds(self.deadline)),
            lifespan: Lifespan(of_milliseconds(self.lifespan)),
            time_based_filter: TimeBasedFilter(match self.separation {
                None => wire::Duration::from_std(Duration::ZERO),
                separation => of_milliseconds(separation),
            }),
            reader_data_lifecycle: ReaderDataLifecycle {
                autopurge_nowriter_samples_delay: purge_delay,
                autopurge_disposed_samples_delay: purge_delay,
            },
            ..Qos::default()
        }
    }

    /// Whether RESOURCE_LIMITS hold.
    pub fn is_limited(&self) -> bool {
        !self.is_unlimited
    }
}

fn of_milliseconds(milliseconds: Option<u8>) -> wire::Duration {
    let of =
        |milliseconds: u8| wire::Duration::from_std(Duration::from_millis(milliseconds.into()));
    milliseconds.map_or(wire::Duration::INFINITE, of)
}
