//! What a reader is made of: its name, policies, limits and timing.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use crate::CountClock;
use crate::filter::PayloadFilter;
use crate::qos::Qos;
use crate::wire::{FilterSignature, Guid, KeyHash, PayloadKind};

/// Computes the instance that a serialized payload is about, for writers that send no key hash; `None` where the
/// payload is malformed. The payload begins with its encapsulation header.
pub type InstanceOf = Arc<dyn Fn(PayloadKind, &[u8]) -> Option<KeyHash> + Send + Sync>;

/// What a [`Reader`](super::Reader) is created with.
#[derive(Clone)]
pub struct ReaderConfig {
    /// Its name.
    pub guid: Guid,
    /// Its policies.
    pub qos: Qos,
    /// Bytes of the largest datagram to send.
    pub datagram_size: usize,
    /// Bytes of the largest serialized sample to accept in fragments; larger ones are refused.
    pub max_sample_size: usize,
    /// How to find the instance of a sample that comes without key hash; not needed for topics without key.
    pub instance_of: Option<InstanceOf>,
    /// The content filter; what it is not interested in is acknowledged, but does not come in.
    pub content_filter: Option<PayloadFilter>,
    /// The signature of the filter that is announced, if it is the same: what a writer says that has put a sample to it is
    /// believed.
    pub filter_signature: Option<FilterSignature>,
    /// Its timing parameters.
    pub timing: ReaderTiming,
}

impl ReaderConfig {
    /// The default of [`max_sample_size`](Self::max_sample_size), 64 MiB.
    pub const MAX_SAMPLE_SIZE: usize = 64 << 20;

    /// A reader with default limits and timing.
    pub fn new(guid: Guid, qos: Qos) -> Self {
        Self {
            guid,
            qos,
            datagram_size: 1452,
            max_sample_size: Self::MAX_SAMPLE_SIZE,
            instance_of: None,
            content_filter: None,
            filter_signature: None,
            timing: ReaderTiming::default(),
        }
    }
}

impl fmt::Debug for ReaderConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReaderConfig")
            .field("guid", &self.guid)
            .field("qos", &self.qos)
            .field("datagram_size", &self.datagram_size)
            .field("max_sample_size", &self.max_sample_size)
            .field("instance_of", &self.instance_of.is_some())
            .field("content_filter", &self.content_filter.is_some())
            .field("filter_signature", &self.filter_signature)
            .field("timing", &self.timing)
            .finish()
    }
}

/// The timing parameters of a reliable reader (RTPS 2.5 section 8.4.10.1).
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct ReaderTiming {
    /// heartbeatResponseDelay: how long the answer to a HEARTBEAT waits for more to answer at once.
    pub heartbeat_response_delay: Duration,
    /// How long at the most after it was asked for a missing sample or fragment is not asked for again, because its
    /// repair is on the way. It is less where the writer's repairs have been seen to come sooner.
    pub nack_suppression: Duration,
    /// Bytes of missing samples and fragments that are asked for at once, so that their repairs find room where the
    /// reader's datagrams wait. When the last of them has come, more are asked for.
    pub max_requested_bytes: usize,
    /// How long at the most fragments of the newest sample must have ceased to come before those behind the last
    /// received one count as lost, and not just as not sent yet. It is less where repairs have been seen to come
    /// sooner.
    pub fragment_silence: Duration,
    /// How soon the ACKNACK that greets a writer is repeated while no HEARTBEAT answers it; doubles each time.
    pub greeting_period: Duration,
    /// The longest time between two greetings.
    pub greeting_period_max: Duration,
    /// How many greetings a writer is sent at the most.
    pub max_greetings: u32,
    /// heartbeatSuppressionDuration, as far as counts go: after so long a HEARTBEAT is heeded even where its
    /// count has not grown, because its writer may have begun to count anew.
    pub heartbeat_count_validity: Duration,
    /// What the counts of ACKNACKs follow; without it they go up by one.
    pub count_clock: Option<CountClock>,
}

impl Default for ReaderTiming {
    fn default() -> Self {
        Self {
            heartbeat_response_delay: Duration::ZERO,
            nack_suppression: Duration::from_millis(20),
            max_requested_bytes: 256 << 10,
            fragment_silence: Duration::from_millis(5),
            greeting_period: Duration::from_millis(50),
            greeting_period_max: Duration::from_secs(2),
            max_greetings: u32::MAX,
            heartbeat_count_validity: Duration::from_millis(500),
            count_clock: None,
        }
    }
}
