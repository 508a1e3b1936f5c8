//! What of all that is written a reader wants: its content filter, and the ends of coherent sets.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use crate::RemoteEndpoint;
use crate::filter::PayloadFilter;
use crate::history::CacheChange;
use crate::wire::{ContentFilterInfo, FilterSignature, ParameterWriter};

/// The interest of one reader.
#[derive(Clone, Default)]
pub(super) struct Interest {
    filter: Option<Filter>,
    /// Whether it has asked for coherent access.
    in_sets: bool,
}

/// The filter that the reader announced.
#[derive(Clone)]
struct Filter {
    passes: PayloadFilter,
    signature: FilterSignature,
    /// PID_CONTENT_FILTER_INFO of what it lets pass.
    info: Arc<[u8]>,
}

impl Interest {
    pub(super) fn of(remote: &RemoteEndpoint) -> Self {
        Self {
            filter: None,
            in_sets: remote.qos.presentation.coherent,
        }
    }

    pub(super) fn set_filter(&mut self, filter: Option<(PayloadFilter, FilterSignature)>) {
        self.filter = filter.map(|(passes, signature)| {
            let mut info = Vec::new();
            let signatures = BTreeSet::from([signature]);
            ContentFilterInfo::write_passed(&signatures, &mut ParameterWriter::new(&mut info));
            Filter {
                passes,
                signature,
                info: info.into(),
            }
        });
    }

    /// The signature of its filter.
    pub(super) fn signature(&self) -> Option<FilterSignature> {
        self.filter.as_ref().map(|filter| filter.signature)
    }

    /// PID_CONTENT_FILTER_INFO of the changes that it wants.
    pub(super) fn filter_info(&self) -> Option<Arc<[u8]>> {
        self.filter.as_ref().map(|filter| Arc::clone(&filter.info))
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
        filter.is_none_or(|filter| (filter.passes)(change.payload_kind(), &change.payload))
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
