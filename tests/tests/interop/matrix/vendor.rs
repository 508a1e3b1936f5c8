//! The rows of the matrix.

use anyhow::Result;
use rtps_tests::peers::{self, Peer};

use super::Direction;
use super::scenario::Scenario;

/// Whose program the other end is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Vendor {
    Cyclone010,
    Cyclone11,
    FastDds,
    RustDds,
    DustDds,
}

impl Vendor {
    pub(super) const ALL: [Self; 5] = [
        Self::Cyclone010,
        Self::Cyclone11,
        Self::FastDds,
        Self::RustDds,
        Self::DustDds,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Cyclone010 => "Cyclone DDS 0.10",
            Self::Cyclone11 => "Cyclone DDS 11.0",
            Self::FastDds => "Fast DDS 2.9",
            Self::RustDds => "RustDDS 0.15",
            Self::DustDds => "dust_dds 0.16",
        }
    }

    pub(super) fn peer(self) -> Result<Peer> {
        match self {
            Self::Cyclone010 => peers::cyclone(),
            Self::Cyclone11 => peers::cyclone11(),
            Self::FastDds => peers::fast_dds(),
            Self::RustDds => peers::rust_dds(),
            Self::DustDds => peers::dust_dds(),
        }
    }

    /// dust_dds ends with a panic when a participant announces an IPv6 locator.
    pub(super) fn lacks_ipv6(self) -> bool {
        self == Self::DustDds
    }

    /// Why a scenario is not played with it in this direction.
    pub(super) fn lacks(self, scenario: Scenario, direction: Direction) -> Option<&'static str> {
        match (self, scenario, direction) {
            (Self::RustDds, Scenario::Unregister, _) => {
                Some("RustDDS has no operation to unregister an instance, nor tells of one")
            }
            (Self::RustDds, Scenario::Partitions, _) => Some("RustDDS has no PARTITION"),
            (Self::DustDds, Scenario::FourMegabytes, Direction::ToPeer) => Some(
                "dust_dds ends with a panic when it has to ask for more than 256 fragments of a sample, which is as soon \
                 as its socket's buffer overflows",
            ),
            _ => None,
        }
    }
}
