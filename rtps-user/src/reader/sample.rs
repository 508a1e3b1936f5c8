//! What an application gets from a reader: samples, what is known of them, and how to select them
//! (DDS 1.4 section 2.2.2.5).

use std::marker::PhantomData;
use std::time::Instant;

use bytes::Bytes;

use crate::wire::{Guid, KeyHash, SequenceNumber, Timestamp};

/// A sample, or the news that an instance is no longer alive.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The serialized payload with its encapsulation header: the data where `info.valid_data`, else the key, or
    /// nothing where no key came.
    pub payload: Bytes,
    /// What is known of it.
    pub info: SampleInfo,
}

/// SampleInfo (DDS 1.4 section 2.2.2.5.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleInfo {
    /// Whether there is data, and not only a change of the instance's state.
    pub valid_data: bool,
    /// The instance; zeros for topics without key.
    pub instance: KeyHash,
    /// The writer.
    pub writer: Guid,
    /// The writer's number for it.
    pub sequence: SequenceNumber,
    /// Its number among all changes of its publisher, where both ends have asked for coherent or ordered access and
    /// the publisher's scope is GROUP.
    pub group_sequence: Option<SequenceNumber>,
    /// When it was written, where the writer says so.
    pub source_timestamp: Option<Timestamp>,
    /// When it arrived.
    pub reception: Instant,
    /// Whether this reader has read it before.
    pub sample_state: SampleState,
    /// Whether this reader has seen the instance before, in its present life.
    pub view_state: ViewState,
    /// Whether the instance is alive now.
    pub instance_state: InstanceState,
    /// How often the instance had come back from being disposed when the sample arrived.
    pub disposed_generation_count: u32,
    /// How often the instance had come back from having no writers when the sample arrived.
    pub no_writers_generation_count: u32,
    /// How many samples of the same instance follow in the same collection.
    pub sample_rank: u32,
    /// Generations between the sample and the newest of its instance in the same collection.
    pub generation_rank: u32,
    /// Generations between the sample and the newest of its instance in the reader.
    pub absolute_generation_rank: u32,
}

/// Whether a sample has been read before.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum SampleState {
    /// It has.
    Read = 1,
    /// It has not.
    NotRead = 2,
}

/// Whether an instance has been seen before.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum ViewState {
    /// This is the first access to it since it came, or came back, to life.
    New = 1,
    /// It has been accessed.
    NotNew = 2,
}

/// Whether an instance is alive.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum InstanceState {
    /// There are writers of it and none has disposed it.
    Alive = 1,
    /// A writer has disposed it.
    NotAliveDisposed = 2,
    /// Nobody writes it any more.
    NotAliveNoWriters = 4,
}

/// A state that has a bit of its own in a [`Mask`].
pub trait State: Copy {
    /// The bit.
    fn bit(self) -> u8;
}

impl State for SampleState {
    fn bit(self) -> u8 {
        self as u8
    }
}

impl State for ViewState {
    fn bit(self) -> u8 {
        self as u8
    }
}

impl State for InstanceState {
    fn bit(self) -> u8 {
        self as u8
    }
}

/// A set of states of one kind.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Mask<S> {
    bits: u8,
    states: PhantomData<S>,
}

impl<S: State> Mask<S> {
    /// Every state.
    pub const ANY: Self = Self {
        bits: u8::MAX,
        states: PhantomData,
    };

    /// The set of `states`.
    pub fn of(states: &[S]) -> Self {
        Self {
            bits: states.iter().fold(0, |bits, state| bits | state.bit()),
            states: PhantomData,
        }
    }

    /// Whether `state` is in the set.
    pub fn contains(self, state: S) -> bool {
        self.bits & state.bit() != 0
    }
}

impl<S: State> From<S> for Mask<S> {
    fn from(state: S) -> Self {
        Self::of(&[state])
    }
}

/// Which samples to read or take; by default all.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Selection {
    /// In these sample states.
    pub sample_states: Mask<SampleState>,
    /// Of instances in these view states.
    pub view_states: Mask<ViewState>,
    /// Of instances in these instance states.
    pub instance_states: Mask<InstanceState>,
    /// Of this instance only.
    pub instance: Option<KeyHash>,
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            sample_states: Mask::ANY,
            view_states: Mask::ANY,
            instance_states: Mask::ANY,
            instance: None,
        }
    }
}

impl Selection {
    /// Samples that have not been read yet.
    pub fn not_read() -> Self {
        Self {
            sample_states: SampleState::NotRead.into(),
            ..Self::default()
        }
    }
}
