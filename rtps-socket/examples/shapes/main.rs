//! Publishes or subscribes shapes as the vendors' interoperability demonstrations do, and prints what happens as one
//! JSON object a line: the peer of the programs in `tests/peers`. SIGUSR1 stops a subscriber from taking samples, and
//! lets it go on.

mod options;

use std::collections::HashSet;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use nix::sys::signal::{SigSet, Signal};
use rtps_socket::error::WriteError;
use rtps_socket::{
    DataReader, DataWriter, DdsType, DomainParticipant, InstanceState, Qos, Sample, StatusEvent,
    Topic,
};
use serde_json::{Value, json};

use options::{Options, Switch};

// By name: peers have the type as final or appendable, and their last member as octets or not.
#[derive(DdsType)]
#[dds(by_name)]
struct ShapeType {
    #[dds(key, bound = 128)]
    color: String,
    x: i32,
    y: i32,
    shapesize: i32,
    additional_payload_size: Vec<u8>,
}

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

static STOPPED: AtomicBool = AtomicBool::new(false);
static PAUSED: AtomicBool = AtomicBool::new(false);

fn main() -> Result<()> {
    let options = Options::parse();
    let give_up = Instant::now() + options.timeout;
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .log_internal_errors(false)
        .init();
    catch_signals()?;
    let is_complete = run(&options, give_up).inspect_err(|error| {
        print(&json!({"event": "error", "message": error.to_string()}));
    })?;
    std::process::exit(i32::from(!is_complete));
}

fn run(options: &Options, give_up: Instant) -> Result<bool> {
    if options.multicast == Switch::Off && options.peer.is_none() {
        return Err("without multicast there has to be a --peer".into());
    }
    let mut builder = DomainParticipant::builder()
        .domain(options.domain)
        .layer(options.layer());
    if let Some(peer) = options.peer {
        builder = builder.peer(peer);
    }
    let participant = builder.open()?;
    let topic = participant.create_topic::<ShapeType>(&options.topic)?;
    let group = Qos::default().partition(options.partition.clone());
    match options.role.publish {
        true => publish(options, give_up, &participant, &topic, group),
        false => subscribe(options, give_up, &participant, &topic, group),
    }
}

fn publish(
    options: &Options,
    give_up: Instant,
    participant: &DomainParticipant,
    topic: &Topic<ShapeType>,
    group: Qos,
) -> Result<bool> {
    let writer = participant
        .create_publisher(group)
        .create_writer(topic, options.qos())?;
    writer.set_listener(print_status);
    while keeps_going(give_up) && writer.matched().len() < options.wait_match {
        let _ = writer.wait_for_matched(options.wait_match, Duration::from_millis(100));
    }
    pause(options.settle);
    let mut sent = 0;
    let start = Instant::now();
    let mut next = start;
    while keeps_going(give_up) && (options.count == 0 || sent < options.count) {
        let counter = i32::try_from(sent)?;
        let shape = shape(options, sent % options.instances, counter);
        while let Err(error) = writer.write(&shape) {
            if error != WriteError::Timeout || !keeps_going(give_up) {
                return Err(error.into());
            }
            print(&json!({"event": "timeout", "x": counter}));
        }
        sent += 1;
        next += Duration::from_micros(options.period_us);
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    let written = start.elapsed().as_secs_f64();
    end_instances(options, &writer)?;
    if !options.best_effort && keeps_going(give_up) {
        writer.wait_for_acknowledgments(give_up.saturating_duration_since(Instant::now()))?;
    }
    pause(options.linger);
    print(&json!({"event": "done", "sent": sent, "received": 0, "written_in_s": written}));
    Ok(sent >= options.count)
}

fn end_instances(options: &Options, writer: &DataWriter<ShapeType>) -> Result<()> {
    for instance in 0..options.instances {
        let shape = shape(options, instance, 0);
        if options.dispose {
            writer.dispose(&shape)?;
        }
        if options.unregister {
            writer.unregister(&shape)?;
        }
    }
    Ok(())
}

fn shape(options: &Options, instance: u64, counter: i32) -> ShapeType {
    ShapeType {
        color: options.color(instance),
        x: counter,
        y: counter,
        shapesize: 30,
        additional_payload_size: match options.pattern {
            true => pattern(counter, options.size),
            false => vec![0; options.size],
        },
    }
}

/// Octets of which no eight are those of another place or another sample.
fn pattern(counter: i32, size: usize) -> Vec<u8> {
    let words = (0..size.div_ceil(8) as u64)
        .map(|place| (place << 32) + u64::from(counter.cast_unsigned()));
    let mut octets: Vec<u8> = words
        .flat_map(|word| word.wrapping_mul(0x9e37_79b9_7f4a_7c15).to_le_bytes())
        .collect();
    octets.truncate(size);
    octets
}

fn subscribe(
    options: &Options,
    give_up: Instant,
    participant: &DomainParticipant,
    topic: &Topic<ShapeType>,
    group: Qos,
) -> Result<bool> {
    let subscriber = participant.create_subscriber(group);
    let reader = match &options.filter {
        None => subscriber.create_reader(topic, options.qos())?,
        Some(expression) => {
            let parameters: Vec<&str> = options.filter_parameter.as_deref().into_iter().collect();
            let wanted = participant.create_content_filtered_topic(
                "Filtered",
                topic,
                expression,
                &parameters,
            )?;
            subscriber.create_reader(&wanted, options.qos())?
        }
    };
    reader.set_listener(print_status);
    let mut received = 0;
    let mut linger_until = None;
    let mut ignore_after = options.ignore_after;
    while keeps_going(give_up) {
        if ignore_after.take_if(|count| received >= *count).is_some() {
            let writers = reader.matched();
            writers
                .into_iter()
                .for_each(|writer| participant.ignore_publication(writer));
        }
        if options.count != 0 && received >= options.count {
            let end = *linger_until.get_or_insert_with(|| Instant::now() + options.linger);
            if Instant::now() >= end {
                break;
            }
        }
        received += take(options, &reader);
    }
    print(&json!({"event": "done", "sent": 0, "received": received}));
    Ok(received >= options.count)
}

/// Prints what there is and returns how many samples it was.
fn take(options: &Options, reader: &DataReader<ShapeType>) -> u64 {
    if PAUSED.load(Ordering::Relaxed) {
        pause(Duration::from_millis(10));
        return 0;
    }
    if !reader.wait(Duration::from_millis(100)) {
        return 0;
    }
    let mut received = 0;
    let mut ended = HashSet::new();
    for sample in reader.take() {
        if let Some(shape) = &sample.data {
            print_sample(options, shape);
            received += 1;
        }
        // One take of an instance's last data may carry the end of the instance with it.
        if sample.info.sample_rank == 0 && ended.insert(sample.info.instance) {
            print_end(&sample);
        }
    }
    received
}

fn print_sample(options: &Options, shape: &ShapeType) {
    let payload = &shape.additional_payload_size;
    let mut event =
        json!({"event": "sample", "color": shape.color, "x": shape.x, "size": payload.len()});
    if options.pattern {
        event["intact"] = (*payload == pattern(shape.x, payload.len())).into();
    }
    print(&event);
}

fn print_end(sample: &Sample<ShapeType>) {
    let event = match sample.info.instance_state {
        InstanceState::Alive => return,
        InstanceState::NotAliveDisposed => "disposed",
        InstanceState::NotAliveNoWriters => "unregistered",
    };
    let color = sample.data_or_key().map(|shape| shape.color.as_str());
    print(&json!({"event": event, "color": color}));
}

fn print_status(event: StatusEvent) {
    match event {
        StatusEvent::PublicationMatched { current, .. }
        | StatusEvent::SubscriptionMatched { current, .. } => {
            print(&json!({"event": "matched", "current": current}));
        }
        StatusEvent::OfferedIncompatibleQos { policy, .. }
        | StatusEvent::RequestedIncompatibleQos { policy, .. } => {
            print(&json!({"event": "incompatible_qos", "policy": policy_name(policy)}));
        }
        StatusEvent::LivelinessChanged { alive, .. } => {
            print(&json!({"event": "liveliness", "alive": alive}));
        }
        StatusEvent::RequestedDeadlineMissed { total, .. } => {
            print(&json!({"event": "deadline_missed", "total": total}))
        }
        StatusEvent::SampleLost { count, .. } => {
            print(&json!({"event": "sample_lost", "count": count}))
        }
        other => print(&json!({"event": "status", "status": format!("{other:?}")})),
    }
}

/// DATA_REPRESENTATION for DataRepresentation.
fn policy_name(policy: rtps_socket::qos::PolicyId) -> String {
    let mut name = String::new();
    for letter in format!("{policy:?}").chars() {
        if letter.is_uppercase() && !name.is_empty() {
            name.push('_');
        }
        name.push(letter.to_ascii_uppercase());
    }
    name
}

fn print(event: &Value) {
    // Nobody reads any more: there will be a signal, or the time will be over.
    let _ = writeln!(std::io::stdout(), "{event}");
}

fn keeps_going(give_up: Instant) -> bool {
    !STOPPED.load(Ordering::Relaxed) && Instant::now() < give_up
}

fn pause(time: Duration) {
    let end = Instant::now() + time;
    while keeps_going(end) {
        thread::sleep(Duration::from_millis(10).min(end.saturating_duration_since(Instant::now())));
    }
}

/// Turns SIGINT and SIGTERM into [`STOPPED`], and SIGUSR1 into [`PAUSED`]; before any thread is started, so that all
/// block them.
fn catch_signals() -> Result<()> {
    let signals = SigSet::from_iter([Signal::SIGINT, Signal::SIGTERM, Signal::SIGUSR1]);
    signals.thread_block()?;
    thread::spawn(move || {
        while let Ok(signal) = signals.wait() {
            match signal {
                Signal::SIGUSR1 => drop(PAUSED.fetch_not(Ordering::Relaxed)),
                _ => STOPPED.store(true, Ordering::Relaxed),
            }
        }
    });
    Ok(())
}
