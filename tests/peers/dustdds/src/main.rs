//! A publisher or subscriber of ShapeType on dust_dds.

use std::collections::HashMap;
use std::process::ExitCode;
use std::time::Duration;

use dust_dds::dds_async::data_reader::DataReaderAsync;
use dust_dds::dds_async::data_writer::DataWriterAsync;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::instance::InstanceHandle;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{
    DataReaderQos, DataWriterQos, PublisherQos, QosKind, SubscriberQos,
};
use dust_dds::infrastructure::qos_policy::{
    DataRepresentationQosPolicy, DeadlineQosPolicy, DurabilityQosPolicy, DurabilityQosPolicyKind, HistoryQosPolicy, HistoryQosPolicyKind,
    PartitionQosPolicy, ReliabilityQosPolicy, ReliabilityQosPolicyKind,
    WriterDataLifecycleQosPolicy, XCDR_DATA_REPRESENTATION, XCDR2_DATA_REPRESENTATION,
};
use dust_dds::infrastructure::sample_info::{
    ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind, Sample,
};
use dust_dds::infrastructure::status::{
    NO_STATUS, OfferedIncompatibleQosStatus, PublicationMatchedStatus,
    RequestedIncompatibleQosStatus, StatusKind, SubscriptionMatchedStatus,
};
use dust_dds::infrastructure::time::DurationKind;
use dust_dds::infrastructure::type_support::DdsType;
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::data_writer_listener::DataWriterListener;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::data_reader_listener::DataReaderListener;
use dust_dds::topic_definition::topic::Topic;
use shapes_peer::{Durability, Options, Result, Taken, events};

#[derive(Clone, Debug, DdsType)]
#[dust_dds(name = "ShapeType", extensibility = "appendable")]
struct ShapeType {
    #[dust_dds(key)]
    color: String,
    x: i32,
    y: i32,
    shapesize: i32,
    additional_payload_size: Vec<u8>,
}

impl ShapeType {
    fn new(color: &str, number: i32, size: usize) -> Self {
        Self {
            color: color.to_owned(),
            x: number,
            y: number,
            shapesize: 30,
            additional_payload_size: vec![0; size],
        }
    }
}

fn main() -> ExitCode {
    shapes_peer::run(Writer::open, Reader::open)
}

/// A participant that says goodbye.
struct Participant(DomainParticipant);

impl Drop for Participant {
    fn drop(&mut self) {
        let factory = DomainParticipantFactory::get_instance();
        let deleted = self.0.delete_contained_entities();
        if let Err(error) = deleted.and_then(|()| factory.delete_participant(&self.0)) {
            events::error(&format!("{error:?}"));
        }
    }
}

fn open(options: &Options) -> Result<(Participant, Topic)> {
    let factory = DomainParticipantFactory::get_instance();
    factory
        .get_mut_transport()
        .set_interface_name(options.interface.clone());
    let domain = i32::from(options.domain);
    let participant = factory
        .create_participant(domain, QosKind::Default, NO_LISTENER, NO_STATUS)
        .map_err(failed)?;
    let participant = Participant(participant);
    let topic = participant
        .0
        .create_topic::<ShapeType>(
            &options.topic,
            "ShapeType",
            QosKind::Default,
            NO_LISTENER,
            NO_STATUS,
        )
        .map_err(failed)?;
    Ok((participant, topic))
}

fn failed(error: DdsError) -> shapes_peer::Error {
    format!("{error:?}").into()
}

fn reliability(options: &Options) -> ReliabilityQosPolicy {
    let kind = match options.best_effort {
        true => ReliabilityQosPolicyKind::BestEffort,
        false => ReliabilityQosPolicyKind::Reliable,
    };
    ReliabilityQosPolicy {
        kind,
        max_blocking_time: DurationKind::Finite(time(Duration::from_secs(10))),
    }
}

fn durability(options: &Options) -> DurabilityQosPolicy {
    let kind = match options.durability {
        Durability::Volatile => DurabilityQosPolicyKind::Volatile,
        Durability::TransientLocal => DurabilityQosPolicyKind::TransientLocal,
    };
    DurabilityQosPolicy { kind }
}

fn history(options: &Options) -> HistoryQosPolicy {
    let kind = match options.keep_last {
        Some(depth) => HistoryQosPolicyKind::KeepLast(depth),
        None => HistoryQosPolicyKind::KeepAll,
    };
    HistoryQosPolicy { kind }
}

fn deadline(options: &Options) -> DeadlineQosPolicy {
    let period = options.deadline_ms.map(Duration::from_millis);
    DeadlineQosPolicy {
        period: period.map_or(DurationKind::Infinite, |period| {
            DurationKind::Finite(time(period))
        }),
    }
}

fn representation(options: &Options) -> DataRepresentationQosPolicy {
    let id = match options.xcdr {
        2 => XCDR2_DATA_REPRESENTATION,
        _ => XCDR_DATA_REPRESENTATION,
    };
    DataRepresentationQosPolicy { value: vec![id] }
}

fn partition(options: &Options) -> PartitionQosPolicy {
    PartitionQosPolicy {
        name: options.partition.iter().cloned().collect(),
    }
}

fn time(time: Duration) -> dust_dds::infrastructure::time::Duration {
    let seconds = i32::try_from(time.as_secs()).unwrap_or(i32::MAX);
    dust_dds::infrastructure::time::Duration::new(seconds, time.subsec_nanos())
}

struct Listener;

impl DataWriterListener<ShapeType> for Listener {
    async fn on_publication_matched(
        &mut self,
        _writer: DataWriterAsync<ShapeType>,
        status: PublicationMatchedStatus,
    ) {
        events::matched(status.current_count);
    }

    async fn on_offered_incompatible_qos(
        &mut self,
        _writer: DataWriterAsync<ShapeType>,
        status: OfferedIncompatibleQosStatus,
    ) {
        events::incompatible_qos(policy_name(status.last_policy_id));
    }
}

impl DataReaderListener<ShapeType> for Listener {
    async fn on_subscription_matched(
        &mut self,
        _reader: DataReaderAsync<ShapeType>,
        status: SubscriptionMatchedStatus,
    ) {
        events::matched(status.current_count);
    }

    async fn on_requested_incompatible_qos(
        &mut self,
        _reader: DataReaderAsync<ShapeType>,
        status: RequestedIncompatibleQosStatus,
    ) {
        events::incompatible_qos(policy_name(status.last_policy_id));
    }
}

/// By their numbers in DDS 1.4, 2.3.3.
fn policy_name(policy: i32) -> &'static str {
    match policy {
        2 => "DURABILITY",
        4 => "DEADLINE",
        6 => "OWNERSHIP",
        11 => "RELIABILITY",
        _ => "UNKNOWN",
    }
}

struct Writer {
    writer: DataWriter<ShapeType>,
    _participant: Participant,
}

impl Writer {
    fn open(options: &Options) -> Result<Self> {
        let (participant, topic) = open(options)?;
        let group = PublisherQos {
            partition: partition(options),
            ..Default::default()
        };
        let publisher = participant
            .0
            .create_publisher(QosKind::Specific(group), NO_LISTENER, NO_STATUS)
            .map_err(failed)?;
        let qos = DataWriterQos {
            reliability: reliability(options),
            durability: durability(options),
            history: history(options),
            deadline: deadline(options),
            representation: representation(options),
            writer_data_lifecycle: WriterDataLifecycleQosPolicy {
                autodispose_unregistered_instances: false,
            },
            ..Default::default()
        };
        let statuses = [
            StatusKind::PublicationMatched,
            StatusKind::OfferedIncompatibleQos,
        ];
        let writer = publisher
            .create_datawriter(&topic, QosKind::Specific(qos), Some(Listener), &statuses)
            .map_err(failed)?;
        Ok(Self {
            writer,
            _participant: participant,
        })
    }
}

impl shapes_peer::Writer for Writer {
    fn matched(&mut self) -> Result<usize> {
        let subscriptions = self.writer.get_matched_subscriptions().map_err(failed)?;
        Ok(subscriptions.len())
    }

    fn write(&mut self, color: &str, number: i32, size: usize) -> Result<bool> {
        let shape = ShapeType::new(color, number, size);
        match self.writer.write(shape, None) {
            Ok(()) => Ok(true),
            Err(DdsError::Timeout) => Ok(false),
            Err(error) => Err(failed(error)),
        }
    }

    fn dispose(&mut self, color: &str) -> Result<()> {
        let shape = ShapeType::new(color, 0, 0);
        self.writer.dispose(shape, None).map_err(failed)
    }

    fn unregister(&mut self, color: &str) -> Result<()> {
        let shape = ShapeType::new(color, 0, 0);
        self.writer.unregister_instance(shape, None).map_err(failed)
    }

    fn wait_for_acknowledgments(&mut self, left: Duration) -> Result<bool> {
        match self.writer.wait_for_acknowledgments(time(left)) {
            Ok(()) => Ok(true),
            Err(DdsError::Timeout) => Ok(false),
            Err(error) => Err(failed(error)),
        }
    }
}

struct Reader {
    reader: DataReader<ShapeType>,
    /// What ends an instance says only which it is.
    colors: HashMap<InstanceHandle, String>,
    _participant: Participant,
}

impl Reader {
    fn open(options: &Options) -> Result<Self> {
        let (participant, topic) = open(options)?;
        let group = SubscriberQos {
            partition: partition(options),
            ..Default::default()
        };
        let subscriber = participant
            .0
            .create_subscriber(QosKind::Specific(group), NO_LISTENER, NO_STATUS)
            .map_err(failed)?;
        let qos = DataReaderQos {
            reliability: reliability(options),
            durability: durability(options),
            history: history(options),
            deadline: deadline(options),
            representation: representation(options),
            ..Default::default()
        };
        let statuses = [
            StatusKind::SubscriptionMatched,
            StatusKind::RequestedIncompatibleQos,
        ];
        let reader = subscriber
            .create_datareader(&topic, QosKind::Specific(qos), Some(Listener), &statuses)
            .map_err(failed)?;
        Ok(Self {
            reader,
            colors: HashMap::new(),
            _participant: participant,
        })
    }

    fn taken(&mut self, sample: Sample<ShapeType>) -> Option<Taken> {
        let info = sample.sample_info;
        if info.valid_data {
            let shape = sample.data?;
            self.colors
                .insert(info.instance_handle, shape.color.clone());
            return Some(Taken::Sample {
                color: shape.color,
                number: shape.x,
                size: shape.additional_payload_size.len(),
            });
        }
        let color = self.colors.get(&info.instance_handle).cloned();
        let color = color.unwrap_or_default();
        match info.instance_state {
            InstanceStateKind::Alive => None,
            InstanceStateKind::NotAliveDisposed => Some(Taken::Disposed(color)),
            InstanceStateKind::NotAliveNoWriters => Some(Taken::Unregistered(color)),
        }
    }
}

impl shapes_peer::Reader for Reader {
    fn take(&mut self) -> Result<Vec<Taken>> {
        let taken = self
            .reader
            .take(64, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE);
        match taken {
            Ok(samples) => Ok(samples
                .into_iter()
                .filter_map(|sample| self.taken(sample))
                .collect()),
            Err(DdsError::NoData) => Ok(Vec::new()),
            Err(error) => Err(failed(error)),
        }
    }
}
