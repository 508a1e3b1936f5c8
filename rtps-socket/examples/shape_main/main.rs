//! Publishes or subscribes coloured shapes as the `shape_main` of all DDS vendors does, with the QoS that the command
//! line asks for: the program by which they prove that they interoperate.
//!
//! Other programs match its output: see [`report`] and [`listener`]. It runs on whichever layer is there;
//! `RTPS_LAYER=in-process` or `kernel` forces one. `RUST_LOG` and `SHAPE_MAIN_LOG`, a file, bring a log.

mod interrupt;
mod listener;
mod options;
mod output;
mod publisher;
mod qos;
mod report;
mod shape;
mod subscriber;

use std::fs::File;
use std::process::ExitCode;

use rtps_socket::error::{CreateError, FilterError, OpenError, WriteError};
use rtps_socket::{DomainParticipant, Topic};
use thiserror::Error;
use tracing_subscriber::EnvFilter;

use crate::interrupt::Interrupt;
use crate::options::{Options, Request, Role, USAGE};
use crate::output::Printer;
use crate::publisher::ShapePublisher;
use crate::shape::ShapeType;
use crate::subscriber::ShapeSubscriber;

/// Names the file that the log goes to: standard output and error are matched by others.
const LOG_VARIABLE: &str = "SHAPE_MAIN_LOG";

/// Why the program ends before it is asked to.
#[derive(Debug, Error)]
enum Failure {
    #[error("the program cannot be set up: {0}")]
    System(#[from] std::io::Error),
    #[error("failed to create the participant: {0}")]
    Open(#[from] OpenError),
    #[error("failed to create an entity: {0}")]
    Create(#[from] CreateError),
    #[error("failed to create content filtered topic: {0}")]
    Filter(#[from] FilterError),
    #[error("failed to write: {0}")]
    Write(#[from] WriteError),
}

impl Failure {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::System(_) | Self::Open(_) | Self::Create(_) | Self::Filter(_) => {
                ExitCode::from(2)
            }
            Self::Write(_) => ExitCode::from(3),
        }
    }
}

fn main() -> ExitCode {
    match options::parse(std::env::args_os().skip(1)) {
        Ok(Request::Help) => {
            print!("{USAGE}");
            ExitCode::SUCCESS
        }
        Ok(Request::Run(options, warnings)) => start(&options, warnings).unwrap_or_else(|error| {
            eprintln!("{error}");
            error.exit_code()
        }),
        Err(error) => {
            eprint!("{error}\n{USAGE}");
            ExitCode::from(1)
        }
    }
}

fn start(options: &Options, warnings: Vec<String>) -> Result<ExitCode, Failure> {
    let interrupt = Interrupt::catch()?;
    let printer = Printer::start(&interrupt)?;
    log()?;
    for warning in warnings {
        printer.print(format!("warning: {warning}"));
    }
    let ended = run(options, &interrupt, &printer);
    let code = match &ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            printer.print(failure.to_string());
            failure.exit_code()
        }
    };
    printer.finish();
    Ok(code)
}

fn run(options: &Options, interrupt: &Interrupt, printer: &Printer) -> Result<(), Failure> {
    let participant = open(options)?;
    listener::listen(&participant, printer);
    if options.is_verbose {
        printer.print(format!("layer: {:?}", participant.socket().layer()));
    }
    match options.role {
        Role::Publisher => {
            let publisher = ShapePublisher::new(options, &participant, interrupt, printer)?;
            publisher.run()?;
            printer.print("Done.");
        }
        Role::Subscriber => {
            let mut subscriber = ShapeSubscriber::new(options, &participant, interrupt, printer)?;
            subscriber.run();
            printer.print("Done.");
        }
    }
    Ok(())
}

fn open(options: &Options) -> Result<DomainParticipant, OpenError> {
    let mut builder = DomainParticipant::builder().domain(options.domain);
    if let Some(period) = options.announce_period {
        builder = builder.announce_period(period);
    }
    if let Some(size) = options.fragment_size {
        builder = builder.fragment_size(size);
    }
    builder.open()
}

/// Creates the topics, and says so before each.
fn topics(
    options: &Options,
    participant: &DomainParticipant,
    printer: &Printer,
) -> Result<Vec<Topic<ShapeType>>, CreateError> {
    let names = options.topic_names();
    let topics = names.map(|name| {
        printer.print(format!("Create topic: {name}"));
        participant.create_topic(&name)
    });
    topics.collect()
}

/// Logs to the file that the environment names, if it does.
fn log() -> std::io::Result<()> {
    if let Some(path) = std::env::var_os(LOG_VARIABLE) {
        tracing_subscriber::fmt()
            .with_env_filter(EnvFilter::from_default_env())
            .with_ansi(false)
            .with_writer(File::create(path)?)
            .log_internal_errors(false)
            .init();
    }
    Ok(())
}
