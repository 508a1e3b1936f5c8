//! `rtps perf pong`: the answers to pings.

use std::collections::BTreeMap;
use std::time::{Duration, Instant, UNIX_EPOCH};

use anyhow::Result;
use clap::Args;
use rtps_socket::{ChangeKind, GuidPrefix, RawChange, RawReader, RawSample, RawWriter, Timestamp};

use super::options::Options;
use super::report::{Report, Sent};
use super::session::{Flow, Session, marked, partition_of};
use crate::stop;

/// How often there is a look at who asks, and at the time, while nobody does.
const LOOK: Duration = Duration::from_millis(100);

/// The options of the role.
#[derive(Args, Debug)]
pub(crate) struct Pong {
    #[command(flatten)]
    options: Options,
}

impl Pong {
    /// Answers until the time is over.
    pub(crate) fn run(self) -> Result<()> {
        let report = Report::new("pong", self.options.json);
        let mut answers = Answers::new(&self.options)?;
        answers.look_around()?;
        while answers.writers.is_empty() && !stop::requested() {
            answers.answer_next()?;
        }
        if !answers.writers.is_empty() {
            report.ready();
        }
        let begin = Instant::now();
        let period = self.options.period(begin);
        while !period.is_over(Instant::now()) {
            answers.answer_next()?;
        }
        report.summary(Sent::new(answers.count, begin.elapsed()));
        Ok(())
    }
}

/// The reader of pings, and the writers of answers: one for each participant that asks.
struct Answers {
    session: Session,
    reader: RawReader,
    writers: BTreeMap<GuidPrefix, RawWriter>,
    count: u64,
}

impl Answers {
    fn new(options: &Options) -> Result<Self> {
        let session = Session::open_to_ping(options)?;
        Ok(Self {
            reader: session.reader(Flow::Ping, None)?,
            session,
            writers: BTreeMap::new(),
            count: 0,
        })
    }

    /// Answers a ping if there is one soon.
    fn answer_next(&mut self) -> Result<()> {
        match self.reader.recv(LOOK) {
            Some(ping) if ping.info.valid_data => self.answer(ping),
            Some(_) => Ok(()),
            None => self.look_around(),
        }
    }

    fn answer(&mut self, ping: RawSample) -> Result<()> {
        let asker = ping.info.writer.prefix;
        if !self.writers.contains_key(&asker) {
            self.look_around()?;
        }
        let Some(writer) = self.writers.get(&asker) else {
            return Ok(());
        };
        let asked = ping
            .info
            .source_timestamp
            .map_or(Duration::ZERO, Timestamp::to_unix);
        writer.send_change(RawChange {
            kind: ChangeKind::Alive,
            instance: ping.info.instance,
            payload: ping.payload,
            // ddsperf takes the time that it asked at from the answer, and the lowest bit for the sign of an answer
            // to a ping and not to data.
            timestamp: Some(marked(UNIX_EPOCH + asked, true)),
        })?;
        self.count += 1;
        Ok(())
    }

    /// Makes a writer for each participant that may ask, ahead of its pings where possible: an answer to who does not
    /// know the writer yet is lost.
    fn look_around(&mut self) -> Result<()> {
        let matched = self.reader.matched();
        let askers = || matched.iter().map(|ping_writer| ping_writer.prefix);
        self.writers
            .retain(|known, _| askers().any(|asker| asker == *known));
        for asker in askers() {
            if !self.writers.contains_key(&asker) {
                let writer = self.session.writer(Flow::Pong, Some(partition_of(asker)))?;
                self.writers.insert(asker, writer);
            }
        }
        Ok(())
    }
}
