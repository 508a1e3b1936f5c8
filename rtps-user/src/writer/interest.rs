//! What of all that is written a reader wants, and how: its content filter, the ends of coherent sets, the form of keys.

use std::fmt;

use crate::RemoteEndpoint;
use crate::filter::PayloadFilter;
use crate::history::CacheChange;
use crate::wire::PayloadKind;

/// Gives a serialized key in the form that Cyclone DDS 0.10 reads, without DHEADERs; `None` where there is nothing to change.
pub type BareKey = fn(&[u8]) -> Option<Vec<u8>>;

/// The interest of one reader.
#[derive(Clone, Default)]
pub(super) struct Interest {
    filter: Option<PayloadFilter>,
    /// Whether it has asked for coherent access.
    in_sets: bool,
    /// What keys become for it alone.
    bare_key: Option<BareKey>,
}

impl Interest {
    pub(super) fn of(remote: &RemoteEndpoint) -> Self {
        Self {
            in_sets: remote.qos.presentation.coherent,
            ..Self::default()
        }
    }

    pub(super) fn set_filter(&mut self, filter: Option<PayloadFilter>) {
        self.filter = filter;
    }

    pub(super) fn set_bare_key(&mut self, bare_key: BareKey) {
        self.bare_key = Some(bare_key);
    }

    /// What keys become for it.
    pub(super) fn bare_key(&self) -> Option<BareKey> {
        self.bare_key
    }

    /// Whether it wants all that a writer sends, which may send ends of sets, as it is.
    pub(super) fn is_everything(&self, writer_has_sets: bool) -> bool {
        self.filter.is_none() && self.bare_key.is_none() && (self.in_sets || !writer_has_sets)
    }

    /// Whether it wants that change.
    pub(super) fn wants(&self, change: &CacheChange) -> bool {
        if change.ends_set() {
            return self.in_sets;
        }
        let filter = self.filter.as_ref();
        filter.is_none_or(|passes| passes(change.payload_kind(), &change.payload))
    }

    /// Whether it wants that change as it is.
    pub(super) fn wants_unchanged(&self, change: &CacheChange) -> bool {
        let is_changed = self.bare_key.is_some() && change.payload_kind() == PayloadKind::Key;
        !is_changed && self.wants(change)
    }
}

impl fmt::Debug for Interest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Interest")
            .field("has_filter", &self.filter.is_some())
            .field("in_sets", &self.in_sets)
            .field("takes_bare_keys", &self.bare_key.is_some())
            .finish()
    }
}
