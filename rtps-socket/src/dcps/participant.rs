//! DomainParticipant (DDS 1.4 section 2.2.2.2.1).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use rtps_user::RemoteEndpoint;
use rtps_user::wire::{EntityId, Guid, GuidPrefix};

use super::{
    BuiltinTopics, ContentFilteredTopic, DataReader, DataWriter, Publisher, StatusCondition,
    Subscriber, Topic, TopicDescription,
};
use crate::cdr::DdsType;
use crate::driver::{Core, Ignore, Scope};
use crate::error::{CreateError, FilterError, OpenError, SetQosError};
use crate::qos::Qos;
use crate::socket::{Builder, RtpsSocket, Template, Trigger, Watched};
use crate::status::{EntityEvent, StatusMask};

/// An app's place in a DDS domain.
///
/// Clones are the same participant; the domain is left when the last clone and everything made from it are gone.
///
/// ```no_run
/// use rtps_socket::{DdsType, DomainParticipant, Qos};
///
/// #[derive(DdsType)]
/// struct Greeting {
///     text: String,
/// }
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let participant = DomainParticipant::new(0)?;
/// let topic = participant.create_topic::<Greeting>("Greetings")?;
/// let writer = participant.create_writer(&topic, Qos::reliable())?;
/// writer.write(&Greeting { text: "hello".to_owned() })?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct DomainParticipant {
    socket: RtpsSocket,
    leaves_disabled: Arc<AtomicBool>,
}

impl DomainParticipant {
    /// Joins a domain, 0 to 232.
    ///
    /// # Errors
    /// When no layer can be used; the error says what to do.
    pub fn new(domain: u32) -> Result<Self, OpenError> {
        Self::builder().domain(domain).open()
    }

    /// Domain, layer and other choices.
    pub fn builder() -> Builder<Self> {
        Builder::new()
    }

    /// The expert API of the same participant.
    pub fn socket(&self) -> &RtpsSocket {
        &self.socket
    }

    /// A topic with samples of type `T`.
    ///
    /// # Errors
    /// When the name cannot be one.
    pub fn create_topic<T: DdsType>(&self, name: &str) -> Result<Topic<T>, CreateError> {
        Topic::new(&self.socket, name, Qos::default())
    }

    /// A topic with policies that its writers and readers may be created with ([`Topic::qos`]).
    ///
    /// # Errors
    /// When the name cannot be one, or the policies contradict each other.
    pub fn create_topic_with<T: DdsType>(
        &self,
        name: &str,
        qos: Qos,
    ) -> Result<Topic<T>, CreateError> {
        Topic::new(&self.socket, name, qos)
    }

    /// A topic as readers see it that want only the samples for which an expression of DDS 1.4 annex B is true;
    /// `parameters` stand for `%0`, `%1` and so on in it. The name is not seen by others.
    ///
    /// # Errors
    /// When the expression is none, or does not fit the type.
    pub fn create_content_filtered_topic<T: DdsType>(
        &self,
        name: &str,
        topic: &Topic<T>,
        expression: &str,
        parameters: &[&str],
    ) -> Result<ContentFilteredTopic<T>, FilterError> {
        ContentFilteredTopic::new(name, topic, expression, parameters)
    }

    /// The topic of that name, once somebody else has an endpoint of it with the type's name; `None` when there is none
    /// before `timeout`. A topic that is known to be there need not be found: [`create_topic`](Self::create_topic).
    pub fn find_topic<T: DdsType>(&self, name: &str, timeout: Duration) -> Option<Topic<T>> {
        let deadline = Instant::now().checked_add(timeout);
        self.socket.shared().with(Core::browse);
        let found = self.socket.shared().wait_until(deadline, |core, _| {
            let mut endpoints = core.known_endpoints();
            let is_it = |(_, endpoint): (u64, &RemoteEndpoint)| {
                endpoint.topic == name && endpoint.type_name == T::TYPE_NAME
            };
            endpoints.any(is_it).then_some(())
        });
        found.and_then(|()| Topic::new(&self.socket, name, Qos::default()).ok())
    }

    /// What is known of the domain: participants, topics, and the endpoints of others. From the first call on the layer
    /// tells of all of them.
    pub fn builtin(&self) -> BuiltinTopics {
        BuiltinTopics::new(self.socket.clone())
    }

    /// Behaves from now on as if a remote participant did not exist: matches with its endpoints end, and nothing of it is
    /// seen in the built-in topics. With the [own prefix](Self::guid) this app's writers and readers do not match each
    /// other.
    ///
    /// This and the other `ignore_*` cannot be undone. The other side is not told: it goes on counting the match, and a
    /// reliable writer there waits for acknowledgements as of a reader that has stopped.
    pub fn ignore_participant(&self, participant: GuidPrefix) {
        self.ignore(Ignore::Participant(participant));
    }

    /// Behaves from now on as if a writer did not exist, as [`ignore_participant`](Self::ignore_participant) does.
    pub fn ignore_publication(&self, writer: Guid) {
        self.ignore(Ignore::Endpoint(writer));
    }

    /// Behaves from now on as if a reader did not exist, as [`ignore_participant`](Self::ignore_participant) does.
    pub fn ignore_subscription(&self, reader: Guid) {
        self.ignore(Ignore::Endpoint(reader));
    }

    /// Behaves from now on as if nobody, this participant included, had writers or readers of the topic of that name.
    pub fn ignore_topic(&self, name: &str) {
        self.ignore(Ignore::Topic(name.to_owned()));
    }

    fn ignore(&self, ignore: Ignore) {
        self.socket
            .shared()
            .with(|core, now| core.ignore(now, ignore));
    }

    /// Its name. On the kernel layer the apps of a host are one participant to others, and have this in common.
    pub fn guid(&self) -> Guid {
        let prefix = self.socket.shared().with(|core, _| core.endpoints.prefix());
        Guid::new(prefix, EntityId::PARTICIPANT)
    }

    /// Whether it has a writer or reader of that name.
    pub fn contains_entity(&self, guid: Guid) -> bool {
        let shared = self.socket.shared();
        shared.with(|core, _| core.is_own(guid) && core.entity(guid.entity).is_some())
    }

    /// The time that samples are stamped with.
    pub fn current_time(&self) -> SystemTime {
        let shared = self.socket.shared();
        shared.with(|core, now| core.wall_time(now))
    }

    /// A publisher: writers with policies in common.
    pub fn create_publisher(&self, qos: Qos) -> Publisher {
        Publisher::new(self.socket.clone(), qos, self.autoenables())
    }

    /// A subscriber: readers with policies in common.
    pub fn create_subscriber(&self, qos: Qos) -> Subscriber {
        Subscriber::new(self.socket.clone(), qos, self.autoenables())
    }

    /// A writer of a publisher of its own.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_writer<T: DdsType>(
        &self,
        topic: &Topic<T>,
        qos: Qos,
    ) -> Result<DataWriter<T>, CreateError> {
        let template = Template {
            is_enabled: self.autoenables(),
            ..Template::new(
                topic.name(),
                T::TYPE_NAME,
                qos.on_topic(topic.qos()).into_writer(),
            )
        };
        DataWriter::new(&self.socket, template)
    }

    /// A reader of a subscriber of its own.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_reader<T: DdsType>(
        &self,
        topic: &impl TopicDescription<T>,
        qos: Qos,
    ) -> Result<DataReader<T>, CreateError> {
        let template = Template {
            is_enabled: self.autoenables(),
            ..Template::new(
                topic.topic().name(),
                T::TYPE_NAME,
                qos.on_topic(topic.topic().qos()).into_reader(),
            )
        };
        DataReader::new(&self.socket, template, topic.filter())
    }

    /// ENTITY_FACTORY: whether what is created from now on is enabled at once, as it is by default. A publisher or subscriber
    /// that is not leaves its endpoints disabled, too, until it is enabled.
    pub fn set_autoenable_created_entities(&self, autoenable: bool) {
        self.leaves_disabled.store(!autoenable, Ordering::Relaxed);
    }

    fn autoenables(&self) -> bool {
        !self.leaves_disabled.load(Ordering::Relaxed)
    }

    /// Has `listener` called with the events that `mask` holds of all endpoints, where neither they nor their publishers and
    /// subscribers have a listener for them; also with those that wait to be asked for. By whatever thread drives.
    pub fn set_listener(
        &self,
        mask: StatusMask,
        listener: impl Fn(EntityEvent) + Send + Sync + 'static,
    ) {
        self.socket.set_listener(mask, listener);
    }

    /// A condition that is true while one of these statuses of one of its writers and readers has changed since it was last
    /// asked for. A participant has no statuses of its own.
    pub fn status_condition(&self, statuses: StatusMask) -> StatusCondition {
        let shared = self.socket.shared();
        let watched = Watched::new(shared, Scope::Participant, Trigger::on(statuses));
        StatusCondition::new(watched)
    }

    /// The statuses of its writers and readers that have changed since they were last asked for.
    pub fn status_changes(&self) -> StatusMask {
        let shared = self.socket.shared();
        shared.poll(|core, _| core.status_changes(Scope::Participant))
    }

    /// Changes USER_DATA, up to 256 bytes that others see in the participant's announcement
    /// ([`Builder::user_data`](Builder::user_data)).
    ///
    /// # Errors
    /// When there are more bytes than that.
    pub fn set_user_data(&self, data: impl Into<Vec<u8>>) -> Result<(), SetQosError> {
        Ok(self.socket.describe(data.into())?)
    }

    /// Asserts the liveliness of all writers with LIVELINESS MANUAL_BY_PARTICIPANT.
    pub fn assert_liveliness(&self) {
        self.socket.assert_liveliness();
    }
}

impl From<RtpsSocket> for DomainParticipant {
    fn from(socket: RtpsSocket) -> Self {
        Self {
            socket,
            leaves_disabled: Arc::default(),
        }
    }
}
