//! What of all that is written a reader wants: its content filter, and the ends of coherent sets.

use std::fmt;

use crate::RemoteEndpoint;
use crate::filter::PayloadFilter;
use crate::history::CacheChange;

/// The interest of one reader.
#[derive(Clone, Default)]
pub(super) struct Interest {
    filter: Option<PayloadFilter>,
    /// Whether it has asked for coherent access.
    in_sets: bool,
}

impl Interest {
    pub(super) fn of(remote: &RemoteEndpoint) -> Self {
        Self {
            filter: None,
            in_sets: remote.qos.presentation.coherent,
        }
    }

    pub(super) fn set_filter(&mut self, filter: Option<PayloadFilter>) {
        self.filter = filter;
    }

    /// Whether it wants all that a writer sends, which may send ends of sets.
    pub(super) fn is_everything(&self, writer_has_sets: bool) -> bool {
        self.filter.is_none() && (self.in_sets || !writer_has_sets)
    }

    /// Whether it wants that change.
    pub(super) fn wants(&self, change: &CacheChange) -> bool {
        if change.ends_set() {
            return self.in_sets;
        }
        let filter = self.filter.as_ref();
        filter.is_none_or(|passes| passes(change.payload_kind(), &change.payload))
    }
}

impl fmt::Debug for Interest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Interest")
            .field("has_filter", &self.filter.is_some())
            .field("in_sets", &self.in_sets)
            .finish()
    }
}
