//! `rtps perf ping`: round trips, one after the other.

use std::thread;
use std::time::{Duration, Instant, SystemTime};

use anyhow::Result;
use clap::Args;
use rtps_socket::{RawReader, RawSample, RawWriter};

use super::histogram::Histogram;
use super::options::{Options, bytes};
use super::pace::{Pace, Second};
use super::report::{Report, RoundTrips};
use super::session::{Flow, Session, marked, partition_of};
use super::topic::{Template, Topic};
use crate::stop;

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long before there were any.
const FIRST_PATIENCE: Duration = Duration::from_millis(50);

/// The options of the role.
#[derive(Args, Debug)]
pub(crate) struct Ping {
    #[command(flatten)]
    options: Options,
    /// Bytes of a sample, 12 or more on topic KS; k and M are understood.
    #[arg(long, value_parser = bytes, default_value = "0")]
    size: u32,
    /// Pings a second; the next follows the last answer unless given.
    #[arg(long)]
    rate: Option<f64>,
    /// How many answer each ping.
    #[arg(long, default_value_t = 1)]
    peers: u32,
}

impl Ping {
    /// Measures until the time is over.
    pub(crate) fn run(self) -> Result<()> {
        let report = Report::new("ping", self.options.json);
        let mut pings = Pings::new(&self)?;
        let mut log = Log::new(Instant::now());
        if pings.find_peers()? {
            report.ready();
            log = self.measure(&mut pings, &report)?;
        }
        report.summary(log.summary());
        Ok(())
    }

    fn measure(&self, pings: &mut Pings, report: &Report) -> Result<Log> {
        let now = Instant::now();
        let period = self.options.period(now);
        let mut pace = self.rate.map(|rate| Pace::new(now, rate));
        let mut log = Log::new(now);
        loop {
            let lost = pings.exchange(PATIENCE, |time| log.histogram.record(time))?;
            log.lost += u64::from(lost);
            let now = pings.last_look;
            log.end = now;
            if period.is_over(now) {
                return Ok(log);
            }
            if log.begin < period.start && now >= period.start {
                log = Log::new(now);
            }
            log.report_second(now, report);
            if let Some(sleep) = pace.as_mut().and_then(|pace| pace.next_after(now)) {
                thread::sleep(sleep);
            }
        }
    }
}

/// The endpoints, and the last ping.
struct Pings {
    writer: RawWriter,
    reader: RawReader,
    topic: Topic,
    template: Template,
    key: u32,
    seq: u32,
    peers: u32,
    /// When the last answer came, or did not come: what there is to measure need not wait for another clock reading.
    last_look: Instant,
}

impl Pings {
    fn new(ping: &Ping) -> Result<Self> {
        let session = Session::open_to_ping(&ping.options)?;
        let writer = session.writer(Flow::Ping, None)?;
        let guid = writer.guid();
        // Tells apart the answers to programs that are the same participant.
        let key = u32::from_be_bytes(guid.entity.0);
        let topic = ping.options.topic;
        Ok(Self {
            reader: session.reader(Flow::Pong, Some(partition_of(guid.prefix)))?,
            writer,
            topic,
            template: Template::new(topic, ping.size, key)?,
            key: if topic.has_key() { key } else { 0 },
            seq: 0,
            peers: ping.peers,
            last_look: Instant::now(),
        })
    }

    /// Pings until all answer; false when told to stop before.
    fn find_peers(&mut self) -> Result<bool> {
        while self.exchange(FIRST_PATIENCE, |_| {})? > 0 {
            if stop::requested() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Sends a ping and tells of each answer how long it took; returns how many did not come in time.
    fn exchange(&mut self, patience: Duration, mut answered: impl FnMut(Duration)) -> Result<u32> {
        self.seq = self.seq.wrapping_add(1);
        let asked = marked(SystemTime::now(), true);
        let ping = self.template.sample(self.seq, asked);
        let mut missing = self.peers;
        let start = Instant::now();
        let mut waited = Duration::ZERO;
        self.writer.send_change(ping)?;
        while missing > 0 {
            let sample = self.reader.recv(patience.saturating_sub(waited));
            self.last_look = Instant::now();
            waited = self.last_look - start;
            let Some(sample) = sample else {
                break;
            };
            if self.is_answer(&sample) {
                answered(waited);
                missing -= 1;
            }
        }
        Ok(missing)
    }

    fn is_answer(&self, sample: &RawSample) -> bool {
        let contents = self.topic.read(&sample.payload);
        sample.info.valid_data
            && contents.is_some_and(|contents| (contents.seq, contents.key) == (self.seq, self.key))
    }
}

/// What was measured, in all and since the last line.
struct Log {
    begin: Instant,
    end: Instant,
    second: Second,
    histogram: Histogram,
    lost: u64,
    all: Histogram,
    all_lost: u64,
}

impl Log {
    fn new(begin: Instant) -> Self {
        Self {
            begin,
            end: begin,
            second: Second::new(begin),
            histogram: Histogram::default(),
            lost: 0,
            all: Histogram::default(),
            all_lost: 0,
        }
    }

    fn report_second(&mut self, now: Instant, report: &Report) {
        if let Some(time) = self.second.elapsed(now) {
            report.second(RoundTrips::new(&self.histogram, self.lost, time));
            self.add_up();
        }
    }

    fn summary(&mut self) -> RoundTrips {
        self.add_up();
        let time = self.end.saturating_duration_since(self.begin);
        RoundTrips::new(&self.all, self.all_lost, time)
    }

    fn add_up(&mut self) {
        self.all.absorb(&mut self.histogram);
        self.all_lost += std::mem::take(&mut self.lost);
    }
}
