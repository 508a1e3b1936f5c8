//! The typed API in the terms of DDS 1.4: participant, topic, publisher, subscriber, writer, reader.

mod access;
mod builtin;
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
