//! Policies as parameters of discovery data (RTPS 2.5 section 9.6.3.2 and table 9.14; XTypes 1.3 section 7.6.3.1.2).
//!
//! What is absent has the default of its policy, which for RELIABILITY depends on the kind of the endpoint.

use super::{
    DataRepresentation, Deadline, DestinationOrder, Durability, DurabilityService, History,
    LatencyBudget, Lifespan, Liveliness, LivelinessKind, Ownership, Partition, Presentation,
    PresentationScope, Qos, Reliability, ResourceLimits, TimeBasedFilter, TypeConsistency,
};
use crate::wire::{Cursor, Duration, ParameterId, ParameterWriter, WireError};

const TIME_BASED_FILTER: ParameterId = ParameterId(0x0004);
const OWNERSHIP_STRENGTH: ParameterId = ParameterId(0x0006);
const RELIABILITY: ParameterId = ParameterId(0x001a);
const LIVELINESS: ParameterId = ParameterId(0x001b);
const DURABILITY: ParameterId = ParameterId(0x001d);
const DURABILITY_SERVICE: ParameterId = ParameterId(0x001e);
const OWNERSHIP: ParameterId = ParameterId(0x001f);
const PRESENTATION: ParameterId = ParameterId(0x0021);
const DEADLINE: ParameterId = ParameterId(0x0023);
const DESTINATION_ORDER: ParameterId = ParameterId(0x0025);
const LATENCY_BUDGET: ParameterId = ParameterId(0x0027);
const PARTITION: ParameterId = ParameterId(0x0029);
const LIFESPAN: ParameterId = ParameterId::LIFESPAN;
/// USER_DATA of a participant or an endpoint.
pub(crate) const USER_DATA: ParameterId = ParameterId(0x002c);
const GROUP_DATA: ParameterId = ParameterId(0x002d);
const TOPIC_DATA: ParameterId = ParameterId(0x002e);
const HISTORY: ParameterId = ParameterId(0x0040);
const RESOURCE_LIMITS: ParameterId = ParameterId(0x0041);
const TRANSPORT_PRIORITY: ParameterId = ParameterId(0x0049);
const DATA_REPRESENTATION: ParameterId = ParameterId(0x0073);
const TYPE_CONSISTENCY_ENFORCEMENT: ParameterId = ParameterId(0x0074);

/// The most partitions, and the most bytes of a partition's name, that are taken from the wire: both bound the
/// time that matching may take.
const MAX_PARTITIONS: usize = 256;
const MAX_PARTITION_NAME: usize = 256;

/// Gathers policies from parameters in any order.
#[derive(Debug)]
pub(crate) struct QosParameters {
    qos: Qos,
    exclusive: bool,
    strength: i32,
}

impl QosParameters {
    /// The defaults for a writer or a reader (DDS 1.4 section 2.2.3, table).
    pub(crate) fn new(writer: bool) -> Self {
        let reliability = if writer {
            Reliability::RELIABLE
        } else {
            Reliability::BestEffort
        };
        Self {
            qos: Qos {
                reliability,
                ..Qos::default()
            },
            exclusive: false,
            strength: 0,
        }
    }

    /// Takes a parameter; false where it is not one of a policy.
    pub(crate) fn read(
        &mut self,
        id: ParameterId,
        value: &mut Cursor<'_>,
    ) -> Result<bool, WireError> {
        let qos = &mut self.qos;
        match id {
            RELIABILITY => qos.reliability = read_reliability(value)?,
            DURABILITY => qos.durability = read_durability(value)?,
            DURABILITY_SERVICE => qos.durability_service = read_durability_service(value)?,
            HISTORY => qos.history = read_history(value)?,
            RESOURCE_LIMITS => qos.resource_limits = read_resource_limits(value)?,
            DEADLINE => qos.deadline = Deadline(read_duration(value)?),
            LATENCY_BUDGET => qos.latency_budget = LatencyBudget(read_duration(value)?),
            LIVELINESS => qos.liveliness = read_liveliness(value)?,
            OWNERSHIP => self.exclusive = read_flag(value)?,
            OWNERSHIP_STRENGTH => self.strength = value.i32()?,
            DESTINATION_ORDER => {
                qos.destination_order = if read_flag(value)? {
                    DestinationOrder::BySourceTimestamp
                } else {
                    DestinationOrder::ByReceptionTimestamp
                }
            }
            PRESENTATION => qos.presentation = read_presentation(value)?,
            PARTITION => qos.partition = read_partition(value)?,
            LIFESPAN => qos.lifespan = Lifespan(read_duration(value)?),
            TIME_BASED_FILTER => qos.time_based_filter = TimeBasedFilter(read_duration(value)?),
            TRANSPORT_PRIORITY => qos.transport_priority = value.i32()?,
            DATA_REPRESENTATION => qos.representation = read_representation(value)?,
            TYPE_CONSISTENCY_ENFORCEMENT => qos.type_consistency = read_type_consistency(value)?,
            USER_DATA => qos.user_data = read_octets(value)?,
            TOPIC_DATA => qos.topic_data = read_octets(value)?,
            GROUP_DATA => qos.group_data = read_octets(value)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// What has been gathered.
    pub(crate) fn finish(self) -> Qos {
        let ownership = if self.exclusive {
            Ownership::Exclusive {
                strength: self.strength,
            }
        } else {
            Ownership::Shared
        };
        Qos {
            ownership,
            ..self.qos
        }
    }
}

/// Writes what a writer or reader announces: RELIABILITY, DURABILITY and DATA_REPRESENTATION in any case, of the
/// rest what is not the default.
pub(crate) fn write_qos(qos: &Qos, writer: bool, list: &mut ParameterWriter<'_>) {
    let default = Qos::default();
    write_reliability(qos.reliability, list);
    write_u32(list, DURABILITY, qos.durability as u32);
    write_representation(&qos.representation, list);
    if qos.history != default.history {
        list.parameter(HISTORY, |out| write_history(qos.history, out));
    }
    if qos.resource_limits != default.resource_limits {
        list.parameter(RESOURCE_LIMITS, |out| {
            write_resource_limits(qos.resource_limits, out)
        });
    }
    if qos.liveliness != default.liveliness {
        list.parameter(LIVELINESS, |out| {
            out.extend_from_slice(&(qos.liveliness.kind as u32).to_le_bytes());
            qos.liveliness.lease.encode(out);
        });
    }
    write_duration(list, DEADLINE, qos.deadline.0, default.deadline.0);
    write_duration(
        list,
        LATENCY_BUDGET,
        qos.latency_budget.0,
        default.latency_budget.0,
    );
    if qos.destination_order != default.destination_order {
        write_u32(list, DESTINATION_ORDER, qos.destination_order as u32);
    }
    if qos.presentation != default.presentation {
        write_presentation(qos.presentation, list);
    }
    if qos.partition != default.partition {
        write_partition(&qos.partition, list);
    }
    write_octets(list, USER_DATA, &qos.user_data);
    write_octets(list, TOPIC_DATA, &qos.topic_data);
    write_octets(list, GROUP_DATA, &qos.group_data);
    write_ownership(qos.ownership, writer, list);
    match writer {
        true => write_of_writer(qos, &default, list),
        false => write_of_reader(qos, &default, list),
    }
}

/// Writes what each sample says to readers that expect inline QoS (RTPS 2.5 section 8.7.2.1, table): the topic, and the
/// policies of its writer that a reader acts on.
pub(crate) fn write_inline_qos(qos: &Qos, topic: &str, list: &mut ParameterWriter<'_>) {
    let Qos {
        history,
        resource_limits,
        durability_service,
        ..
    } = Qos::default();
    let inline = Qos {
        history,
        resource_limits,
        durability_service,
        user_data: Vec::new(),
        topic_data: Vec::new(),
        group_data: Vec::new(),
        ..qos.clone()
    };
    list.parameter(ParameterId::TOPIC_NAME, |out| write_string(topic, out));
    write_qos(&inline, true, list);
}

fn write_of_writer(qos: &Qos, default: &Qos, list: &mut ParameterWriter<'_>) {
    if qos.durability_service != default.durability_service {
        write_durability_service(&qos.durability_service, list);
    }
    write_duration(list, LIFESPAN, qos.lifespan.0, default.lifespan.0);
    if qos.transport_priority != 0 {
        let priority = qos.transport_priority.cast_unsigned();
        write_u32(list, TRANSPORT_PRIORITY, priority);
    }
}

fn write_of_reader(qos: &Qos, default: &Qos, list: &mut ParameterWriter<'_>) {
    let (separation, none) = (qos.time_based_filter.0, default.time_based_filter.0);
    write_duration(list, TIME_BASED_FILTER, separation, none);
    if qos.type_consistency != default.type_consistency {
        write_type_consistency(qos.type_consistency, list);
    }
}

/// Vendors write infinity differently; comparisons need it in one form.
fn read_duration(value: &mut Cursor<'_>) -> Result<Duration, WireError> {
    let duration = Duration::decode(value)?;
    Ok(if duration.is_infinite() {
        Duration::INFINITE
    } else {
        duration
    })
}

fn read_flag(value: &mut Cursor<'_>) -> Result<bool, WireError> {
    match value.u32()? {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(WireError::InvalidParameterList),
    }
}

/// On the wire BEST_EFFORT is 1 and RELIABLE 2, one more than in DDS (RTPS table 9.4).
fn read_reliability(value: &mut Cursor<'_>) -> Result<Reliability, WireError> {
    match value.u32()? {
        1 => Ok(Reliability::BestEffort),
        2 => Ok(Reliability::Reliable {
            max_blocking_time: read_duration(value)?,
        }),
        _ => Err(WireError::InvalidParameterList),
    }
}

fn write_reliability(reliability: Reliability, list: &mut ParameterWriter<'_>) {
    let (kind, max_blocking_time) = match reliability {
        Reliability::BestEffort => (1_u32, Duration::ZERO),
        Reliability::Reliable { max_blocking_time } => (2, max_blocking_time),
    };
    list.parameter(RELIABILITY, |out| {
        out.extend_from_slice(&kind.to_le_bytes());
        max_blocking_time.encode(out);
    });
}

fn read_durability(value: &mut Cursor<'_>) -> Result<Durability, WireError> {
    match value.u32()? {
        0 => Ok(Durability::Volatile),
        1 => Ok(Durability::TransientLocal),
        2 => Ok(Durability::Transient),
        3 => Ok(Durability::Persistent),
        _ => Err(WireError::InvalidParameterList),
    }
}

fn read_history(value: &mut Cursor<'_>) -> Result<History, WireError> {
    let (kind, depth) = (value.u32()?, value.i32()?);
    match kind {
        0 => Ok(History::KeepLast(depth.max(1).cast_unsigned())),
        1 => Ok(History::KeepAll),
        _ => Err(WireError::InvalidParameterList),
    }
}

fn write_history(history: History, out: &mut Vec<u8>) {
    let (kind, depth) = match history {
        History::KeepLast(depth) => (0_u32, depth.min(i32::MAX.cast_unsigned())),
        History::KeepAll => (1, 0),
    };
    out.extend_from_slice(&kind.to_le_bytes());
    out.extend_from_slice(&depth.to_le_bytes());
}

/// LENGTH_UNLIMITED is -1.
fn read_resource_limits(value: &mut Cursor<'_>) -> Result<ResourceLimits, WireError> {
    let mut limit = || Ok(u32::try_from(value.i32()?).ok());
    Ok(ResourceLimits {
        max_samples: limit()?,
        max_instances: limit()?,
        max_samples_per_instance: limit()?,
    })
}

fn write_resource_limits(limits: ResourceLimits, out: &mut Vec<u8>) {
    for limit in [
        limits.max_samples,
        limits.max_instances,
        limits.max_samples_per_instance,
    ] {
        let limit = limit.map_or(-1, |limit| i32::try_from(limit).unwrap_or(i32::MAX));
        out.extend_from_slice(&limit.to_le_bytes());
    }
}

fn read_durability_service(value: &mut Cursor<'_>) -> Result<DurabilityService, WireError> {
    Ok(DurabilityService {
        cleanup_delay: read_duration(value)?,
        history: read_history(value)?,
        resource_limits: read_resource_limits(value)?,
    })
}

fn write_durability_service(service: &DurabilityService, list: &mut ParameterWriter<'_>) {
    list.parameter(DURABILITY_SERVICE, |out| {
        service.cleanup_delay.encode(out);
        write_history(service.history, out);
        write_resource_limits(service.resource_limits, out);
    });
}

fn read_liveliness(value: &mut Cursor<'_>) -> Result<Liveliness, WireError> {
    let kind = match value.u32()? {
        0 => LivelinessKind::Automatic,
        1 => LivelinessKind::ManualByParticipant,
        2 => LivelinessKind::ManualByTopic,
        _ => return Err(WireError::InvalidParameterList),
    };
    Ok(Liveliness {
        kind,
        lease: read_duration(value)?,
    })
}

fn write_ownership(ownership: Ownership, writer: bool, list: &mut ParameterWriter<'_>) {
    if let Ownership::Exclusive { strength } = ownership {
        write_u32(list, OWNERSHIP, 1);
        if writer {
            write_u32(list, OWNERSHIP_STRENGTH, strength.cast_unsigned());
        }
    }
}

fn read_presentation(value: &mut Cursor<'_>) -> Result<Presentation, WireError> {
    let scope = match value.u32()? {
        0 => PresentationScope::Instance,
        1 => PresentationScope::Topic,
        2 => PresentationScope::Group,
        _ => return Err(WireError::InvalidParameterList),
    };
    Ok(Presentation {
        scope,
        coherent: value.u8()? != 0,
        ordered: value.u8()? != 0,
    })
}

fn write_presentation(presentation: Presentation, list: &mut ParameterWriter<'_>) {
    list.parameter(PRESENTATION, |out| {
        out.extend_from_slice(&(presentation.scope as u32).to_le_bytes());
        out.push(u8::from(presentation.coherent));
        out.push(u8::from(presentation.ordered));
    });
}

fn read_partition(value: &mut Cursor<'_>) -> Result<Partition, WireError> {
    let count = usize::try_from(value.u32()?).map_err(|_| WireError::InvalidParameterList)?;
    if count > MAX_PARTITIONS {
        return Err(WireError::InvalidParameterList);
    }
    let names = (0..count).map(|_| match value.string() {
        Ok(name) if name.len() <= MAX_PARTITION_NAME => Ok(name.to_owned()),
        Ok(_) => Err(WireError::InvalidParameterList),
        Err(error) => Err(error),
    });
    names.collect::<Result<_, _>>().map(Partition)
}

fn write_partition(partition: &Partition, list: &mut ParameterWriter<'_>) {
    list.parameter(PARTITION, |out| {
        let start = out.len();
        out.extend_from_slice(&(partition.0.len() as u32).to_le_bytes());
        for name in &partition.0 {
            let aligned = (out.len() - start).next_multiple_of(4);
            out.resize(start + aligned, 0);
            write_string(name, out);
        }
    });
}

/// A list of ids; what is neither XCDR1, XML nor XCDR2 is left out.
fn read_representation(value: &mut Cursor<'_>) -> Result<Vec<DataRepresentation>, WireError> {
    let count = usize::try_from(value.u32()?).map_err(|_| WireError::InvalidParameterList)?;
    let ids = value.take(count.checked_mul(2).ok_or(WireError::UnexpectedEnd)?)?;
    let mut ids = Cursor::new(ids, value.endianness());
    let mut list = Vec::new();
    while let Ok(id) = ids.u16() {
        match id {
            0 => list.push(DataRepresentation::Xcdr1),
            1 => list.push(DataRepresentation::Xml),
            2 => list.push(DataRepresentation::Xcdr2),
            _ => {}
        }
    }
    Ok(list)
}

fn write_representation(representation: &[DataRepresentation], list: &mut ParameterWriter<'_>) {
    list.parameter(DATA_REPRESENTATION, |out| {
        out.extend_from_slice(&(representation.len() as u32).to_le_bytes());
        for id in representation {
            let id: u16 = match id {
                DataRepresentation::Xcdr1 => 0,
                DataRepresentation::Xml => 1,
                DataRepresentation::Xcdr2 => 2,
            };
            out.extend_from_slice(&id.to_le_bytes());
        }
    });
}

/// The kind of 16 bits, then the flags; those that a sender leaves out have their defaults.
fn read_type_consistency(value: &mut Cursor<'_>) -> Result<TypeConsistency, WireError> {
    let default = TypeConsistency::default();
    let allow_coercion = value.u16()? != 0;
    let mut flag = |default| value.u8().map_or(default, |flag| flag != 0);
    Ok(TypeConsistency {
        allow_coercion,
        ignore_sequence_bounds: flag(default.ignore_sequence_bounds),
        ignore_string_bounds: flag(default.ignore_string_bounds),
        ignore_member_names: flag(default.ignore_member_names),
        prevent_type_widening: flag(default.prevent_type_widening),
        force_type_validation: flag(default.force_type_validation),
    })
}

fn write_type_consistency(consistency: TypeConsistency, list: &mut ParameterWriter<'_>) {
    list.parameter(TYPE_CONSISTENCY_ENFORCEMENT, |out| {
        out.extend_from_slice(&u16::from(consistency.allow_coercion).to_le_bytes());
        out.extend(
            [
                consistency.ignore_sequence_bounds,
                consistency.ignore_string_bounds,
                consistency.ignore_member_names,
                consistency.prevent_type_widening,
                consistency.force_type_validation,
            ]
            .map(u8::from),
        );
    });
}

/// A sequence of octets.
pub(crate) fn read_octets(value: &mut Cursor<'_>) -> Result<Vec<u8>, WireError> {
    let count = usize::try_from(value.u32()?).map_err(|_| WireError::InvalidParameterList)?;
    value.take(count).map(<[u8]>::to_vec)
}

pub(crate) fn write_octets(list: &mut ParameterWriter<'_>, id: ParameterId, octets: &[u8]) {
    if !octets.is_empty() {
        list.parameter(id, |out| {
            out.extend_from_slice(&(octets.len() as u32).to_le_bytes());
            out.extend_from_slice(octets);
        });
    }
}

/// Appends a CDR string: its length with the NUL, the characters, the NUL.
pub(crate) fn write_string(string: &str, out: &mut Vec<u8>) {
    out.extend_from_slice(&(string.len() as u32 + 1).to_le_bytes());
    out.extend_from_slice(string.as_bytes());
    out.push(0);
}

fn write_u32(list: &mut ParameterWriter<'_>, id: ParameterId, value: u32) {
    list.parameter(id, |out| out.extend_from_slice(&value.to_le_bytes()));
}

fn write_duration(
    list: &mut ParameterWriter<'_>,
    id: ParameterId,
    value: Duration,
    default: Duration,
) {
    if value != default {
        list.parameter(id, |out| value.encode(out));
    }
}
