//! What the peer programs in Rust share: the command line and the events of `peer.h`, and the course of a publisher
//! and of a subscriber. A program gives them a library's writer or reader.

pub mod events;
mod options;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;

pub use options::{Durability, Options, Role};

/// Whatever a library says went wrong.
pub type Error = Box<dyn std::error::Error>;
/// A result of a library's call.
pub type Result<T> = std::result::Result<T, Error>;

static STOPPED: AtomicBool = AtomicBool::new(false);

/// What a publisher needs of a library's writer.
pub trait Writer {
    /// How many readers are matched; prints what happened to the writer since the last call.
    fn matched(&mut self) -> Result<usize>;
    /// Writes a sample; false when it must be tried again.
    fn write(&mut self, color: &str, number: i32, size: usize) -> Result<bool>;
    /// Disposes an instance.
    fn dispose(&mut self, color: &str) -> Result<()>;
    /// Unregisters an instance.
    fn unregister(&mut self, color: &str) -> Result<()>;
    /// Whether everything was acknowledged within the time.
    fn wait_for_acknowledgments(&mut self, time: Duration) -> Result<bool>;
}

/// What a reader has taken.
pub enum Taken {
    /// A sample.
    Sample {
        /// The key.
        color: String,
        /// `x`.
        number: i32,
        /// Octets of additional payload.
        size: usize,
    },
    /// An instance was disposed.
    Disposed(String),
    /// An instance has no writers any more.
    Unregistered(String),
}

/// What a subscriber needs of a library's reader.
pub trait Reader {
    /// Takes what there is without waiting; prints what happened to the reader since the last call.
    fn take(&mut self) -> Result<Vec<Taken>>;
}

/// Reads the command line and runs the library's writer or reader, which `open` makes.
pub fn run<W: Writer, R: Reader>(
    writer: impl FnOnce(&Options) -> Result<W>,
    reader: impl FnOnce(&Options) -> Result<R>,
) -> ExitCode {
    let options = Options::parse();
    let outcome = ctrlc::set_handler(|| STOPPED.store(true, Ordering::Relaxed))
        .map_err(Error::from)
        .and_then(|()| {
            let give_up = Instant::now() + options.timeout;
            match options.role.publish {
                true => publish(&options, give_up, &mut writer(&options)?),
                false => subscribe(&options, give_up, &mut reader(&options)?),
            }
        });
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            events::error(&error.to_string());
            ExitCode::FAILURE
        }
    }
}

fn publish(options: &Options, give_up: Instant, writer: &mut impl Writer) -> Result<bool> {
    while keeps_going(give_up) && writer.matched()? < options.wait_match {
        thread::sleep(Duration::from_millis(1));
    }
    pause(options.settle, || writer.matched().map(drop))?;
    let mut sent = 0;
    let mut next = Instant::now();
    while keeps_going(give_up) && (options.count == 0 || sent < options.count) {
        let color = options.instance_color(sent % options.instances);
        if !writer.write(&color, i32::try_from(sent)?, options.size)? {
            thread::sleep(Duration::from_millis(1));
            continue;
        }
        sent += 1;
        next += Duration::from_micros(options.period_us);
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    for color in (0..options.instances).map(|instance| options.instance_color(instance)) {
        if options.dispose {
            writer.dispose(&color)?;
        }
        if options.unregister {
            writer.unregister(&color)?;
        }
    }
    let left = give_up.saturating_duration_since(Instant::now());
    if !options.best_effort && keeps_going(give_up) && !writer.wait_for_acknowledgments(left)? {
        return Err("not everything was acknowledged".into());
    }
    pause(options.linger, || writer.matched().map(drop))?;
    events::done(sent, 0);
    Ok(sent >= options.count)
}

fn subscribe(options: &Options, give_up: Instant, reader: &mut impl Reader) -> Result<bool> {
    let mut received = 0;
    let mut linger_until = None;
    while keeps_going(give_up) {
        if options.count != 0 && received >= options.count {
            let end = *linger_until.get_or_insert_with(|| Instant::now() + options.linger);
            if Instant::now() >= end {
                break;
            }
        }
        let taken = reader.take()?;
        if taken.is_empty() {
            thread::sleep(Duration::from_millis(2));
        }
        received += taken.iter().map(report).sum::<u64>();
    }
    events::done(0, received);
    Ok(received >= options.count)
}

/// Prints what was taken; gives the number of samples that it is.
fn report(taken: &Taken) -> u64 {
    match taken {
        Taken::Sample {
            color,
            number,
            size,
        } => {
            events::sample(color, *number, *size);
            return 1;
        }
        Taken::Disposed(color) => events::end("disposed", color),
        Taken::Unregistered(color) => events::end("unregistered", color),
    }
    0
}

fn keeps_going(give_up: Instant) -> bool {
    !STOPPED.load(Ordering::Relaxed) && Instant::now() < give_up
}

/// Lets so much time pass, with a look at what happens meanwhile.
fn pause(time: Duration, mut look: impl FnMut() -> Result<()>) -> Result<()> {
    let end = Instant::now() + time;
    while keeps_going(end) {
        look()?;
        thread::sleep(Duration::from_millis(10).min(end.saturating_duration_since(Instant::now())));
    }
    Ok(())
}
