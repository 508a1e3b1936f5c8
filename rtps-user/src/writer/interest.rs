//! What of all that is written a reader wants, and how: its content filter, the ends of coherent sets, the form of keys.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use crate::RemoteEndpoint;
use crate::filter::PayloadFilter;
use crate::history::CacheChange;
use crate::wire::{ContentFilterInfo, FilterSignature, ParameterWriter, PayloadKind};

/// Gives a serialized key in the form that Cyclone DDS 0.10 reads, without DHEADERs; `None` where there is nothing to change.
pub type BareKey = fn(&[u8]) -> Option<Vec<u8>>;

/// The interest of one reader.
#[derive(Clone, Default)]
pub(super) struct Interest {
    filter: Option<Filter>,
    /// Whether it has asked for coherent access.
    in_sets: bool,
    /// What keys become for it alone.
    bare_key: Option<BareKey>,
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
            in_sets: remote.qos.presentation.coherent,
            ..Self::default()
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
        filter.is_none_or(|filter| (filter.passes)(change.payload_kind(), &change.payload))
    }

    /// Whether it is sent that change in another form than others.
    pub(super) fn changes(&self, change: &CacheChange) -> bool {
        self.bare_key.is_some() && change.payload_kind() == PayloadKind::Key
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
