//! The figures of a run, and those of several runs together.

use serde::Serialize;

/// What was measured; `None` is what does not apply to the benchmark, or what a stack's own tool does not tell.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(super) struct Figures {
    /// Round trip in microseconds: half of them took at most so long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) p50_us: Option<f64>,
    /// 90 of 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) p90_us: Option<f64>,
    /// 99 of 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) p99_us: Option<f64>,
    /// 999 of 1,000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) p999_us: Option<f64>,
    /// The slowest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max_us: Option<f64>,
    /// Samples that readers got in a second, those of all readers added up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) samples_per_s: Option<f64>,
    /// Samples that a reader missed, or round trips that did not end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) lost: Option<u64>,
    /// User, system and interrupt time of the whole machine, without what it uses at rest, for each sample that arrived.
    /// A round trip is two samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) cpu_ns_per_sample: Option<f64>,
    /// Context switches of all programs that take part, for each sample that arrived.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) switches_per_sample: Option<f64>,
    /// System calls of all programs that take part, for each sample that arrived; with several readers those of the
    /// writer alone, for each sample that it wrote.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) syscalls_per_sample: Option<f64>,
    /// Resident memory in kB of the largest program on the reading (latency: answering) side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rss_kb: Option<u64>,
    /// How often the threads of an idle app slept in a second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) wakeups_per_s: Option<f64>,
}

impl Figures {
    /// What matters most, for people who wait.
    pub(super) fn in_short(&self) -> String {
        let figures = [
            ("p50 us", self.p50_us),
            ("samples/s", self.samples_per_s),
            ("lost", self.lost.map(|lost| lost as f64)),
            ("CPU ns", self.cpu_ns_per_sample),
            ("system calls", self.syscalls_per_sample),
            ("wake-ups/s", self.wakeups_per_s),
        ];
        let figures = figures
            .iter()
            .filter_map(|(name, figure)| Some((name, (*figure)?)));
        let words: Vec<String> = figures
            .map(|(name, figure)| format!("{name} {figure:.2}"))
            .collect();
        words.join(", ")
    }

    /// The median of several runs, figure by figure; losses are added up, and memory is that of the largest.
    pub(super) fn median(runs: &[Self]) -> Self {
        let middle = |figure: fn(&Self) -> Option<f64>| median(runs.iter().filter_map(figure));
        Self {
            p50_us: middle(|run| run.p50_us),
            p90_us: middle(|run| run.p90_us),
            p99_us: middle(|run| run.p99_us),
            p999_us: middle(|run| run.p999_us),
            max_us: middle(|run| run.max_us),
            samples_per_s: middle(|run| run.samples_per_s),
            lost: runs
                .iter()
                .filter_map(|run| run.lost)
                .reduce(|sum, lost| sum + lost),
            cpu_ns_per_sample: middle(|run| run.cpu_ns_per_sample),
            switches_per_sample: middle(|run| run.switches_per_sample),
            syscalls_per_sample: middle(|run| run.syscalls_per_sample),
            rss_kb: runs.iter().filter_map(|run| run.rss_kb).max(),
            wakeups_per_s: middle(|run| run.wakeups_per_s),
        }
    }
}

/// The middle one; `None` of none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_run_by_figure() {
        let run = |p50_us, lost, rss_kb| Figures {
            p50_us,
            lost: Some(lost),
            rss_kb: Some(rss_kb),
            ..Figures::default()
        };
        let runs = [
            run(Some(3.0), 0, 10),
            run(Some(1.0), 2, 30),
            run(Some(2.0), 1, 20),
            run(None, 0, 5),
        ];
        assert_eq!(Figures::median(&runs), run(Some(2.0), 3, 30));
        assert_eq!(Figures::median(&[]), Figures::default());
    }
}
