//! What is measured, and the rows that come of it.

use clap::ValueEnum;
use serde::Serialize;

use super::figures::Figures;

/// Who carries the samples.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Stack {
    /// Ours on the kernel layer, blocking.
    Kernel,
    /// Ours on the kernel layer, the waiting thread spinning.
    KernelSpin,
    /// Ours on the in-process layer.
    InProcess,
    /// Plain UDP sockets, blocking.
    Udp,
    /// Plain UDP sockets, spinning.
    UdpSpin,
    /// Cyclone DDS, by its own ddsperf.
    Cyclone,
    /// Fast DDS.
    Fastdds,
    /// RustDDS.
    Rustdds,
}

/// Which CPUs the programs may use.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Pinning {
    /// All share the first one.
    OneCpu,
    /// The one that starts has the first, all others the second.
    TwoCpus,
    /// Where the scheduler puts them.
    Free,
}

/// What is measured in one run.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
pub(super) struct Case {
    pub(super) bench: &'static str,
    pub(super) stack: Stack,
    /// Bytes of a sample, as ddsperf counts them: without the encapsulation header.
    pub(super) size: usize,
    pub(super) pinning: Pinning,
    pub(super) readers: usize,
}

/// A case and its figures, the medians of all rounds.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Row {
    #[serde(flatten)]
    pub(super) case: Case,
    #[serde(flatten)]
    pub(super) figures: Figures,
}

impl Stack {
    /// Whether the hosts need the kernel layer.
    pub(super) fn is_on_kernel_layer(self) -> bool {
        matches!(self, Self::Kernel | Self::KernelSpin)
    }

    /// As RTPS_LAYER and `--layer` take it, where the stack is ours.
    pub(super) fn layer(self) -> &'static str {
        match self.is_on_kernel_layer() {
            true => "kernel",
            false => "in-process",
        }
    }

    /// Whether whoever waits keeps its CPU.
    pub(super) fn spins(self) -> bool {
        matches!(self, Self::KernelSpin | Self::UdpSpin)
    }

    /// As in JSON.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::KernelSpin => "kernel-spin",
            Self::InProcess => "in-process",
            Self::Udp => "udp",
            Self::UdpSpin => "udp-spin",
            Self::Cyclone => "cyclone",
            Self::Fastdds => "fastdds",
            Self::Rustdds => "rustdds",
        }
    }
}

impl Pinning {
    /// As in JSON.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::OneCpu => "one-cpu",
            Self::TwoCpus => "two-cpus",
            Self::Free => "free",
        }
    }

    /// The CPU of the program that starts the exchange; `None`: any.
    pub(super) fn of_active(self) -> Option<usize> {
        match self {
            Self::OneCpu | Self::TwoCpus => Some(0),
            Self::Free => None,
        }
    }

    /// The CPU of the others; `None`: any.
    pub(super) fn of_passive(self) -> Option<usize> {
        match self {
            Self::OneCpu => Some(0),
            Self::TwoCpus => Some(1),
            Self::Free => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_row_is_one_flat_object_without_what_does_not_apply() {
        let row = Row {
            case: Case {
                bench: "throughput",
                stack: Stack::KernelSpin,
                size: 100,
                pinning: Pinning::TwoCpus,
                readers: 1,
            },
            figures: Figures {
                samples_per_s: Some(5.0),
                lost: Some(0),
                ..Figures::default()
            },
        };
        assert_eq!(
            serde_json::to_value(row).unwrap(),
            json!({"bench": "throughput", "stack": "kernel-spin", "size": 100, "pinning": "two-cpus", "readers": 1,
                "samples_per_s": 5.0, "lost": 0})
        );
    }

    #[test]
    fn names_are_those_of_json() {
        for stack in Stack::value_variants() {
            assert_eq!(serde_json::to_value(stack).unwrap(), stack.name());
        }
        for pinning in Pinning::value_variants() {
            assert_eq!(serde_json::to_value(pinning).unwrap(), pinning.name());
        }
    }
}
