//! The typed API in the terms of DDS 1.4: participant, topic, publisher, subscriber, writer, reader.
//!
//! Some operations of section 2.2.2 have another form, or need none:
//! * `delete_*`, `delete_contained_entities`, `return_loan`: what is dropped is deleted. A participant stays in its domain
//!   until the last of its publishers, subscribers, writers and readers is dropped; a topic may go before its endpoints.
//! * DomainParticipantFactory, `get_participant`, `get_publisher`, `get_topic`, `lookup_datawriter`, `lookup_topicdescription`
//!   and the like: whoever wants an entity again keeps it, or a clone of it.
//! * `get_discovered_participants`, `get_discovered_topics` and their data: [`BuiltinTopics`], also for
//!   `get_builtin_subscriber`.
//! * `get_listener` and listeners that are null: a listener with another mask takes the place of one. `get_instance_handle` is
//!   `guid`.
//! * An entity has as many status conditions as it is asked for, each with a mask of its own.

mod access;
mod builtin;
mod builtin_reader;
mod condition;
mod content_filtered_topic;
mod data_reader;
mod data_writer;
mod group;
mod keys;
mod participant;
mod publisher;
mod sample;
mod status;
mod subscriber;
mod topic;
mod wait_set;

pub use builtin::{
    BuiltinTopics, EndpointBuiltinTopicData, ParticipantBuiltinTopicData, TopicBuiltinTopicData,
};
pub use builtin_reader::BuiltinReader;
pub use condition::{Condition, GuardCondition, QueryCondition, ReadCondition, StatusCondition};
pub use content_filtered_topic::{ContentFilteredTopic, TopicDescription};
pub use data_reader::{DataReader, Samples};
pub use data_writer::DataWriter;
pub use participant::DomainParticipant;
pub use publisher::{CoherentChanges, Publisher};
pub use sample::Sample;
pub use subscriber::{Access, Subscriber};
pub use topic::Topic;
pub use wait_set::WaitSet;

use rtps_user::wire::KeyHash;

use crate::cdr::{DdsType, EncodeError, Representation, key_hash};

/// The instance that a value belongs to.
fn instance_of<T: DdsType>(
    value: &T,
    representation: Representation,
    scratch: &mut Vec<u8>,
) -> Result<KeyHash, EncodeError> {
    key_hash(value, representation, scratch).map(KeyHash)
}
