//! StatusKind and StatusMask (DDS 1.4 section 2.2.4.1).

/// A kind of status, with the bit that the standard gives it.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
#[repr(u32)]
pub enum StatusKind {
    /// Another endpoint uses the topic's name with another type.
    InconsistentTopic = 1,
    /// A writer has not written an instance in time.
    OfferedDeadlineMissed = 1 << 1,
    /// A reader has not got an instance in time.
    RequestedDeadlineMissed = 1 << 2,
    /// A reader wants more than a writer offers.
    OfferedIncompatibleQos = 1 << 5,
    /// A writer offers less than a reader wants.
    RequestedIncompatibleQos = 1 << 6,
    /// Samples will never come.
    SampleLost = 1 << 7,
    /// A reader had no room.
    SampleRejected = 1 << 8,
    /// A reader of a subscriber has got samples: for the subscriber's listener, in place of `DataAvailable`.
    DataOnReaders = 1 << 9,
    /// A reader has got samples.
    DataAvailable = 1 << 10,
    /// A writer's lease passed without an assertion.
    LivelinessLost = 1 << 11,
    /// A writer has come, gone, lost its liveliness or got it back.
    LivelinessChanged = 1 << 12,
    /// A writer has got or lost a reader.
    PublicationMatched = 1 << 13,
    /// A reader has got or lost a writer.
    SubscriptionMatched = 1 << 14,
    /// What the standard has no status for: trouble with the layer, samples that cannot be decoded.
    Trouble = 1 << 31,
}

/// A set of kinds of status.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct StatusMask(u32);

impl StatusMask {
    /// No kind.
    pub const NONE: Self = Self(0);
    /// Every kind.
    pub const ALL: Self = Self(u32::MAX);
    /// Every kind but those that come with each sample.
    pub const WITHOUT_DATA: Self =
        Self(!(StatusKind::DataAvailable as u32 | StatusKind::DataOnReaders as u32));

    /// The set of `kinds`.
    #[must_use]
    pub fn of(kinds: &[StatusKind]) -> Self {
        Self(kinds.iter().fold(0, |bits, kind| bits | *kind as u32))
    }

    /// Whether a kind is in the set.
    #[must_use]
    pub fn contains(self, kind: StatusKind) -> bool {
        self.0 & kind as u32 != 0
    }

    /// Whether the sets have a kind in common.
    #[must_use]
    pub fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The kinds that are in either set.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(crate) fn bits(self) -> u32 {
        self.0
    }

    pub(crate) fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    pub(crate) fn insert(&mut self, kind: StatusKind) {
        self.0 |= kind as u32;
    }

    pub(crate) fn remove(&mut self, kind: StatusKind) {
        self.0 &= !(kind as u32);
    }
}

impl From<StatusKind> for StatusMask {
    fn from(kind: StatusKind) -> Self {
        Self(kind as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_hold_what_was_put_in() {
        let mut mask = StatusMask::of(&[StatusKind::SampleLost, StatusKind::Trouble]);
        assert!(mask.contains(StatusKind::SampleLost) && mask.contains(StatusKind::Trouble));
        assert!(!mask.contains(StatusKind::DataAvailable));
        mask.insert(StatusKind::DataAvailable);
        assert!(mask.intersects(StatusKind::DataAvailable.into()));
        mask.remove(StatusKind::DataAvailable);
        assert!(!mask.intersects(StatusKind::DataAvailable.into()));
        assert!(!StatusMask::WITHOUT_DATA.contains(StatusKind::DataOnReaders));
        assert!(StatusMask::WITHOUT_DATA.contains(StatusKind::LivelinessLost));
    }
}
