//! Changes that some readers want and others don't, or want in another form.
//!
//! The stream to all readers stops before such a change. It is put into the outboxes of those that want it, which are
//! emptied before the stream goes on, and reliable readers that don't want it get a GAP. One that is sent in fragments stays in
//! the stream, which goes to its audience alone meanwhile: so its fragments are sent once, and no faster than these readers
//! take them. While every reader wants everything, all this costs one look at a flag.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use super::heartbeat::Sent;
use super::{BareKey, Writer};
use crate::Transmit;
use crate::filter::PayloadFilter;
use crate::wire::{ContentFilterInfo, FilterSignature, Guid, ParameterWriter, SequenceNumber};

/// The readers that want a change in fragments, which others don't want.
#[derive(Clone, Debug)]
pub(super) struct Audience {
    sequence: SequenceNumber,
    /// In order.
    readers: Vec<Guid>,
    pub(super) destinations: Arc<[SocketAddr]>,
}

impl Audience {
    pub(super) fn has(&self, reader: Guid) -> bool {
        self.readers.binary_search(&reader).is_ok()
    }
}

/// The filters that a change to all names; the readers with others judge for themselves.
const MAX_SIGNATURES: usize = 8;

/// How far is known what readers want.
#[derive(Clone, Debug, Default)]
pub(super) struct Selection {
    /// Whether there is a reader that does not want everything.
    is_needed: bool,
    /// All want what is from the stream's position to below this.
    wanted_until: SequenceNumber,
    /// The last change that the readers' filters have judged, and for each reader in order whether it wants that.
    judged: Option<SequenceNumber>,
    verdicts: Vec<bool>,
    /// The first change that has been put into an outbox and may be there still.
    unsent_from: Option<SequenceNumber>,
    /// Of the last change in fragments that not all wanted.
    audience: Option<Audience>,
    /// What changes that all want say of the filters that they have passed.
    filter_info: Option<Arc<[u8]>>,
}

impl Selection {
    /// The first change that must not be dropped, because it is in an outbox.
    pub(super) fn unsent_from(&self) -> Option<SequenceNumber> {
        self.unsent_from
    }

    /// Whom the stream goes to in a change that not all want; `None` where all do.
    pub(super) fn audience_of(&self, sequence: SequenceNumber) -> Option<&Audience> {
        let audience = self.audience.as_ref().filter(|_| self.is_needed);
        audience.filter(|audience| audience.sequence == sequence)
    }

    /// PID_CONTENT_FILTER_INFO of the changes that all want.
    pub(super) fn filter_info(&self) -> Option<Arc<[u8]>> {
        self.filter_info.clone()
    }

    /// Whether readers may share what is sent again.
    pub(super) fn is_needed(&self) -> bool {
        self.is_needed
    }
}

impl Writer {
    /// A matched reader wants only what passes a filter, which it announced with that signature; all where there is none.
    /// What it has been sent already is not affected.
    pub fn set_reader_filter(
        &mut self,
        reader: Guid,
        filter: Option<(PayloadFilter, FilterSignature)>,
    ) {
        let Some(proxy) = self.readers.get_mut(&reader) else {
            return;
        };
        proxy.interest.set_filter(filter);
        let (history, interest) = (&self.history, &proxy.interest);
        let wants = |sequence| {
            let change = history.get(sequence);
            change.is_some_and(|change| interest.wants(change))
        };
        proxy.outbox.deselect(proxy.is_reliable(), wants);
        self.refresh_selection();
    }

    /// A matched reader is sent keys as `bare_key` makes them.
    pub fn set_reader_bare_key(&mut self, reader: Guid, bare_key: BareKey) {
        if let Some(proxy) = self.readers.get_mut(&reader) {
            proxy.interest.set_bare_key(bare_key);
            self.refresh_selection();
        }
    }

    /// Readers or what they want have changed.
    pub(super) fn refresh_selection(&mut self) {
        let has_sets = self.config.qos.presentation.coherent;
        let mut readers = self.readers.values();
        self.selection.is_needed = readers.any(|proxy| !proxy.interest.is_everything(has_sets));
        self.selection.wanted_until = SequenceNumber::ZERO;
        self.selection.judged = None;
        self.selection.filter_info = self.filter_info();
        if let Some(audience) = self.selection.audience.take() {
            let Audience {
                sequence, readers, ..
            } = audience;
            self.address(sequence, readers);
        }
    }

    /// Says that a change has passed the filters of all readers, as far as there are not too many.
    fn filter_info(&self) -> Option<Arc<[u8]>> {
        let readers = self.readers.values();
        let signatures = readers.filter_map(|proxy| proxy.interest.signature());
        let signatures: BTreeSet<_> = signatures.take(MAX_SIGNATURES).collect();
        if signatures.is_empty() {
            return None;
        }
        let mut info = Vec::new();
        ContentFilterInfo::write_passed(&signatures, &mut ParameterWriter::new(&mut info));
        Some(info.into())
    }

    /// Whether the stream to all must not go on with the next change.
    pub(super) fn is_selected_next(&mut self) -> bool {
        self.selection.is_needed && self.next_selected().is_some()
    }

    /// The next datagram for readers that want the next change, where others don't.
    pub(super) fn poll_selected(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        if !self.selection.is_needed {
            return None;
        }
        self.select(now);
        self.poll_directed(now, out)
    }

    /// All outboxes have been emptied.
    pub(super) fn handle_selected_sent(&mut self) {
        if self.selection.unsent_from.take().is_some() {
            self.release();
        }
    }

    /// Puts changes into outboxes until there is one that all want.
    fn select(&mut self, now: Instant) {
        let mut sent = Sent::default();
        while let Some(sequence) = self.next_selected() {
            let Some(change) = self.history.get(sequence) else {
                break;
            };
            let is_streamed = self.layout.is_fragmented(change.payload.len());
            let start = self.live.end();
            let mut audience = Vec::new();
            for ((guid, proxy), is_wanted) in self.readers.iter_mut().zip(&self.selection.verdicts)
            {
                let is_wanted = *is_wanted;
                let gap = start..if is_wanted { sequence } else { sequence.next() };
                if proxy.is_reliable() {
                    proxy.outbox.skip(gap);
                }
                if is_wanted && is_streamed {
                    audience.push(*guid);
                } else if is_wanted {
                    proxy.outbox.select(sequence);
                }
                if proxy.outbox.has_selected() && !std::mem::replace(&mut proxy.is_queued, true) {
                    self.queue.push_back(*guid);
                }
            }
            self.selection.unsent_from.get_or_insert(sequence);
            if !audience.is_empty() {
                self.live.skip_to(sequence);
                self.address(sequence, audience);
                continue;
            }
            sent.changes += 1;
            sent.weight += change.weight();
            self.live.skip_to(sequence.next());
        }
        self.count_sent(now, sent, false);
    }

    /// Has the stream go to these readers with a change, as far as they are still matched.
    fn address(&mut self, sequence: SequenceNumber, mut readers: Vec<Guid>) {
        readers.retain(|reader| self.readers.contains_key(reader));
        self.selection.audience = (!readers.is_empty()).then(|| Audience {
            sequence,
            destinations: self.addresses_of(&readers),
            readers,
        });
    }

    /// The next change of the stream, where some readers do not want it as it is.
    fn next_selected(&mut self) -> Option<SequenceNumber> {
        if self.live.is_in_change() {
            return None;
        }
        let Self {
            history,
            live,
            selection,
            ..
        } = self;
        let (sequence, change) = history.next_from(live.end())?;
        if sequence < selection.wanted_until || selection.audience_of(sequence).is_some() {
            return None;
        }
        if selection.judged.replace(sequence) != Some(sequence) {
            let readers = self.readers.values();
            selection.verdicts.clear();
            let verdicts = readers.map(|proxy| proxy.interest.wants(change));
            selection.verdicts.extend(verdicts);
        }
        let mut readers = self.readers.values();
        let is_changed = readers.any(|proxy| proxy.interest.changes(change));
        if !is_changed && selection.verdicts.iter().all(|is_wanted| *is_wanted) {
            selection.wanted_until = sequence.next();
            return None;
        }
        Some(sequence)
    }
}
