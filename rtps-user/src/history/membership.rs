//! What a change says of the coherent set and the group that it belongs to (RTPS 2.5 sections 8.7.5 and 8.7.6).

use crate::wire::{GroupDigest, InlineQos, SequenceNumber};

/// Where a change stands among the changes of its publisher.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct GroupStamp {
    /// Its group sequence number. At the end of a set, which has none of its own, the last of the set.
    pub sequence: SequenceNumber,
    /// The group sequence number that the publisher's coherent set begins with, where it belongs to one.
    pub set: Option<SequenceNumber>,
}

/// The set and the group of a change; most changes have neither.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Membership {
    /// The first change of its writer's coherent set, or SEQUENCENUMBER_UNKNOWN where the set has ended.
    pub coherent_set: Option<SequenceNumber>,
    /// Its place in the group, where the publisher has GROUP scope.
    pub group: Option<GroupStamp>,
    /// The writers of the group, at the end of its set.
    pub writers: Option<GroupDigest>,
}

impl Membership {
    /// The most bytes that it takes in the inline QoS of a change with a payload.
    pub const MAX_LEN: usize = 3 * 12;

    /// Whether it is that of the change behind the last of a set.
    pub fn ends_set(&self) -> bool {
        self.coherent_set == Some(SequenceNumber::UNKNOWN)
    }

    /// Says it in `qos`.
    pub fn write_to(&self, qos: &mut InlineQos) {
        qos.coherent_set = self.coherent_set;
        qos.group_sequence = self.group.map(|group| group.sequence);
        qos.group_coherent_set = self.group.and_then(|group| group.set);
        qos.writer_group = self.writers;
    }
}
