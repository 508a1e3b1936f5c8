//! Round trips and streams of samples on RustDDS, measured as `rtps perf` measures its own: the same roles, the same
//! options as far as the benchmarks use them, the same JSON lines.

mod figures;
mod octets;

use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use futures::StreamExt;
use futures::executor::block_on;
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{History, Reliability};

use rustdds::{
    DataWriterStatus, DomainParticipant, QosPolicies, QosPolicyBuilder, StatusEvented, TopicKind,
};

use figures::{Arrivals, RoundTrips};
use octets::{Octets, OctetsAdapter};

type Error = Box<dyn std::error::Error>;
type Reader = DataReader<Octets, OctetsAdapter>;
type Writer = DataWriter<Octets, OctetsAdapter>;

/// How long a full history may block a writer.
const MAX_BLOCKING: rustdds::Duration = rustdds::Duration::from_millis(100);

#[derive(Parser)]
struct Options {
    role: Role,
    /// Bytes of a sample.
    #[arg(long, default_value_t = 100)]
    size: usize,
    /// Bursts a second; as fast as possible unless given.
    #[arg(long)]
    rate: Option<f64>,
    /// Samples of a burst.
    #[arg(long, default_value_t = 1)]
    burst: u64,
    /// Begin when so many readers are matched.
    #[arg(long, default_value_t = 1)]
    peers: usize,
    /// Seconds at the beginning that do not count.
    #[arg(long, default_value_t = 0.0)]
    warm_up: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Ping,
    Pong,
    Pub,
    Sub,
}

static STOPPED: AtomicBool = AtomicBool::new(false);

fn is_wanted() -> bool {
    !STOPPED.load(Ordering::Relaxed)
}

fn main() -> Result<(), Error> {
    let options = Options::parse();
    ctrlc::set_handler(|| STOPPED.store(true, Ordering::Relaxed))?;
    let endpoints = Endpoints::new()?;
    match options.role {
        Role::Ping => ping(
            &options,
            endpoints.writer("Ping")?,
            endpoints.reader("Pong")?,
        ),
        Role::Pong => pong(endpoints.writer("Pong")?, endpoints.reader("Ping")?),
        Role::Pub => publish(&options, endpoints.writer("Data")?),
        Role::Sub => subscribe(&options, endpoints.reader("Data")?),
    }
}

struct Endpoints {
    participant: DomainParticipant,
    qos: QosPolicies,
}

impl Endpoints {
    fn new() -> Result<Self, Error> {
        let reliable = Reliability::Reliable {
            max_blocking_time: MAX_BLOCKING,
        };
        Ok(Self {
            participant: DomainParticipant::new(0)?,
            qos: QosPolicyBuilder::new()
                .reliability(reliable)
                .history(History::KeepAll)
                .build(),
        })
    }

    fn writer(&self, topic: &str) -> Result<Writer, Error> {
        let publisher = self.participant.create_publisher(&self.qos)?;
        Ok(publisher.create_datawriter_no_key(&self.topic(topic)?, None)?)
    }

    fn reader(&self, topic: &str) -> Result<Reader, Error> {
        let subscriber = self.participant.create_subscriber(&self.qos)?;
        Ok(subscriber.create_datareader_no_key(&self.topic(topic)?, None)?)
    }

    fn topic(&self, name: &str) -> Result<rustdds::Topic, Error> {
        let (name, type_name) = (name.to_owned(), "Sample".to_owned());
        Ok(self
            .participant
            .create_topic(name, type_name, &self.qos, TopicKind::NoKey)?)
    }
}

fn print(line: &str) {
    println!("{line}");
}

fn ready() {
    print(r#"{"event":"ready"}"#);
}

/// Calls `taken` with each sample that comes, on this thread.
fn for_each(reader: Reader, mut taken: impl FnMut(Octets)) {
    block_on(async {
        let mut samples = reader.async_bare_sample_stream();
        while let Some(sample) = samples.next().await {
            if let Ok(sample) = sample {
                taken(sample);
            }
        }
    });
}

/// Prints what `summary` says once the program is stopped, and ends it: nothing may come any more that would wake [`for_each`].
fn at_the_end(summary: impl FnOnce() -> String + Send + 'static) {
    thread::spawn(move || {
        while is_wanted() {
            thread::sleep(Duration::from_millis(5));
        }
        print(&summary());
        exit(0);
    });
}

/// Waits until a writer has so many readers, or the program is stopped.
fn wait_matched(writer: &Writer, readers: usize) {
    let mut matched = 0;
    while is_wanted() && matched < readers {
        match writer.try_recv_status() {
            Some(DataWriterStatus::PublicationMatched { current, .. }) => {
                matched = usize::try_from(current.count()).unwrap_or(0);
            }
            Some(_) => {}
            None => thread::sleep(Duration::from_millis(1)),
        }
    }
}

fn pong(writer: Writer, reader: Reader) -> Result<(), Error> {
    at_the_end(|| r#"{"event":"summary","role":"pong"}"#.to_owned());
    for_each(reader, |sample| {
        // What cannot be sent back is lost, and the other end says so.
        let _ = writer.write(sample, None);
    });
    Ok(())
}

fn ping(options: &Options, writer: Writer, reader: Reader) -> Result<(), Error> {
    wait_matched(&writer, 1);
    // The way back may be known a little later.
    thread::sleep(Duration::from_millis(500));
    let round_trips = RoundTrips::shared();
    let measured = round_trips.clone();
    at_the_end(move || RoundTrips::summary(&measured));
    let (mut number, mut sent) = (0, Instant::now());
    let _ = writer.write(Octets::numbered(options.size, number), None);
    let mut begin = None;
    for_each(reader, |answer| {
        if answer.number() != number {
            return;
        }
        let now = Instant::now();
        let begin = *begin.get_or_insert_with(|| {
            ready();
            let begin = now + Duration::from_secs_f64(options.warm_up);
            RoundTrips::begin(&round_trips, begin);
            begin
        });
        if sent >= begin {
            RoundTrips::add(&round_trips, now - sent);
        }
        number += 1;
        sent = now;
        let _ = writer.write(Octets::numbered(options.size, number), None);
    });
    Ok(())
}

fn publish(options: &Options, writer: Writer) -> Result<(), Error> {
    wait_matched(&writer, options.peers);
    ready();
    let begin = Instant::now();
    let mut sent = 0_u64;
    while is_wanted() {
        // An error is a history that stayed full.
        if writer
            .write(Octets::numbered(options.size, sent), None)
            .is_err()
        {
            continue;
        }
        sent += 1;
        if let Some(rate) = options.rate.filter(|_| sent.is_multiple_of(options.burst)) {
            let due = begin + Duration::from_secs_f64((sent / options.burst) as f64 / rate);
            thread::sleep(due.saturating_duration_since(Instant::now()));
        }
    }
    print(&format!(
        r#"{{"event":"summary","role":"pub","count":{sent}}}"#
    ));
    exit(0);
}

fn subscribe(options: &Options, reader: Reader) -> Result<(), Error> {
    let arrivals = Arrivals::shared();
    let measured = arrivals.clone();
    at_the_end(move || Arrivals::summary(&measured));
    let mut begin = None;
    for_each(reader, |sample| {
        let now = Instant::now();
        let begin = *begin.get_or_insert_with(|| {
            ready();
            now + Duration::from_secs_f64(options.warm_up)
        });
        Arrivals::add(&arrivals, sample.number(), sample.len(), now >= begin);
    });
    Ok(())
}
