//! What happens to endpoints, for the app that they belong to.

use std::time::Instant;

use crate::reader::{ReaderEvent, RejectedReason};
use crate::wire::{EntityId, Guid, KeyHash};
use crate::writer::WriterEvent;

/// Something has happened to one of the endpoints.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum EndpointEvent {
    /// DATA_AVAILABLE: the reader has got samples since the last such event.
    DataAvailable(EntityId),
    /// The writer's readers have acknowledged more: there may be room for a write that found none.
    Acknowledged(EntityId),
    /// The MANUAL_BY_PARTICIPANT writers are alive, because one of them is: the participant is to tell it to their readers
    /// (RTPS 2.5 section 8.4.13).
    Asserted {
        /// Since then.
        at: Instant,
    },
    /// LIVELINESS_LOST: the writer's lease passed without an assertion.
    LivelinessLost(EntityId),
    /// SAMPLE_LOST.
    SampleLost {
        /// The reader that missed them.
        reader: EntityId,
        /// The writer that sent them.
        writer: Guid,
        /// How many are lost.
        count: u64,
    },
    /// SAMPLE_REJECTED: the reader has no room.
    SampleRejected {
        /// The reader.
        reader: EntityId,
        /// The writer that sent the sample.
        writer: Guid,
        /// The instance of the sample.
        instance: KeyHash,
        /// The limit.
        reason: RejectedReason,
    },
    /// OFFERED_DEADLINE_MISSED.
    OfferedDeadlineMissed {
        /// The writer.
        writer: EntityId,
        /// The instance that was not written in time.
        instance: KeyHash,
    },
    /// REQUESTED_DEADLINE_MISSED.
    DeadlineMissed {
        /// The reader.
        reader: EntityId,
        /// The instance that got no sample in time.
        instance: KeyHash,
    },
    /// LIVELINESS_CHANGED.
    LivelinessChanged {
        /// The reader.
        reader: EntityId,
        /// The writer that has come, gone, lost its liveliness or got it back.
        writer: Guid,
        /// Matched writers that are alive now.
        alive_count: u32,
        /// Change of `alive_count`.
        alive_change: i32,
        /// Matched writers that have lost their liveliness.
        not_alive_count: u32,
        /// Change of `not_alive_count`.
        not_alive_change: i32,
    },
}

impl EndpointEvent {
    pub(super) fn of_writer(writer: EntityId, event: WriterEvent) -> Self {
        match event {
            WriterEvent::Acknowledged => Self::Acknowledged(writer),
            WriterEvent::DeadlineMissed { instance } => {
                Self::OfferedDeadlineMissed { writer, instance }
            }
            WriterEvent::Asserted { at } => Self::Asserted { at },
            WriterEvent::LivelinessLost => Self::LivelinessLost(writer),
        }
    }

    pub(super) fn of_reader(reader: EntityId, event: ReaderEvent) -> Self {
        match event {
            ReaderEvent::DataAvailable => Self::DataAvailable(reader),
            ReaderEvent::SampleLost { writer, count } => Self::SampleLost {
                reader,
                writer,
                count,
            },
            ReaderEvent::SampleRejected {
                writer,
                instance,
                reason,
            } => Self::SampleRejected {
                reader,
                writer,
                instance,
                reason,
            },
            ReaderEvent::DeadlineMissed { instance } => Self::DeadlineMissed { reader, instance },
            ReaderEvent::LivelinessChanged {
                writer,
                alive_count,
                alive_change,
                not_alive_count,
                not_alive_change,
            } => Self::LivelinessChanged {
                reader,
                writer,
                alive_count,
                alive_change,
                not_alive_count,
                not_alive_change,
            },
        }
    }
}
