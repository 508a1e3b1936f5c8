//! Rounds: every case once in each, so that noise meets all cases alike.

use anyhow::Result;

use super::figures::Figures;
use super::machine::{self, Baseline};
use super::options::Options;
use super::row::{Case, Row};
use crate::interrupt;

/// How to do one run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// How long to measure.
    pub(super) seconds: f64,
    /// What the machine uses when no case is running.
    pub(super) baseline: Baseline,
    /// Count system calls, and nothing else: counting them slows them down.
    pub(super) counts_syscalls: bool,
}

/// Runs all cases in as many rounds as wanted, and each once more to count system calls. A run that fails is reported on
/// standard error and left out; a case of which all runs failed has no row.
///
/// # Errors
/// After a signal to this process.
pub(super) fn measure(
    cases: &[Case],
    options: &Options,
    mut run: impl FnMut(&Case, Run) -> Result<Figures>,
) -> Result<Vec<Row>> {
    const COUNTING: f64 = 0.3;
    let (rounds, seconds) = options.rounds();
    let mut runs: Vec<Vec<Figures>> = vec![Vec::new(); cases.len()];
    for round in 1..=rounds + 1 {
        let counts_syscalls = round > rounds;
        if counts_syscalls && !machine::counts_syscalls() {
            eprintln!("system calls are not counted: that needs perf (Debian: linux-perf)");
            break;
        }
        for (case, runs) in cases.iter().zip(&mut runs) {
            let result = Baseline::measure().and_then(|baseline| {
                let seconds = if counts_syscalls { COUNTING } else { seconds };
                let how = Run {
                    seconds,
                    baseline,
                    counts_syscalls,
                };
                run(case, how)
            });
            interrupt::check()?;
            report(round, case, &result);
            runs.extend(result);
        }
    }
    let cases = cases.iter().zip(&runs).filter(|(_, runs)| !runs.is_empty());
    Ok(cases
        .map(|(case, runs)| Row {
            case: *case,
            figures: Figures::median(runs),
        })
        .collect())
}

fn report(round: u32, case: &Case, result: &Result<Figures>) {
    let what = format!(
        "round {round}: {} {} {} B {}",
        case.bench,
        case.stack.name(),
        case.size,
        case.pinning.name()
    );
    match result {
        Ok(figures) => eprintln!("{what}: {}", figures.in_short()),
        Err(error) => eprintln!("{what}: FAILED: {error:#}"),
    }
}
