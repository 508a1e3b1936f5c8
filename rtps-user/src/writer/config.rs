//! What a writer is made with, and what it tells.

use std::time::{Duration, Instant};

use thiserror::Error;

use crate::CountClock;
use crate::history::NewChange;
use crate::qos::Qos;
use crate::wire::{Guid, KeyHash};

/// What a writer is made with.
#[derive(Clone, Debug)]
pub struct WriterConfig {
    /// Its name; the kind of its entity id says whether its topic has keys.
    pub guid: Guid,
    /// Its policies.
    pub qos: Qos,
    /// The most bytes of a datagram, UDP header excluded; larger samples are sent in fragments.
    pub datagram_size: usize,
    /// Its timing parameters.
    pub timing: WriterTiming,
}

/// The parameters that RTPS 2.5 section 8.4.7.1 leaves to the implementation.
#[derive(Clone, Copy, Debug)]
pub struct WriterTiming {
    /// heartbeatPeriod: how long after a change the first HEARTBEAT asks for its acknowledgement. It doubles with
    /// each that brings nothing new.
    pub heartbeat_period: Duration,
    /// What the doubled period does not exceed.
    pub heartbeat_period_max: Duration,
    /// After so many changes a HEARTBEAT travels with the last, without waiting for the period. What is written at
    /// once counts as one: there a HEARTBEAT comes four times in each window.
    pub heartbeat_samples: u32,
    /// nackResponseDelay: how long a request waits for others before it is answered.
    pub nack_response_delay: Duration,
    /// nackSuppressionDuration: how long a change that was sent again is not sent again to the same reader. It
    /// doubles while a reader asks again and again for the same.
    pub nack_suppression: Duration,
    /// What the doubled suppression does not exceed.
    pub nack_suppression_max: Duration,
    /// The window: unacknowledged bytes, each change counted with its payload and
    /// [`CacheChange::OVERHEAD`](crate::history::CacheChange::OVERHEAD), from which on a reliable KEEP_ALL writer takes
    /// no more until half of them are acknowledged. It shall fit the inboxes of the readers: it becomes smaller when
    /// they lose something, and larger again when they don't, up to this.
    pub max_unacknowledged_bytes: usize,
    /// What the window does not become smaller than.
    pub min_unacknowledged_bytes: usize,
    /// What the counts of HEARTBEATs follow; without it they go up by one.
    pub count_clock: Option<CountClock>,
}

impl Default for WriterTiming {
    fn default() -> Self {
        Self {
            heartbeat_period: Duration::from_millis(10),
            heartbeat_period_max: Duration::from_secs(1),
            heartbeat_samples: 512,
            nack_response_delay: Duration::ZERO,
            nack_suppression: Duration::from_millis(2),
            nack_suppression_max: Duration::from_millis(100),
            // What a kernel ring of 1 MiB holds of it in records of single datagrams.
            max_unacknowledged_bytes: 640 << 10,
            min_unacknowledged_bytes: 64 << 10,
            count_clock: None,
        }
    }
}

/// Why a change was not taken.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
pub enum WriteError {
    /// The history is full of changes that a reliable reader has not acknowledged.
    #[error(
        "the history is full of unacknowledged samples: wait for acknowledgements and try again"
    )]
    HistoryFull,
    /// RESOURCE_LIMITS forbids the change, and waiting does not help.
    #[error(
        "the instance would exceed RESOURCE_LIMITS: raise max_instances or unregister others first"
    )]
    OutOfResources,
    /// The payload exceeds what DATA_FRAG can say.
    #[error("a sample of {0} bytes is larger than RTPS can carry (4 GiB)")]
    TooLarge(usize),
}

/// A change that was not taken.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Refused {
    /// Why not.
    pub error: WriteError,
    /// The change, for another time.
    pub change: NewChange,
}

/// What a writer tells its user.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum WriterEvent {
    /// Readers have acknowledged more: there is room in the history, or whoever waits for acknowledgements may
    /// look again.
    Acknowledged,
    /// OFFERED_DEADLINE_MISSED: an instance was not written in time.
    DeadlineMissed {
        /// The instance.
        instance: KeyHash,
    },
    /// The writer is alive, and with it the other MANUAL_BY_PARTICIPANT writers of its app: their readers are to be told.
    Asserted {
        /// Since then.
        at: Instant,
    },
    /// The lease of a MANUAL liveliness passed without an assertion.
    LivelinessLost,
}
