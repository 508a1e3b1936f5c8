//! What is to be sent to one reader alone: what it asked for, and what it must know.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::{Duration, Instant};

use super::interest::Interest;
use super::requests::{ChangeRequest, FragmentRequest};
use super::suppression::Suppression;
use super::{Packet, Position, WriterTiming};
use crate::history::HistoryCache;
use crate::wire::{FragmentNumberSet, SequenceNumber, SequenceNumberSet};

/// What a reader can be sent: the changes of `history` from `start` to below `end`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Source<'a> {
    pub(super) history: &'a HistoryCache,
    pub(super) interest: &'a Interest,
    /// The first change that concerns the reader.
    pub(super) start: SequenceNumber,
    /// The first change that has not been sent to all readers yet.
    pub(super) end: SequenceNumber,
}

impl Source<'_> {
    /// So many changes that the reader does not want are passed over at once.
    const MAX_UNWANTED: usize = 256;

    /// Whether the change is there and concerns the reader.
    pub(super) fn has(&self, sequence: SequenceNumber) -> bool {
        let change = self
            .history
            .get(sequence)
            .filter(|_| sequence >= self.start);
        change.is_some_and(|change| self.interest.wants(change))
    }

    /// From `sequence`, which is not there or unwanted, the end of those of which the same is known.
    pub(super) fn end_of_gap(&self, sequence: SequenceNumber) -> SequenceNumber {
        let mut end = sequence.max(self.start);
        for _ in 0..Self::MAX_UNWANTED {
            let Some((next, change)) = self.history.next_from(end).filter(|(n, _)| *n < self.end)
            else {
                return self.end;
            };
            if self.interest.wants(change) {
                return next;
            }
            end = next.next();
        }
        end
    }
}

/// The things to be sent to one reader, in the order of their fields; but fragments of a change go before later changes.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox {
    /// What it gets instead of what goes to all. That waits for nothing.
    selected: VecDeque<Selected>,
    /// A GAP from 1 to below the first change that concerns the reader.
    gap_to_start: bool,
    /// Before the HEARTBEAT, one says that there is nothing yet.
    begins_empty: bool,
    changes: Option<ChangeRequest>,
    fragments: VecDeque<FragmentRequest>,
    /// What a best-effort late joiner gets of the past: the next change, and the first that it gets anyway.
    replay: Option<(Position, SequenceNumber)>,
    heartbeat: bool,
    /// Bytes that may still be sent before the reader has answered or some time has passed.
    budget: usize,
    is_paused: bool,
    not_before: Option<Instant>,
    suppressed_changes: Suppression,
    suppressed_fragments: Suppression,
}

/// A part of what is written, as one reader wants it.
#[derive(Clone, Debug)]
enum Selected {
    Change(Position),
    /// Not what is in this range.
    Gap(Range<SequenceNumber>),
}

impl Outbox {
    /// So many sets of fragments are kept, more than a reader can ask for in one datagram; it repeats what is
    /// forgotten.
    const MAX_FRAGMENT_REQUESTS: usize = 32;
    /// Above every change.
    const NO_END: SequenceNumber = SequenceNumber(i64::MAX);
    /// Time must pass, or else what waits would be looked at for ever.
    const MIN_PAUSE: Duration = Duration::from_millis(1);

    /// The reader must be told what the writer has, and that it need not wait for what is below `start`.
    pub(super) fn greet(&mut self, start: SequenceNumber) {
        self.gap_to_start = start > SequenceNumber(1);
        self.heartbeat = true;
    }

    /// The same for a reader that has not seen the greeting, and for which the past ends with the first HEARTBEAT: no
    /// GAP can say that even the first change concerns it, a HEARTBEAT from the time of the match does.
    pub(super) fn greet_anew(&mut self, start: SequenceNumber) {
        self.begins_empty = start == SequenceNumber(1);
        self.greet(start);
    }

    /// The change `sequence` is to be sent.
    pub(super) fn select(&mut self, sequence: SequenceNumber) {
        let position = Position::start_of(sequence);
        self.selected.push_back(Selected::Change(position));
    }

    /// The reader is to be told that it does not get these changes.
    pub(super) fn skip(&mut self, gap: Range<SequenceNumber>) {
        if gap.is_empty() {
            return;
        }
        match self.selected.back_mut() {
            Some(Selected::Gap(last)) if last.end == gap.start => last.end = gap.end,
            _ => self.selected.push_back(Selected::Gap(gap)),
        }
    }

    /// Whether there is something in the place of what goes to all.
    pub(super) fn has_selected(&self) -> bool {
        !self.selected.is_empty()
    }

    /// The reader does not want any more what `wants` says no to; a reliable one is told so.
    pub(super) fn deselect(&mut self, is_reliable: bool, wants: impl Fn(SequenceNumber) -> bool) {
        for selected in &mut self.selected {
            if let Selected::Change(Position { sequence, .. }) = *selected
                && !wants(sequence)
            {
                *selected = Selected::Gap(sequence..sequence.next());
            }
        }
        let is_told = |selected: &Selected| is_reliable || matches!(selected, Selected::Change(_));
        self.selected.retain(is_told);
    }

    /// The changes from `first` to below `end` are to be sent without being asked for.
    pub(super) fn replay(&mut self, first: SequenceNumber, end: SequenceNumber) {
        self.replay = (first < end).then_some((Position::start_of(first), end));
    }

    /// A HEARTBEAT is to be sent after all else.
    pub(super) fn announce(&mut self) {
        self.heartbeat = true;
    }

    /// The reader asks for changes beside those that it asked for before and has not acknowledged since: a reader
    /// need not repeat at once what it is waiting for. Those from `end` on are on their way.
    pub(super) fn request_changes(
        &mut self,
        now: Instant,
        missing: SequenceNumberSet,
        end: SequenceNumber,
        timing: &WriterTiming,
    ) {
        let earlier = self.changes.take();
        let asks = ChangeRequest::new(missing, end).is_some();
        self.changes = match earlier {
            Some(earlier) => earlier.merge(missing, end),
            None => ChangeRequest::new(missing, end),
        };
        if let (true, Some(request)) = (asks, &self.changes) {
            let allowed_at = self
                .suppressed_changes
                .allowed_at(now, request.first())
                .max(now + timing.nack_response_delay);
            self.is_paused = false;
            self.not_before = Some(allowed_at);
        }
    }

    /// The reader asks for fragments of a change; it may take several sets to name them all.
    pub(super) fn request_fragments(
        &mut self,
        now: Instant,
        sequence: SequenceNumber,
        missing: FragmentNumberSet,
        timing: &WriterTiming,
    ) {
        self.fragments
            .retain_mut(|request| request.supersede(sequence, &missing));
        let request = FragmentRequest::new(sequence, missing);
        let Some(first) = request.next() else {
            return;
        };
        if self.fragments.len() < Self::MAX_FRAGMENT_REQUESTS {
            let earlier = |other: &FragmentRequest| other.sequence() <= sequence;
            let place = self.fragments.partition_point(earlier);
            self.fragments.insert(place, request);
            let allowed_at = self
                .suppressed_fragments
                .allowed_at(now, first)
                .max(now + timing.nack_response_delay);
            let waiting = self
                .not_before
                .filter(|_| !std::mem::take(&mut self.is_paused));
            self.not_before = waiting.max(Some(allowed_at));
        }
    }

    /// Until when everything must wait.
    pub(super) fn not_before(&self) -> Option<Instant> {
        self.not_before
    }

    /// Whether there is nothing to send.
    pub(super) fn is_empty(&self) -> bool {
        self.selected.is_empty() && !self.gap_to_start && !self.has_repairs() && !self.heartbeat
    }

    /// Whether all that remains is a HEARTBEAT.
    pub(super) fn wants_heartbeat(&self) -> bool {
        self.heartbeat
    }

    /// A HEARTBEAT is sent; gives whether as of the time of the match, and another one follows.
    pub(super) fn announced(&mut self) -> bool {
        self.heartbeat = std::mem::take(&mut self.begins_empty);
        self.heartbeat
    }

    /// So many bytes may be sent from now on, until the next call: no more than the reader's inbox takes at once.
    pub(super) fn refill(&mut self, bytes: usize) {
        self.budget = bytes;
        if std::mem::take(&mut self.is_paused) {
            self.not_before = None;
        }
    }

    /// Whether what remains must wait until the reader has answered or some time has passed.
    pub(super) fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// Appends all but the HEARTBEAT, as long as it fits; gives whether nothing of it remains for now.
    pub(super) fn fill(
        &mut self,
        now: Instant,
        source: &Source<'_>,
        timing: &WriterTiming,
        packet: &mut Packet<'_>,
    ) -> bool {
        if !self.fill_selected(source, packet) {
            return false;
        }
        if self.not_before.is_some_and(|due| due > now) {
            return false;
        }
        self.not_before = None;
        if !self.fill_gap_to_start(source, packet) {
            return false;
        }
        if self.budget == 0 && self.has_repairs() {
            self.pause(now, timing);
            return true;
        }
        let before = packet.len();
        let is_done = self.fill_earlier_fragments(now, source, timing, packet)
            && self.fill_changes(now, source, timing, packet)
            && self.fill_fragments(now, source, timing, packet, Self::NO_END)
            && self.fill_replay(source, packet);
        self.budget = self.budget.saturating_sub(packet.len() - before);
        is_done
    }

    /// The changes that the reader asks for, where the answer may begin now.
    pub(super) fn sharable(&self, now: Instant) -> Option<&ChangeRequest> {
        let may_begin = |request: &&ChangeRequest| {
            self.budget > 0 && self.suppressed_changes.allowed_at(now, request.first()) <= now
        };
        self.changes.as_ref().filter(may_begin)
    }

    /// A change that the reader asks for was sent to it and others, in so many bytes.
    pub(super) fn share(&mut self, sequence: SequenceNumber, bytes: usize) {
        self.budget = self.budget.saturating_sub(bytes);
        if let Some(request) = &mut self.changes {
            request.share(sequence);
        }
    }

    fn has_repairs(&self) -> bool {
        self.changes.is_some() || !self.fragments.is_empty() || self.replay.is_some()
    }

    /// The reader is asked how far it has got, so that it need not wait for the time to pass.
    fn pause(&mut self, now: Instant, timing: &WriterTiming) {
        let can_answer = self.replay.is_none();
        self.heartbeat |= can_answer && !self.is_paused;
        self.is_paused = true;
        self.not_before = Some(now + timing.nack_suppression.max(Self::MIN_PAUSE));
    }

    fn fill_selected(&mut self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        while let Some(selected) = self.selected.front_mut() {
            let is_done = match selected {
                Selected::Gap(gap) => packet.gap(gap.start, SequenceNumberSet::empty(gap.end)),
                Selected::Change(position) => match source.history.get(position.sequence) {
                    Some(change) => packet.change(position, change),
                    // The next HEARTBEAT says so.
                    None => true,
                },
            };
            if !is_done {
                return false;
            }
            self.selected.pop_front();
        }
        true
    }

    fn fill_gap_to_start(&mut self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        let list = SequenceNumberSet::empty(source.start);
        if self.gap_to_start && packet.gap(SequenceNumber(1), list) {
            self.gap_to_start = false;
        }
        !self.gap_to_start
    }

    fn fill_changes(
        &mut self,
        now: Instant,
        source: &Source<'_>,
        timing: &WriterTiming,
        packet: &mut Packet<'_>,
    ) -> bool {
        let Some(request) = &mut self.changes else {
            return true;
        };
        if !request.has_begun() {
            self.suppressed_changes.begin(now, request.first(), timing);
        }
        let before = packet.len();
        let is_done = request.fill(source, packet);
        self.suppressed_changes.proceed(now, request.position());
        if is_done {
            // The reader can say at once what got lost again. What is shared brings a HEARTBEAT of its own.
            self.heartbeat |= packet.len() > before || !request.is_shared();
            self.changes = None;
        }
        is_done
    }

    /// A reader that keeps nothing out of order makes no use of later changes before it has these, and asks again for
    /// all of them: if those went first, it would never get on.
    fn fill_earlier_fragments(
        &mut self,
        now: Instant,
        source: &Source<'_>,
        timing: &WriterTiming,
        packet: &mut Packet<'_>,
    ) -> bool {
        let changes = self.changes.as_ref();
        let end = changes.map_or(Self::NO_END, |request| request.position().sequence);
        self.fill_fragments(now, source, timing, packet, end)
    }

    /// Appends fragments of the changes below `end`.
    fn fill_fragments(
        &mut self,
        now: Instant,
        source: &Source<'_>,
        timing: &WriterTiming,
        packet: &mut Packet<'_>,
        end: SequenceNumber,
    ) -> bool {
        let is_early = |request: &&mut FragmentRequest| request.sequence() < end;
        while let Some(request) = self.fragments.front_mut().filter(is_early) {
            if let Some(first) = request.next().filter(|_| !request.has_begun()) {
                self.suppressed_fragments.begin(now, first, timing);
            }
            let is_done = request.fill(source, packet);
            self.suppressed_fragments.proceed(now, request.position());
            if !is_done {
                return false;
            }
            self.fragments.pop_front();
            self.heartbeat = true;
        }
        true
    }

    fn fill_replay(&mut self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        while let Some((position, end)) = &mut self.replay {
            let next = source.history.next_from(position.sequence);
            let Some((sequence, change)) = next.filter(|(sequence, _)| sequence < end) else {
                self.replay = None;
                break;
            };
            position.skip_to(sequence);
            if !source.interest.wants(change) {
                position.skip_to(sequence.next());
            } else if !packet.change(position, change) {
                return false;
            }
        }
        true
    }
}
