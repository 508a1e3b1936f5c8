//! The stream of new changes to all matched readers at once.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use super::heartbeat::Sent;
use super::selection::Audience;
use super::{Packet, Position, ReaderProxy, Writer};
use crate::Transmit;
use crate::wire::{Guid, Heartbeat, SequenceNumber, SequenceNumberSet};

/// How far the stream has got.
#[derive(Clone, Copy, Debug)]
pub(super) struct Live {
    position: Position,
    /// Fragments of the change at `position` that a HEARTBEAT_FRAG has announced.
    announced_fragments: u32,
    asserts_liveliness: bool,
}

/// A HEARTBEAT_FRAG goes out each time so many fragments of one change have: readers then ask for the lost ones while
/// the rest of a large change is still being sent.
const FRAGMENTS_PER_HEARTBEAT: u32 = 128;

impl Live {
    /// Nothing sent yet.
    pub(super) fn new() -> Self {
        Self {
            position: Position::start_of(SequenceNumber(1)),
            announced_fragments: 0,
            asserts_liveliness: false,
        }
    }

    /// The first change that has not been sent completely.
    pub(super) fn end(&self) -> SequenceNumber {
        self.position.sequence
    }

    /// The first change of which nothing has been sent.
    pub(super) fn untouched(&self) -> SequenceNumber {
        match self.position.fragment {
            1 => self.position.sequence,
            _ => self.position.sequence.next(),
        }
    }

    /// Whether a part of the next change has been sent.
    pub(super) fn is_in_change(&self) -> bool {
        self.position.fragment > 1
    }

    /// The change in the middle of which the stream is, and the last of its fragments that has been sent, when it is
    /// time to tell reliable readers: after so many fragments, or because they are waited for; `again` repeats it.
    fn fragments_to_announce(
        &mut self,
        interval: u32,
        is_waiting: bool,
        again: bool,
    ) -> Option<(SequenceNumber, u32)> {
        let sent = self.position.fragment - 1;
        if sent < self.announced_fragments {
            // Another change.
            self.announced_fragments = 0;
        }
        let unannounced = sent - self.announced_fragments;
        let is_news = unannounced >= interval || (is_waiting && unannounced > 0);
        if !is_news && !again {
            return None;
        }
        self.announced_fragments = sent;
        Some((self.position.sequence, sent))
    }

    /// Whether the fragments of a change up to `last` have been sent.
    pub(super) fn has_sent(&self, sequence: SequenceNumber, last: u32) -> bool {
        sequence < self.end() || (sequence == self.end() && last < self.position.fragment)
    }

    /// What is below `sequence` is not sent.
    pub(super) fn skip_to(&mut self, sequence: SequenceNumber) {
        self.position.skip_to(sequence);
    }

    /// Moves on to `next`; what lies between was replaced before it could be sent, and reliable readers are told
    /// so. Gives whether that fitted.
    fn skip_removed(
        &mut self,
        next: SequenceNumber,
        is_reliable: bool,
        packet: &mut Packet<'_>,
    ) -> bool {
        let list = SequenceNumberSet::empty(next);
        if next > self.end() && is_reliable && !packet.gap(self.end(), list) {
            return false;
        }
        self.skip_to(next);
        true
    }

    /// A HEARTBEAT shall assert the writer's liveliness.
    pub(super) fn assert_liveliness(&mut self) {
        self.asserts_liveliness = true;
    }
}

impl Writer {
    /// The next datagram for all readers.
    pub(super) fn poll_live(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        if self.live.end() > self.last && !self.wants_heartbeat_to_all() {
            return None;
        }
        if self.destinations.is_empty() {
            self.skip_live();
            return None;
        }
        if let Some(transmit) = self.poll_selected(now, out) {
            return Some(transmit);
        }
        let layout = self.layout.clone();
        let filter_info = self.selection.filter_info();
        let mut packet = Packet::undirected(out, &layout);
        if let Some(info) = &filter_info {
            packet.set_filter_info(info);
        }
        // While there is more to send, a HEARTBEAT is a datagram of its own, so that those around it stay equally long.
        let is_owed = self.heartbeats.is_due();
        let audience = self.selection.audience_of(self.live.end());
        let audience = audience.filter(|_| !is_owed);
        let audience = audience.map(|audience| Arc::clone(&audience.destinations));
        let is_for_all = audience.is_none();
        if !is_owed && !self.announce_fragments(now, &mut packet) {
            self.fill_changes(now, is_for_all, &mut packet);
            if packet.is_empty() {
                // The window may have closed just now.
                self.announce_fragments(now, &mut packet);
            }
        }
        let is_drained = self.live.end() > self.last;
        if self.wants_heartbeat_to_all()
            && (is_owed || is_drained)
            && is_for_all
            && packet.has_room_for_heartbeat()
        {
            self.heartbeat_to_all(now, &mut packet);
        }
        let is_sent = packet.finish();
        self.release();
        is_sent.then(|| Transmit {
            destinations: audience.unwrap_or_else(|| self.destinations.clone()),
            dscp: self.dscp,
        })
    }

    fn wants_heartbeat_to_all(&self) -> bool {
        self.live.asserts_liveliness || self.heartbeats.is_due()
    }

    /// There is nobody to send anything to.
    fn skip_live(&mut self) {
        self.live.skip_to(self.last.next());
        self.live.asserts_liveliness = false;
        self.heartbeats.sent_to_all();
        self.release();
    }

    /// Puts a HEARTBEAT_FRAG, where one is due, into a datagram of its own: fragments fill theirs. Gives whether it did.
    fn announce_fragments(&mut self, now: Instant, packet: &mut Packet<'_>) -> bool {
        if !self.has_reliable_readers() {
            return false;
        }
        let interval = FRAGMENTS_PER_HEARTBEAT.min(self.fragments_in_window() / 2);
        let is_waiting = self.fragment_window.is_closed();
        let again = self.fragment_window.take_question();
        let announced = self.live.fragments_to_announce(interval, is_waiting, again);
        let Some((sequence, last_fragment)) = announced else {
            return false;
        };
        packet.heartbeat_frag(sequence, last_fragment, self.heartbeats.next_count(now));
        true
    }

    /// Appends changes: what is not for all, but one change.
    fn fill_changes(&mut self, now: Instant, is_for_all: bool, packet: &mut Packet<'_>) {
        let is_reliable = self.has_reliable_readers();
        let first = self.live.end();
        let may_append = |sequence| is_for_all || sequence == first;
        let mut sent = Sent::default();
        let mut ends_with_fragment = false;
        while self.live.end() <= self.last
            && may_append(self.live.end())
            && !self.is_selected_next()
        {
            if self.live.is_in_change() && !self.admits_fragment(now) {
                break;
            }
            let next = self.history.next_from(self.live.end());
            let sequence = next.map_or_else(|| self.last.next(), |(sequence, _)| sequence);
            if !self.live.skip_removed(sequence, is_reliable, packet) {
                break;
            }
            let Some((_, change)) = next.filter(|_| may_append(sequence)) else {
                break;
            };
            if !packet.change(&mut self.live.position, change) {
                break;
            }
            sent.changes += 1;
            sent.weight += change.weight();
            ends_with_fragment = self.layout.is_fragmented(change.payload.len());
        }
        self.count_sent(now, sent, ends_with_fragment);
    }

    /// Notes what has been sent to readers, of which the last change was `fragmented` or not.
    pub(super) fn count_sent(&mut self, now: Instant, mut sent: Sent, fragmented: bool) {
        if self.has_reliable_readers() && sent.changes > 0 {
            let is_drained = self.live.end() > self.last;
            sent.flushes = u32::from(is_drained);
            let waits = fragmented || self.fills_window();
            self.handle_sent(now, sent, is_drained && waits);
        }
    }

    /// Whether the next fragment may follow.
    fn admits_fragment(&mut self, now: Instant) -> bool {
        let Position { sequence, fragment } = self.live.position;
        let size = self.fragments_in_window();
        let (readers, audience) = (&self.readers, self.selection.audience_of(sequence));
        let tells = |proxy: &ReaderProxy| proxy.progress(sequence).is_some();
        let can_tell = || served(readers, audience).all(tells);
        let admits = self
            .fragment_window
            .admits(now, (sequence, fragment), size, can_tell);
        if !admits {
            self.window.note_wait();
        }
        admits
    }

    /// A reader has told how far it has got with the fragments of a change.
    pub(super) fn advance_fragments(&mut self, sequence: SequenceNumber) {
        let audience = self.selection.audience_of(sequence);
        if let Some(fragment) = fragment_progress(&self.readers, audience, sequence) {
            let size = self.fragments_in_window();
            self.fragment_window.advance(sequence, fragment, size);
        }
    }

    /// Moves the window where its readers were waited for in vain, and waits for those no more.
    pub(super) fn expire_fragment_window(&mut self, now: Instant) {
        let size = self.fragments_in_window();
        if !self.fragment_window.expire(now, size) {
            return;
        }
        let sequence = self.live.end();
        let audience = self.selection.audience_of(sequence);
        let Some(lowest) = fragment_progress(&self.readers, audience, sequence) else {
            return;
        };
        for (guid, proxy) in &mut self.readers {
            let is_served = audience.is_none_or(|some| some.has(*guid));
            if is_served && proxy.progress(sequence) == Some(lowest) {
                proxy.fall_silent();
            }
        }
        self.advance_fragments(sequence);
    }

    /// A reader wants what has not been sent of a change: it has got all that was.
    pub(super) fn go_on(&mut self, sequence: SequenceNumber) {
        if sequence == self.live.end() && self.fragment_window.is_closed() {
            let fragment = self.live.position.fragment;
            let size = self.fragments_in_window();
            self.fragment_window.advance(sequence, fragment, size);
        }
    }

    pub(super) fn fragments_in_window(&self) -> u32 {
        let fragments = self.window.size() / self.layout.fragment_size();
        u32::try_from(fragments).unwrap_or(u32::MAX).max(2)
    }

    fn handle_sent(&mut self, now: Instant, sent: Sent, is_urgent: bool) {
        let limits = self.sent_per_heartbeat();
        let period = self.config.timing.heartbeat_period;
        self.heartbeats.handle_sent(now, period, sent, &limits);
        if is_urgent {
            self.heartbeats.hurry();
        }
    }

    fn heartbeat_to_all(&mut self, now: Instant, packet: &mut Packet<'_>) {
        let is_final = !self.heartbeats.is_due();
        let heartbeat = Heartbeat {
            liveliness: self.live.asserts_liveliness,
            is_final,
            count: self.heartbeats.next_count(now),
            ..self.heartbeat(SequenceNumber(1))
        };
        packet.heartbeat(heartbeat);
        self.live.asserts_liveliness = false;
        self.heartbeats.sent_to_all();
    }
}

/// The readers that a change is sent to.
fn served<'a>(
    readers: &'a BTreeMap<Guid, ReaderProxy>,
    audience: Option<&'a Audience>,
) -> impl Iterator<Item = &'a ReaderProxy> {
    let is_served = move |proxy: &&ReaderProxy| audience.is_none_or(|some| some.has(proxy.guid()));
    readers.values().filter(is_served)
}

/// The first fragment of a change that a reader of its audience lacks; `None` where not all of them tell. One that has
/// fallen silent does not hold the others up.
fn fragment_progress(
    readers: &BTreeMap<Guid, ReaderProxy>,
    audience: Option<&Audience>,
    sequence: SequenceNumber,
) -> Option<u32> {
    let readers = served(readers, audience).filter(|proxy| !proxy.is_silent());
    let progress = readers.map(|proxy| proxy.progress(sequence));
    progress.reduce(|one, other| Some(one?.min(other?)))?
}
