//! A publisher or subscriber of ShapeType on RustDDS. RustDDS knows neither PARTITION nor unregistering an instance.

use std::process::ExitCode;
use std::time::Duration;

use rustdds::dds::statusevents::DataReaderStatus;
use rustdds::policy::{self, History, Reliability};
use rustdds::qos::QosPolicyId;
use rustdds::with_key::{DataReaderCdr, DataWriterCdr, Sample};
use rustdds::{
    DataWriterStatus, DomainParticipant, DomainParticipantBuilder, Keyed, QosPolicies,
    QosPolicyBuilder, StatusEvented, TopicKind,
};
use serde::{Deserialize, Serialize};
use shapes_peer::{Durability, Options, Result, Taken, events};

#[derive(Clone, Debug, Deserialize, Serialize)]
struct ShapeType {
    color: String,
    x: i32,
    y: i32,
    shapesize: i32,
    additional_payload_size: Vec<u8>,
}

impl Keyed for ShapeType {
    type K = String;

    fn key(&self) -> String {
        self.color.clone()
    }
}

fn main() -> ExitCode {
    shapes_peer::run(Writer::open, Reader::open)
}

/// A participant with a topic for one endpoint.
struct Endpoint {
    participant: DomainParticipant,
    topic: rustdds::Topic,
    qos: QosPolicies,
}

impl Endpoint {
    fn open(options: &Options) -> Result<Self> {
        if options.partition.is_some() || options.unregister || options.xcdr != 1 {
            return Err("RustDDS has no such thing".into());
        }
        let mut builder = DomainParticipantBuilder::new(options.domain);
        if let Some(address) = &options.interface {
            builder = builder.with_only_networks([address.parse::<std::net::IpAddr>()?]);
        }
        let participant = builder.build()?;
        let qos = qos(options);
        let (name, type_name) = (options.topic.clone(), "ShapeType".to_owned());
        let topic = participant.create_topic(name, type_name, &qos, TopicKind::WithKey)?;
        Ok(Self {
            participant,
            topic,
            qos,
        })
    }
}

fn qos(options: &Options) -> QosPolicies {
    let reliability = match options.best_effort {
        true => Reliability::BestEffort,
        false => Reliability::Reliable {
            max_blocking_time: rustdds::Duration::from_secs(10),
        },
    };
    let durability = match options.durability {
        Durability::Volatile => policy::Durability::Volatile,
        Durability::TransientLocal => policy::Durability::TransientLocal,
    };
    let history = match options.keep_last {
        Some(depth) => History::KeepLast {
            depth: depth.cast_signed(),
        },
        None => History::KeepAll,
    };
    let builder = QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(durability)
        .history(history);
    let period = options.deadline_ms.map(Duration::from_millis);
    match period {
        Some(period) => builder.deadline(policy::Deadline(period.into())).build(),
        None => builder.build(),
    }
}

struct Writer {
    writer: DataWriterCdr<ShapeType>,
    matched: usize,
    _endpoint: Endpoint,
}

impl Writer {
    fn open(options: &Options) -> Result<Self> {
        let endpoint = Endpoint::open(options)?;
        let publisher = endpoint.participant.create_publisher(&endpoint.qos)?;
        Ok(Self {
            writer: publisher.create_datawriter_cdr(&endpoint.topic, None)?,
            matched: 0,
            _endpoint: endpoint,
        })
    }
}

impl shapes_peer::Writer for Writer {
    fn matched(&mut self) -> Result<usize> {
        while let Some(status) = self.writer.try_recv_status() {
            match status {
                DataWriterStatus::PublicationMatched { current, .. } => {
                    events::matched(current.count());
                    self.matched = usize::try_from(current.count())?;
                }
                DataWriterStatus::OfferedIncompatibleQos { last_policy_id, .. } => {
                    events::incompatible_qos(policy_name(last_policy_id));
                }
                _ => {}
            }
        }
        Ok(self.matched)
    }

    fn write(&mut self, color: &str, number: i32, size: usize) -> Result<bool> {
        let shape = ShapeType {
            color: color.to_owned(),
            x: number,
            y: number,
            shapesize: 30,
            additional_payload_size: vec![0; size],
        };
        match self.writer.write(shape, None) {
            Ok(()) => Ok(true),
            Err(rustdds::dds::WriteError::WouldBlock { .. }) => Ok(false),
            Err(error) => Err(format!("{error:?}").into()),
        }
    }

    fn dispose(&mut self, color: &str) -> Result<()> {
        let disposed = self.writer.dispose(&color.to_owned(), None);
        disposed.map_err(|error| format!("{error:?}").into())
    }

    fn unregister(&mut self, _color: &str) -> Result<()> {
        Err("RustDDS has no such thing".into())
    }

    fn wait_for_acknowledgments(&mut self, time: Duration) -> Result<bool> {
        let acknowledged = self.writer.wait_for_acknowledgments(time);
        acknowledged.map_err(|error| format!("{error:?}").into())
    }
}

struct Reader {
    reader: DataReaderCdr<ShapeType>,
    _endpoint: Endpoint,
}

impl Reader {
    fn open(options: &Options) -> Result<Self> {
        let endpoint = Endpoint::open(options)?;
        let subscriber = endpoint.participant.create_subscriber(&endpoint.qos)?;
        Ok(Self {
            reader: subscriber.create_datareader_cdr(&endpoint.topic, None)?,
            _endpoint: endpoint,
        })
    }
}

impl shapes_peer::Reader for Reader {
    fn take(&mut self) -> Result<Vec<Taken>> {
        while let Some(status) = self.reader.try_recv_status() {
            match status {
                DataReaderStatus::SubscriptionMatched { current, .. } => {
                    events::matched(current.count());
                }
                DataReaderStatus::RequestedIncompatibleQos { last_policy_id, .. } => {
                    events::incompatible_qos(policy_name(last_policy_id));
                }
                _ => {}
            }
        }
        let mut taken = Vec::new();
        while let Some(sample) = self.reader.take_next_sample()? {
            taken.push(match sample.into_value() {
                Sample::Value(shape) => Taken::Sample {
                    color: shape.color,
                    number: shape.x,
                    size: shape.additional_payload_size.len(),
                },
                Sample::Dispose(color) => Taken::Disposed(color),
            });
        }
        Ok(taken)
    }
}

fn policy_name(policy: QosPolicyId) -> &'static str {
    match policy {
        QosPolicyId::Reliability => "RELIABILITY",
        QosPolicyId::Durability => "DURABILITY",
        QosPolicyId::Deadline => "DEADLINE",
        QosPolicyId::Ownership => "OWNERSHIP",
        _ => "UNKNOWN",
    }
}
