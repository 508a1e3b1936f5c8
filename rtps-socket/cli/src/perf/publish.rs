//! `rtps perf pub`: data, at a rate or as fast as it goes.

use std::thread;
use std::time::{Duration, Instant, SystemTime};

use anyhow::Result;
use clap::Args;
use rtps_socket::RawWriter;
use rtps_socket::error::WriteError;

use super::options::{Options, Period, bytes};
use super::pace::{Pace, Second};
use super::report::{Report, Sent};
use super::session::{Flow, Session, marked};
use super::topic::Template;
use crate::stop;

/// How long matching is waited for before there is a look at signals.
const LOOK: Duration = Duration::from_millis(100);
/// So many samples written as fast as possible have a time in common: reading the clock costs as much as writing.
const SAMPLES_A_LOOK: u32 = 8;
/// How long what was written may take to be acknowledged.
const LINGER: Duration = Duration::from_secs(10);

/// The options of the role.
#[derive(Args, Debug)]
pub(crate) struct Publish {
    #[command(flatten)]
    options: Options,
    /// Bytes of a sample, 12 or more on topic KS; k and M are understood.
    #[arg(long, value_parser = bytes, default_value = "0")]
    size: u32,
    /// Keep the last N samples instead of all, as ddsperf's -k.
    #[arg(short = 'k', long, value_name = "N")]
    keep_last: Option<u32>,
    /// Bursts a second; as fast as possible unless given.
    #[arg(long)]
    rate: Option<f64>,
    /// Samples of a burst.
    #[arg(long, default_value_t = 1)]
    burst: u32,
    /// Begin when so many readers are matched.
    #[arg(long, default_value_t = 1)]
    peers: usize,
}

impl Publish {
    /// Publishes until the time is over.
    pub(crate) fn run(self) -> Result<()> {
        let report = Report::new("pub", self.options.json);
        let template = Template::new(self.options.topic, self.size, 0)?;
        let session = Session::open(&self.options, self.keep_last)?;
        let writer = session.writer(Flow::Data, None)?;
        let is_matched = || writer.wait_for_matched(self.peers, LOOK).is_ok();
        while !is_matched() {
            if stop::requested() {
                report.summary(Sent::default());
                return Ok(());
            }
        }
        report.ready();
        let mut stream = Stream::new(&writer, &template, &self);
        stream.run(&report)?;
        report.summary(Sent::new(stream.count, stream.begin.elapsed()));
        let end = Instant::now() + LINGER;
        while writer.wait_for_acknowledgments(LOOK).is_err() && Instant::now() < end {}
        Ok(())
    }
}

/// What is being written.
struct Stream<'a> {
    writer: &'a RawWriter,
    template: &'a Template,
    /// Samples between two looks at the clock.
    burst: u32,
    pace: Option<Pace>,
    period: Period,
    begin: Instant,
    seq: u32,
    count: u64,
    /// Of `count`, those of the seconds that were reported.
    reported: u64,
}

impl<'a> Stream<'a> {
    fn new(writer: &'a RawWriter, template: &'a Template, publish: &Publish) -> Self {
        let begin = Instant::now();
        Self {
            writer,
            template,
            burst: match publish.rate {
                Some(_) => publish.burst.max(1),
                None => SAMPLES_A_LOOK,
            },
            pace: publish.rate.map(|rate| Pace::new(begin, rate)),
            period: publish.options.period(begin),
            begin,
            seq: 0,
            count: 0,
            reported: 0,
        }
    }

    fn run(&mut self, report: &Report) -> Result<()> {
        let mut second = Second::new(self.begin);
        loop {
            self.write_burst()?;
            let now = Instant::now();
            if self.period.is_over(now) {
                return Ok(());
            }
            if self.begin < self.period.start && now >= self.period.start {
                (self.begin, self.count, self.reported) = (now, 0, 0);
            }
            if let Some(time) = second.elapsed(now) {
                report.second(Sent::new(self.count - self.reported, time));
                self.reported = self.count;
            }
            if let Some(sleep) = self.pace.as_mut().and_then(|pace| pace.next_after(now)) {
                thread::sleep(sleep);
            }
        }
    }

    fn write_burst(&mut self) -> Result<()> {
        let now = marked(SystemTime::now(), false);
        for _ in 0..self.burst {
            while !self.write(now)? {
                if stop::requested() {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Whether there was room for it.
    fn write(&mut self, now: SystemTime) -> Result<bool> {
        let sample = self.template.sample(self.seq, now);
        match self.writer.send_change(sample) {
            Ok(_) => {
                self.seq = self.seq.wrapping_add(1);
                self.count += 1;
                Ok(true)
            }
            Err(WriteError::Timeout) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}
