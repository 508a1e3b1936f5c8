//! CacheChange: one sample, disposal or unregistration of an instance (RTPS 2.5 section 8.2.3).

use bytes::Bytes;

use super::Membership;
use crate::qos::WriterDataLifecycle;
use crate::wire::{KeyHash, PayloadKind, SequenceNumber, StatusInfo, Timestamp};

/// What a change does to its instance (ChangeKind_t, RTPS 8.2.3).
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum ChangeKind {
    /// Gives it a value.
    #[default]
    Alive,
    /// Disposes it.
    Disposed,
    /// The writer will not update it any more.
    Unregistered,
    /// Both.
    DisposedUnregistered,
}

impl ChangeKind {
    /// What a writer says that unregisters an instance (DDS 1.4 section 2.2.3.21).
    pub fn unregistration(lifecycle: WriterDataLifecycle) -> Self {
        if lifecycle.autodispose_unregistered_instances {
            Self::DisposedUnregistered
        } else {
            Self::Unregistered
        }
    }

    /// The flags that stand in the inline QoS.
    pub fn status_info(self) -> StatusInfo {
        StatusInfo {
            disposed: matches!(self, Self::Disposed | Self::DisposedUnregistered),
            unregistered: matches!(self, Self::Unregistered | Self::DisposedUnregistered),
            filtered: false,
        }
    }

    /// What the flags of an inline QoS say.
    pub fn from_status_info(status: StatusInfo) -> Self {
        match (status.disposed, status.unregistered) {
            (false, false) => Self::Alive,
            (true, false) => Self::Disposed,
            (false, true) => Self::Unregistered,
            (true, true) => Self::DisposedUnregistered,
        }
    }
}

/// A change that a writer is about to take into its history.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct NewChange {
    /// What it does to the instance.
    pub kind: ChangeKind,
    /// The instance; zeros for a topic without key.
    pub instance: KeyHash,
    /// The serialized sample with its encapsulation header; only the key, or nothing, where the kind is not
    /// [`ChangeKind::Alive`].
    pub payload: Bytes,
    /// The source timestamp.
    pub timestamp: Timestamp,
}

/// A change in a history.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct CacheChange {
    /// What it does to the instance.
    pub kind: ChangeKind,
    /// The instance.
    pub instance: KeyHash,
    /// The serialized sample or key.
    pub payload: Bytes,
    /// The source timestamp.
    pub timestamp: Timestamp,
    /// The coherent set and the group that it belongs to, where it does.
    pub membership: Option<Box<Membership>>,
    /// The weight of all changes before this one, also of those that are not there any more.
    pub(super) before: u64,
    /// The change of the same instance before this one that is still in the history, or 0.
    pub(super) older: SequenceNumber,
    /// The change of the same instance after this one that is still in the history, or 0.
    pub(super) newer: SequenceNumber,
}

impl CacheChange {
    /// What a change costs beside its payload in the history, whose room grows by doubling, and in the caches of readers;
    /// on the wire and in the inboxes of readers it is less.
    pub const OVERHEAD: usize = 224;

    pub(super) fn new(
        change: NewChange,
        membership: Option<Box<Membership>>,
        before: u64,
        older: SequenceNumber,
    ) -> Self {
        Self {
            kind: change.kind,
            instance: change.instance,
            payload: change.payload,
            timestamp: change.timestamp,
            membership,
            before,
            older,
            newer: SequenceNumber::ZERO,
        }
    }

    /// Whether it is no change of an instance, but says that a coherent set has ended.
    pub fn ends_set(&self) -> bool {
        let membership = self.membership.as_deref();
        membership.is_some_and(Membership::ends_set)
    }

    /// Bytes that count when it comes to how much is on its way.
    pub fn weight(&self) -> u64 {
        (self.payload.len() + Self::OVERHEAD) as u64
    }

    /// What the payload is on the wire.
    pub fn payload_kind(&self) -> PayloadKind {
        match self.kind {
            _ if self.payload.is_empty() => PayloadKind::None,
            ChangeKind::Alive => PayloadKind::Data,
            ChangeKind::Disposed | ChangeKind::Unregistered | ChangeKind::DisposedUnregistered => {
                PayloadKind::Key
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_and_flags_are_the_same_thing() {
        for kind in [
            ChangeKind::Alive,
            ChangeKind::Disposed,
            ChangeKind::Unregistered,
            ChangeKind::DisposedUnregistered,
        ] {
            assert_eq!(ChangeKind::from_status_info(kind.status_info()), kind);
        }
    }
}
