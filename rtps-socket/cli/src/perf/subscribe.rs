//! `rtps perf sub`: counts data, and what is missing of it.

use std::time::{Duration, Instant};

use anyhow::Result;
use clap::Args;
use rtps_socket::{Guid, RawSample, Selection};

use super::options::{Options, Period};
use super::pace::Second;
use super::report::{Received, Report, per_second};
use super::session::{Flow, Session};
use crate::stop;

/// Samples taken by one call.
const BATCH: usize = 128;
/// How long there is no look at signals and the time.
const LOOK: Duration = Duration::from_millis(100);

/// The options of the role.
#[derive(Args, Debug)]
pub(crate) struct Subscribe {
    #[command(flatten)]
    options: Options,
    /// Keep the last N samples instead of all, as ddsperf's -k.
    #[arg(short = 'k', long, value_name = "N")]
    keep_last: Option<u32>,
    /// Begin when so many writers are matched.
    #[arg(long, default_value_t = 1)]
    peers: usize,
}

impl Subscribe {
    /// Subscribes until the time is over, which begins with the first sample.
    pub(crate) fn run(self) -> Result<()> {
        let report = Report::new("sub", self.options.json);
        let session = Session::open(&self.options, self.keep_last)?;
        let reader = session.reader(Flow::Data, None)?;
        let mut tally = Tally::new(&self.options);
        let is_matched = || reader.wait_for_matched(self.peers, LOOK).is_ok();
        while !is_matched() {
            if stop::requested() {
                report.summary(tally.counts.figures(tally.time()));
                return Ok(());
            }
        }
        report.ready();
        let mut second = Second::new(Instant::now());
        let mut reported = Counts::default();
        let all = Selection::default();
        loop {
            let samples = reader.take(BATCH, &all);
            tally.count(&samples);
            let now = Instant::now();
            if tally.is_over(now) {
                report.summary(tally.counts.figures(tally.time()));
                return Ok(());
            }
            if let Some(time) = second.elapsed(now) {
                report.second(tally.counts.since(reported).figures(time));
                reported = tally.counts;
            }
            if samples.is_empty() {
                reader.wait(LOOK);
            }
        }
    }
}

/// What has come from whom.
struct Tally {
    options: Options,
    /// From the first sample on.
    period: Option<Period>,
    expected: Expected,
    counts: Counts,
    /// The arrival of the first and the last sample that counts.
    span: Option<(Instant, Instant)>,
}

/// The number that is next, of each writer.
#[derive(Debug, Default)]
struct Expected(Vec<(Guid, u32)>);

#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
struct Counts {
    count: u64,
    lost: u64,
    bytes: u64,
}

impl Tally {
    fn new(options: &Options) -> Self {
        Self {
            options: options.clone(),
            period: None,
            expected: Expected::default(),
            counts: Counts::default(),
            span: None,
        }
    }

    fn count(&mut self, samples: &[RawSample]) {
        for sample in samples.iter().filter(|sample| sample.info.valid_data) {
            let Some(contents) = self.options.topic.read(&sample.payload) else {
                continue;
            };
            let lost = self
                .expected
                .missing_before(sample.info.writer, contents.seq);
            let arrival = sample.info.reception;
            let period = self
                .period
                .get_or_insert_with(|| self.options.period(arrival));
            if arrival < period.start {
                continue;
            }
            self.counts.count += 1;
            self.counts.lost += u64::from(lost);
            self.counts.bytes += u64::from(contents.size);
            self.span.get_or_insert((arrival, arrival)).1 = arrival;
        }
    }

    fn is_over(&self, now: Instant) -> bool {
        match &self.period {
            Some(period) => period.is_over(now),
            None => stop::requested(),
        }
    }

    fn time(&self) -> Duration {
        let span = self.span;
        span.map_or(Duration::ZERO, |(first, last)| last - first)
    }
}

impl Expected {
    /// How many numbers a writer has left out; it may begin with any.
    fn missing_before(&mut self, writer: Guid, seq: u32) -> u32 {
        let next = seq.wrapping_add(1);
        match self.0.iter_mut().find(|(known, _)| *known == writer) {
            Some((_, expected)) => seq.wrapping_sub(std::mem::replace(expected, next)),
            None => {
                self.0.push((writer, next));
                0
            }
        }
    }
}

impl Counts {
    fn since(self, earlier: Self) -> Self {
        Self {
            count: self.count - earlier.count,
            lost: self.lost - earlier.lost,
            bytes: self.bytes - earlier.bytes,
        }
    }

    fn figures(self, time: Duration) -> Received {
        Received {
            count: self.count,
            lost: self.lost,
            seconds: time.as_secs_f64(),
            samples_per_s: per_second(self.count, time),
            bytes_per_s: per_second(self.bytes, time),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_a_writer_leaves_out_are_missing() {
        let mut expected = Expected::default();
        let [one, other] = [1, 2].map(|number| Guid::from_bytes([number; 16]));
        let mut missing = |writer, seq| expected.missing_before(writer, seq);
        assert_eq!(missing(one, 7), 0, "it may begin with any");
        assert_eq!(missing(one, 8), 0);
        assert_eq!(missing(other, 3), 0);
        assert_eq!(missing(one, 11), 2);
        assert_eq!(missing(one, 12), 0);
        assert_eq!(missing(other, u32::MAX), u32::MAX - 4);
        assert_eq!(missing(other, 1), 1);
    }
}
