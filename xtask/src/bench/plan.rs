//! The cases of a benchmark: every stack in every pinning with every size.

use super::options::Options;
use super::row::{Case, Pinning, Stack};

/// What a benchmark measures unless the command line says otherwise.
pub(super) struct Plan {
    pub(super) bench: &'static str,
    pub(super) stacks: &'static [Stack],
    pub(super) pinnings: &'static [Pinning],
    /// Bytes of a sample.
    pub(super) sizes: &'static [usize],
    pub(super) readers: usize,
}

impl Plan {
    /// Those that were asked for. Neighbours differ in the stack alone, so that what is compared is measured soon after
    /// one another.
    pub(super) fn cases(&self, options: &Options) -> Vec<Case> {
        let mut cases = Vec::new();
        for &size in options.sizes_or(self.sizes) {
            for &pinning in options.pinnings_or(self.pinnings) {
                let stacks = self.stacks.iter().filter(|stack| options.wants(**stack));
                let stacks = stacks.filter(|stack| is_sensible(**stack, pinning));
                cases.extend(stacks.map(|&stack| Case {
                    bench: self.bench,
                    stack,
                    size,
                    pinning,
                    readers: self.readers,
                }));
            }
        }
        cases
    }
}

/// Whoever spins needs a CPU of its own.
fn is_sensible(stack: Stack, pinning: Pinning) -> bool {
    !(stack.spins() && pinning == Pinning::OneCpu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stacks_of_one_size_and_pinning_are_neighbours() {
        let plan = Plan {
            bench: "latency",
            stacks: &[Stack::UdpSpin, Stack::Kernel],
            pinnings: &[Pinning::OneCpu, Pinning::TwoCpus],
            sizes: &[1, 2],
            readers: 1,
        };
        let cases = plan.cases(&Options::default());
        let cases = cases
            .iter()
            .map(|case| (case.size, case.pinning, case.stack));
        assert_eq!(
            cases.take(4).collect::<Vec<_>>(),
            [
                (1, Pinning::OneCpu, Stack::Kernel),
                (1, Pinning::TwoCpus, Stack::UdpSpin),
                (1, Pinning::TwoCpus, Stack::Kernel),
                (2, Pinning::OneCpu, Stack::Kernel),
            ]
        );
    }
}
