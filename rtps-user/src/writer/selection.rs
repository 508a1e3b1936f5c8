//! Changes that some readers want and others don't, or want in another form.
//!
//! The stream to all readers stops before such a change. It is put into the outboxes of those that want it, which are
//! emptied before the stream goes on, and reliable readers that don't want it get a GAP. While every reader wants everything,
//! all this costs one look at a flag.

use std::time::Instant;

use super::heartbeat::Sent;
use super::{BareKey, Writer};
use crate::Transmit;
use crate::filter::PayloadFilter;
use crate::wire::{Guid, SequenceNumber};

/// How far is known what readers want.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Selection {
    /// Whether there is a reader that does not want everything.
    is_needed: bool,
    /// All want what is from the stream's position to below this.
    wanted_until: SequenceNumber,
    /// The first change that has been put into an outbox and may be there still.
    unsent_from: Option<SequenceNumber>,
}

impl Selection {
    /// The first change that must not be dropped, because it is in an outbox.
    pub(super) fn unsent_from(&self) -> Option<SequenceNumber> {
        self.unsent_from
    }

    /// Whether readers may share what is sent again.
    pub(super) fn is_needed(&self) -> bool {
        self.is_needed
    }
}

impl Writer {
    /// A matched reader wants only what passes `filter`; all where there is none. What it has been sent already is not
    /// affected.
    pub fn set_reader_filter(&mut self, reader: Guid, filter: Option<PayloadFilter>) {
        if let Some(proxy) = self.readers.get_mut(&reader) {
            proxy.interest.set_filter(filter);
            self.refresh_selection();
        }
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
            let start = self.live.end();
            for (guid, proxy) in &mut self.readers {
                let is_wanted = proxy.interest.wants(change);
                let is_reliable = proxy.is_reliable();
                let has_news = proxy.outbox.select(start, sequence, is_wanted, is_reliable);
                if has_news && !std::mem::replace(&mut proxy.is_queued, true) {
                    self.queue.push_back(*guid);
                }
            }
            self.selection.unsent_from.get_or_insert(sequence);
            sent.changes += 1;
            sent.weight += change.weight();
            self.live.skip_to(sequence.next());
        }
        self.count_sent(now, sent, false);
    }

    /// The next change of the stream, where some readers do not want it as it is.
    fn next_selected(&mut self) -> Option<SequenceNumber> {
        if self.live.is_in_change() {
            return None;
        }
        let Self { history, live, .. } = self;
        let (sequence, change) = history.next_from(live.end())?;
        if sequence < self.selection.wanted_until {
            return None;
        }
        let mut readers = self.readers.values();
        if readers.all(|proxy| proxy.interest.wants_unchanged(change)) {
            self.selection.wanted_until = sequence.next();
            return None;
        }
        Some(sequence)
    }
}
