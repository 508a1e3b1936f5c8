//! What Cyclone DDS's ddsperf prints, a line a second, read as figures.
//!
//! It prints half of a round trip; what is told here is the whole. Percentiles are those of one second each, of which the
//! middle second counts. The first line is about a second in which discovery went on and is left out.

use anyhow::{Context, Result};

use super::figures::{Figures, median};
use super::program::Outcome;

/// In lines of `ddsperf ping` with figures.
const ROUND_TRIPS: &str = " mean ";
/// In lines of `ddsperf sub` with figures.
const SAMPLES: &str = " rate ";

/// How many lines hold figures of a second.
pub(super) fn statistics(text: &str) -> usize {
    let lines = text.lines();
    lines
        .filter(|line| line.contains(ROUND_TRIPS) || line.contains(SAMPLES))
        .count()
}

/// The round trips that `ddsperf ping` has told of.
pub(super) fn round_trips(text: &str) -> Result<Outcome> {
    let lines: Vec<Line<'_>> = text.lines().filter_map(Line::of_round_trips).collect();
    let lines = lines.get(1..).filter(|lines| !lines.is_empty());
    let lines = lines.context("ddsperf told of no round trips")?;
    let whole = |name: &'static str| {
        median(lines.iter().filter_map(move |line| line.after(name))).map(|half| 2.0 * half)
    };
    let a_second = median(lines.iter().filter_map(|line| line.after("cnt")));
    Ok(Outcome {
        figures: Figures {
            p50_us: whole("50%"),
            p90_us: whole("90%"),
            p99_us: whole("99%"),
            max_us: whole("max"),
            ..Figures::default()
        },
        samples_per_s: 2.0 * a_second.context("ddsperf did not count its round trips")?,
    })
}

/// The samples that `ddsperf sub` has told of in `steady`, what it had printed before its writer ended; the losses are
/// those of all that it printed.
pub(super) fn samples(steady: &str, all: &str) -> Result<Outcome> {
    let lines: Vec<Line<'_>> = steady.lines().filter_map(Line::of_samples).collect();
    let (Some(first), Some(last), true) = (lines.first(), lines.last(), lines.len() > 1) else {
        anyhow::bail!("ddsperf told of no samples");
    };
    let between = |name| Some(last.after(name)? - first.after(name)?);
    let seconds = last.time().zip(first.time()).map(|(to, from)| to - from);
    let samples = between("total")
        .zip(seconds)
        .context("ddsperf's line has another form")?;
    let lost = all.lines().filter_map(Line::of_samples).next_back();
    let lost = lost.and_then(|line| line.after("lost"));
    let samples_per_s = samples.0 / samples.1;
    Ok(Outcome {
        figures: Figures {
            samples_per_s: Some(samples_per_s),
            lost: lost.map(|lost| lost as u64),
            ..Figures::default()
        },
        samples_per_s,
    })
}

/// The words of a line like `[4711] 2.000  host:4712 size 100 mean 4.1us min 3.6us 50% 3.8us ... cnt 117991`.
struct Line<'a>(Vec<&'a str>);

impl<'a> Line<'a> {
    fn of_round_trips(line: &'a str) -> Option<Self> {
        Self::with(line, ROUND_TRIPS)
    }

    fn of_samples(line: &'a str) -> Option<Self> {
        Self::with(line, SAMPLES)
    }

    fn with(line: &'a str, mark: &str) -> Option<Self> {
        line.contains(mark)
            .then(|| Self(line.split_whitespace().collect()))
    }

    /// Seconds since ddsperf was started.
    fn time(&self) -> Option<f64> {
        self.0.get(1)?.parse().ok()
    }

    /// The number behind the first word of this name, its unit left out.
    fn after(&self, name: &str) -> Option<f64> {
        let at = self.0.iter().position(|word| *word == name)?;
        self.0.get(at + 1)?.trim_end_matches("us").parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PING: &str = "\
[9] participant vm:9: new (self)
[9] 2.000  vm:8 size 100 mean 9.1us min 9.6us 50% 9.8us 90% 9.0us 99% 9.4us max 9724.2us cnt 9
[9] 2.000  rss:7.6MB vcsw:51236 ivcsw:67037 recvUC:19%+26%
[9] 3.000  vm:8 size 100 mean 4.096us min 3.653us 50% 3.500us 90% 4.000us 99% 4.250us max 2464.500us cnt 120904
";
    const SUB: &str = "\
[9] 1.000  size 100 total 1000 lost 0 delta 1000 lost 0 rate 1.00 kS/s 0.80 Mb/s (91.73 kS/s 73.38 Mb/s)
[9] 3.000  size 100 total 5000 lost 2 delta 4000 lost 2 rate 2.00 kS/s 1.60 Mb/s (180.61 kS/s 144.49 Mb/s)
";

    #[test]
    fn halves_become_round_trips() {
        let outcome = round_trips(PING).unwrap();
        assert_eq!(outcome.samples_per_s, 241_808.0);
        assert_eq!(
            outcome.figures,
            Figures {
                p50_us: Some(7.0),
                p90_us: Some(8.0),
                p99_us: Some(8.5),
                max_us: Some(4929.0),
                ..Figures::default()
            }
        );
    }

    #[test]
    fn a_rate_needs_two_lines() {
        let rest = "[9] 4.000  size 100 total 5010 lost 3 delta 10 lost 1 rate 0.01 kS/s 0.80 Mb/s (1 kS/s 1 Mb/s)\n";
        let outcome = samples(SUB, &format!("{SUB}{rest}")).unwrap();
        assert_eq!(outcome.samples_per_s, 2000.0);
        assert_eq!(outcome.figures.lost, Some(3));
        let first = SUB.lines().next().unwrap();
        assert!(samples(first, SUB).is_err() && round_trips("").is_err());
    }
}
