//! The columns of the matrix.

use anyhow::Result;

use super::course::{self, Ends};

/// What is played.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Scenario {
    BestEffort,
    Loss,
    Dispose,
    Unregister,
    LateJoiner,
    HundredKilobytes,
    FourMegabytes,
    IncompatibleQos,
    Partitions,
    Soak,
}

impl Scenario {
    pub(super) const ALL: [Self; 10] = [
        Self::BestEffort,
        Self::Loss,
        Self::Dispose,
        Self::Unregister,
        Self::LateJoiner,
        Self::HundredKilobytes,
        Self::FourMegabytes,
        Self::IncompatibleQos,
        Self::Partitions,
        Self::Soak,
    ];

    /// The head of the column.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::BestEffort => "basic",
            Self::Loss => "10 % loss",
            Self::Dispose => "dispose",
            Self::Unregister => "unregister",
            Self::LateJoiner => "late joiner",
            Self::HundredKilobytes => "100 kB",
            Self::FourMegabytes => "4 MB",
            Self::IncompatibleQos => "incompatible QoS",
            Self::Partitions => "partitions",
            Self::Soak => "3 minutes",
        }
    }

    /// What must hold for a `yes` in the column.
    pub(super) fn meaning(self) -> &'static str {
        match self {
            Self::BestEffort => "best-effort samples arrive, in order, none twice",
            Self::Loss => {
                "200 reliable samples over a link that loses every tenth packet in both directions: all arrive, in order"
            }
            Self::Dispose => "three instances are disposed, and the reader sees each of them go",
            Self::Unregister => {
                "three instances are unregistered, and the reader sees that they have no writers"
            }
            Self::LateJoiner => {
                "a reader that comes when everything is written gets the TRANSIENT_LOCAL history"
            }
            Self::HundredKilobytes => "ten reliable samples of 100,000 octets",
            Self::FourMegabytes => "three reliable samples of 4,000,000 octets",
            Self::IncompatibleQos => {
                "a best-effort writer and a reliable reader do not match, and both ends name RELIABILITY"
            }
            Self::Partitions => {
                "a reader in the writer's partition gets everything, a reader in another nothing"
            }
            Self::Soak => {
                "all vendors at once, longer than every lease: all samples arrive and nobody is forgotten"
            }
        }
    }

    /// Plays it with one peer; the soak has them all and is a test of its own.
    pub(super) fn play(self, ends: &Ends<'_>) -> Result<()> {
        match self {
            Self::BestEffort => course::best_effort(ends),
            Self::Loss => course::loss(ends),
            Self::Dispose => course::instances_end(ends, "dispose", "disposed"),
            Self::Unregister => course::instances_end(ends, "unregister", "unregistered"),
            Self::LateJoiner => course::late_joiner(ends),
            Self::HundredKilobytes => course::large(ends, 10, 100_000),
            Self::FourMegabytes => course::large(ends, 3, 4_000_000),
            Self::IncompatibleQos => course::incompatible_qos(ends),
            Self::Partitions => course::partitions(ends),
            Self::Soak => Ok(()),
        }
    }
}
