//! The expert API: writers and readers of payloads that are serialized already, and a descriptor for event loops.

mod builder;
mod endpoint;
mod raw_reader;
mod raw_writer;

use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;

use rtps_user::layer::protocol::{Endpoint, MAX_PROTOCOL_MESSAGE, ToLayer};
use rtps_user::qos::{DataRepresentation, History};
use rtps_user::reader::{InstanceOf, ReaderConfig};
use rtps_user::wire::{EntityId, EntityKind, Guid};
use rtps_user::writer::{WriterConfig, WriterTiming};
use rtps_user::{qos, reader::ReaderTiming};

pub use builder::Builder;
pub use raw_reader::{RawReader, RawSamples};
pub use raw_writer::{RawChange, RawWriter};

use self::endpoint::EndpointHandle;
use crate::driver::{Core, Driver};
use crate::error::CreateError;
use crate::link::{LayerKind, encode};
use crate::qos::Qos;

/// An app's place in a DDS domain.
///
/// Clones are the same place; it is left when the last clone, writer and reader are gone.
#[derive(Clone)]
pub struct RtpsSocket {
    driver: Arc<Driver>,
}

impl RtpsSocket {
    /// Domain, layer and other choices.
    pub fn builder() -> Builder<Self> {
        Builder::new()
    }

    /// The layer that is used.
    pub fn layer(&self) -> LayerKind {
        self.driver.shared().with(|core, _| core.layer())
    }

    /// Creates a writer of payloads of a type; `has_key` says whether the topic has instances.
    ///
    /// # Errors
    /// When the names or policies make no sense.
    pub fn create_writer(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
        has_key: bool,
    ) -> Result<RawWriter, CreateError> {
        let qos = qos.into_writer();
        check(topic, type_name, &qos)?;
        let kind = match has_key {
            true => EntityKind::WriterWithKey,
            false => EntityKind::WriterNoKey,
        };
        let guid = self.driver.shared().with(|core, now| {
            let guid = new_guid(core, kind)?;
            core.endpoints.add_writer(WriterConfig {
                guid,
                qos: qos.clone(),
                datagram_size: core.datagram_size(),
                timing: WriterTiming::default(),
            });
            core.declare(now, endpoint(guid.entity, topic, type_name, qos.clone()));
            Ok(guid)
        })?;
        Ok(RawWriter::new(
            EndpointHandle::new(&self.driver, guid),
            &qos,
        ))
    }

    /// Creates a reader of payloads of a type. `instance_of` finds the instance of a payload whose writer sends no
    /// key hash; a topic has instances if it is there.
    ///
    /// # Errors
    /// When the names or policies make no sense.
    pub fn create_reader(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
        instance_of: Option<InstanceOf>,
    ) -> Result<RawReader, CreateError> {
        let qos = qos.into_reader();
        check(topic, type_name, &qos)?;
        let kept = instance_of.clone();
        let kind = match instance_of {
            Some(_) => EntityKind::ReaderWithKey,
            None => EntityKind::ReaderNoKey,
        };
        let guid = self.driver.shared().with(|core, now| {
            let guid = new_guid(core, kind)?;
            core.endpoints.add_reader(ReaderConfig {
                guid,
                qos: qos.clone(),
                datagram_size: core.datagram_size(),
                max_sample_size: ReaderConfig::MAX_SAMPLE_SIZE,
                instance_of,
                timing: ReaderTiming::default(),
            });
            core.declare(now, endpoint(guid.entity, topic, type_name, qos));
            Ok(guid)
        })?;
        let endpoint = EndpointHandle::new(&self.driver, guid);
        Ok(RawReader::new(endpoint, kept))
    }

    /// Asserts the liveliness of all writers with LIVELINESS MANUAL_BY_PARTICIPANT.
    pub fn assert_liveliness(&self) {
        self.driver
            .shared()
            .with(|core, now| core.assert_liveliness(now));
    }

    /// Takes in what has arrived and does what is due, without waiting: to be called whenever the descriptor that
    /// [`as_fd`](AsFd::as_fd) gives is readable.
    pub fn drive(&self) {
        self.driver.shared().drive();
    }
}

/// For an event loop of any kind. From the first call of `as_fd` on the caller drives: whenever the descriptor is
/// readable, [`drive`](RtpsSocket::drive) is to be called, after which readers may have samples.
impl AsFd for RtpsSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.driver.shared().external_fd()
    }
}

fn new_guid(core: &mut Core, kind: EntityKind) -> Result<Guid, CreateError> {
    if core.is_lost() {
        return Err(CreateError::LayerLost);
    }
    core.new_guid(kind).ok_or(CreateError::TooManyEndpoints)
}

fn endpoint(entity: EntityId, topic: &str, type_name: &str, qos: qos::Qos) -> Endpoint {
    Endpoint {
        entity,
        topic: topic.to_owned(),
        type_name: type_name.to_owned(),
        type_information: Vec::new(),
        type_objects: Vec::new(),
        content_filter: None,
        qos,
    }
}

/// Refuses what no endpoint can be created with.
fn check(topic: &str, type_name: &str, qos: &qos::Qos) -> Result<(), CreateError> {
    for name in [topic, type_name] {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return Err(CreateError::InvalidName(name.to_owned()));
        }
    }
    if qos.representation.contains(&DataRepresentation::Xml) {
        return Err(CreateError::UnsupportedRepresentation);
    }
    check_size(topic, type_name, qos)?;
    match (qos.history, qos.resource_limits.max_samples_per_instance) {
        (History::KeepLast(0), _) => Err(CreateError::NoHistory),
        (History::KeepLast(depth), Some(limit)) if depth > limit => {
            Err(CreateError::InconsistentLimits { depth, limit })
        }
        _ => Ok(()),
    }
}

/// Refuses what does not fit in one packet of the layer protocol.
fn check_size(topic: &str, type_name: &str, qos: &qos::Qos) -> Result<(), CreateError> {
    // As long as any.
    let entity = EntityId::of_app(u8::MAX, u16::MAX, EntityKind::WriterNoKey);
    let endpoint = endpoint(entity, topic, type_name, qos.clone());
    let declaration = ToLayer::Declare(Box::new(endpoint));
    let (size, limit) = (encode(&declaration).len(), MAX_PROTOCOL_MESSAGE);
    match size > limit {
        true => Err(CreateError::TooLarge { size, limit }),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_refused() {
        let qos = Qos::default().into_writer();
        assert_eq!(check("Square", "ShapeType", &qos), Ok(()));
        let long = "x".repeat(256);
        for (topic, type_name) in [("", "T"), ("T", ""), (&long, "T"), ("a\0b", "T")] {
            assert!(matches!(
                check(topic, type_name, &qos),
                Err(CreateError::InvalidName(_))
            ));
        }
        let nothing = Qos::default().keep_last(0).into_writer();
        assert_eq!(check("T", "T", &nothing), Err(CreateError::NoHistory));
        let limits = Qos::default()
            .keep_last(9)
            .resource_limits(None, None, Some(3))
            .into_writer();
        assert_eq!(
            check("T", "T", &limits),
            Err(CreateError::InconsistentLimits { depth: 9, limit: 3 })
        );
        let much = Qos::default()
            .user_data([1; 60_000])
            .group_data([1; 60_000]);
        let too_much = much.clone().topic_data([1; 20_000]).into_writer();
        assert_eq!(check("T", "T", &much.into_writer()), Ok(()));
        assert!(matches!(
            check("T", "T", &too_much),
            Err(CreateError::TooLarge {
                limit: MAX_PROTOCOL_MESSAGE,
                ..
            })
        ));
    }
}
