//! The typed API in the terms of DDS 1.4: participant, topic, publisher, subscriber, writer, reader.

mod access;
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

pub use data_reader::{DataReader, Samples};
pub use data_writer::DataWriter;
pub use participant::DomainParticipant;
pub use publisher::{CoherentChanges, Publisher};
pub use sample::Sample;
pub use subscriber::{Access, Subscriber};
pub use topic::Topic;

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
