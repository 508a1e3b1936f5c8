//! What a reader tells its application beside samples: the communication statuses of DDS 1.4 section 2.2.4.1.

use crate::wire::{Guid, KeyHash};

/// Something has happened to a reader.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ReaderEvent {
    /// DATA_AVAILABLE: samples have arrived since the last such event.
    DataAvailable,
    /// SAMPLE_LOST: samples of a writer will never come.
    SampleLost {
        /// The writer.
        writer: Guid,
        /// How many are lost.
        count: u64,
    },
    /// SAMPLE_REJECTED: RESOURCE_LIMITS leave no room. A reliable writer waits until samples have been taken; a
    /// best-effort sample is gone.
    SampleRejected {
        /// The writer.
        writer: Guid,
        /// The instance of the sample.
        instance: KeyHash,
        /// The limit.
        reason: RejectedReason,
    },
    /// REQUESTED_DEADLINE_MISSED: an instance has got no sample for longer than DEADLINE allows.
    DeadlineMissed {
        /// The instance.
        instance: KeyHash,
    },
    /// LIVELINESS_CHANGED: a matched writer has come, gone, lost its liveliness or got it back.
    LivelinessChanged {
        /// The writer.
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

/// SampleRejectedStatusKind: the limit that a sample met.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum RejectedReason {
    /// max_instances.
    Instances,
    /// max_samples.
    Samples,
    /// max_samples_per_instance.
    SamplesPerInstance,
}
