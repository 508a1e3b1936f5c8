//! The expert API: writers and readers of payloads that are serialized already, and a descriptor for event loops.

mod builder;
mod condition;
mod endpoint;
mod group;
mod group_order;
mod loan;
mod raw_reader;
mod raw_writer;
mod template;

use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;

use rtps_user::layer::protocol::MAX_USER_DATA;
use rtps_user::qos::{ContentFilter, Presentation};
use rtps_user::reader::{InstanceOf, ReaderConfig, ReaderTiming};
use rtps_user::wire::{EntityKind, Guid};
use rtps_user::writer::{WriterConfig, WriterTiming};

pub use builder::Builder;
pub use loan::Loan;
pub(crate) use raw_reader::FilterSetter;
pub use raw_reader::{RawReader, RawSamples};
pub use raw_writer::{RawChange, RawWriter};

pub(crate) use self::condition::{Trigger, Watched};
pub(crate) use self::group::Group;
pub(crate) use self::template::Template;

use self::endpoint::EndpointHandle;
use crate::driver::{Core, Driver, Shared};
use crate::error::CreateError;
use crate::link::LayerKind;
use crate::qos::Qos;
use crate::status::{EntityEvent, StatusMask};

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
        self.create_writer_of(Template::new(topic, type_name, qos.into_writer()), has_key)
    }

    pub(crate) fn create_writer_of(
        &self,
        template: Template,
        has_key: bool,
    ) -> Result<RawWriter, CreateError> {
        template.check()?;
        let kind = match has_key {
            true => EntityKind::WriterWithKey,
            false => EntityKind::WriterNoKey,
        };
        let (group, qos) = (template.group.clone(), template.qos.clone());
        let is_enabled = template.is_enabled;
        let guid = self.driver.shared().with(|core, now| {
            let guid = new_guid(core, kind)?;
            core.endpoints.add_writer(WriterConfig {
                guid,
                qos: qos.clone(),
                datagram_size: core.datagram_size(),
                timing: WriterTiming::default(),
            });
            core.declare(now, template.into_declaration(guid.entity));
            Ok(guid)
        })?;
        if let Some(group) = &group {
            group.refresh_writers();
        }
        let endpoint = EndpointHandle::new(&self.driver, guid, group);
        Ok(RawWriter::new(endpoint, &qos, is_enabled))
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
        let template = Template::new(topic, type_name, qos.into_reader());
        self.create_reader_of(template, instance_of)
    }

    pub(crate) fn create_reader_of(
        &self,
        template: Template,
        instance_of: Option<InstanceOf>,
    ) -> Result<RawReader, CreateError> {
        template.check()?;
        let kept = instance_of.clone();
        let kind = match instance_of {
            Some(_) => EntityKind::ReaderWithKey,
            None => EntityKind::ReaderNoKey,
        };
        let group = template.group.clone();
        let guid = self.driver.shared().with(|core, now| {
            let guid = new_guid(core, kind)?;
            core.endpoints.add_reader(ReaderConfig {
                guid,
                qos: template.qos.clone(),
                datagram_size: core.datagram_size(),
                max_sample_size: ReaderConfig::MAX_SAMPLE_SIZE,
                instance_of,
                content_filter: template.payload_filter.clone(),
                filter_signature: template
                    .content_filter
                    .as_ref()
                    .map(ContentFilter::signature),
                timing: ReaderTiming::default(),
            });
            core.declare(now, template.into_declaration(guid.entity));
            core.stage_groups(guid.entity);
            if let Some(group) = &group {
                group.welcome_reader(core, guid.entity);
            }
            Ok(guid)
        })?;
        let endpoint = EndpointHandle::new(&self.driver, guid, group);
        Ok(RawReader::new(endpoint, kept))
    }

    /// Has `listener` called with the events that `mask` holds of all endpoints that have no listener for them, nor
    /// have their publishers and subscribers, by whatever thread drives.
    pub fn set_listener(
        &self,
        mask: StatusMask,
        listener: impl Fn(EntityEvent) + Send + Sync + 'static,
    ) {
        self.driver
            .shared()
            .with(|core, _| core.set_entity_listener(None, mask, Arc::new(listener)));
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        self.driver.shared()
    }

    /// Has others see USER_DATA of the participant.
    pub(crate) fn describe(&self, user_data: Vec<u8>) -> Result<(), CreateError> {
        let (size, limit) = (user_data.len(), MAX_USER_DATA);
        if size > limit {
            return Err(CreateError::UserDataTooLong { size, limit });
        }
        self.driver
            .shared()
            .with(|core, now| core.describe(now, user_data));
        Ok(())
    }

    /// A publisher or subscriber.
    pub(crate) fn create_group(&self, presentation: Presentation) -> Arc<Group> {
        Arc::new(Group::new(&self.driver, presentation))
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
