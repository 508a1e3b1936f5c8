//! What the benchmarks have in common on the command line.

use std::path::PathBuf;

use clap::Args;
use rtps_tests::binaries;

use super::row::{Pinning, Stack};

/// How to measure, and what to leave out.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Options {
    /// Print a JSON array of rows as the last line instead of tables.
    #[arg(long)]
    pub(super) json: bool,
    /// Seconds of measurement for each case, all rounds together; a round takes some seconds more.
    #[arg(long, default_value_t = 5.0)]
    pub(super) seconds: f64,
    /// How often each case is measured.
    #[arg(long, default_value_t = 5)]
    pub(super) rounds: u32,
    /// One short round: shows that all works, and nothing else.
    #[arg(long)]
    pub(super) quick: bool,
    /// Only these stacks; may be given several times.
    #[arg(long = "stack", value_enum)]
    stacks: Vec<Stack>,
    /// Only these pinnings; may be given several times.
    #[arg(long = "pinning", value_enum)]
    pinnings: Vec<Pinning>,
    /// Only these sizes, in bytes; may be given several times.
    #[arg(long = "size")]
    sizes: Vec<usize>,
    /// Draw the rows into this SVG file.
    #[arg(long)]
    pub(super) picture: Option<PathBuf>,
}

impl Options {
    /// The same, with the picture in docs/ unless another was wanted; a quick run has nothing to show.
    pub(super) fn with_picture(&self) -> Self {
        let usual = || (!self.quick).then(|| binaries::workspace().join("docs/bench.svg"));
        Self {
            picture: self.picture.clone().or_else(usual),
            ..self.clone()
        }
    }

    /// Whether a stack was asked for.
    pub(super) fn wants(&self, stack: Stack) -> bool {
        self.stacks.is_empty() || self.stacks.contains(&stack)
    }

    /// The sizes that were asked for, or the usual ones of a benchmark.
    pub(super) fn sizes_or<'a>(&'a self, usual: &'a [usize]) -> &'a [usize] {
        match self.sizes.as_slice() {
            [] => usual,
            wanted => wanted,
        }
    }

    /// The pinnings that were asked for, or the usual ones of a benchmark.
    pub(super) fn pinnings_or<'a>(&'a self, usual: &'a [Pinning]) -> &'a [Pinning] {
        match self.pinnings.as_slice() {
            [] => usual,
            wanted => wanted,
        }
    }

    /// Rounds, and the seconds of measurement in each.
    pub(super) fn rounds(&self) -> (u32, f64) {
        const QUICK: f64 = 0.5;
        match self.quick {
            true => (1, QUICK),
            false => {
                let rounds = self.rounds.max(1);
                (rounds, self.seconds / f64::from(rounds))
            }
        }
    }
}
