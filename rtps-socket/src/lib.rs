//! What apps link: DDS for Rust over the host's low-level RTPS layer in the kernel, or over plain UDP sockets.
//!
//! [`DomainParticipant`], [`DataWriter`] and [`DataReader`] exchange values of types that derive [`DdsType`];
//! [`RtpsSocket`] is the level below, for payloads that are serialized already and for event loops of one's own.
//! Both work blocking and `async`. Which layer is used is chosen when the participant is opened and said in the log
//! ([`LayerChoice`]).
//!
//! There is no receive thread in the way of a sample: the thread that waits for it reads it from the kernel itself.
#![deny(unsafe_code)]

// The derive macro writes `::rtps_socket::cdr`, here too.
extern crate self as rtps_socket;

pub mod cdr;
mod dcps;
mod driver;
pub mod error;
pub mod filter;
mod link;
pub mod qos;
mod socket;
pub mod status;
#[expect(
    unsafe_code,
    reason = "memory shared with the kernel, and system calls without a safe wrapper"
)]
mod sys;

pub use bytes::Bytes;
pub use dcps::{
    Access, BuiltinReader, BuiltinTopics, CoherentChanges, Condition, ContentFilteredTopic,
    DataReader, DataWriter, DomainParticipant, EndpointBuiltinTopicData, GuardCondition,
    ParticipantBuiltinTopicData, Publisher, QueryCondition, ReadCondition, Sample, Samples,
    StatusCondition, Subscriber, Topic, TopicBuiltinTopicData, TopicDescription, WaitSet,
};
pub use link::{LayerChoice, LayerKind};
pub use qos::Qos;
pub use rtps_socket_derive::DdsType;
pub use rtps_user::history::ChangeKind;
pub use rtps_user::reader::{
    InstanceOf, InstanceState, Mask, RejectedReason, Sample as RawSample, SampleInfo, SampleState,
    Selection, ViewState,
};
pub use rtps_user::wire::{
    EntityId, Guid, GuidPrefix, KeyHash, KeyHash as InstanceHandle, PayloadKind, SequenceNumber,
    Timestamp,
};
pub use socket::{Builder, Loan, RawChange, RawReader, RawSamples, RawWriter, RtpsSocket};
pub use status::{EntityEvent, StatusEvent, StatusKind, StatusMask};
