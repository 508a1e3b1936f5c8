//! Putting the fragments of large samples together (RTPS 2.5 sections 8.4.14.1 and 8.3.8.3).
//!
//! Fragments are copied straight to where they belong in the sample. Nothing is believed in advance: a buffer
//! grows with what has arrived, up to a limited distance ahead of it, and samples in the making are limited in
//! number and in bytes.

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::time::Instant;

use bytes::Bytes;

use super::ReaderTiming;
use super::ranges::Ranges;
use crate::wire::{DataFrag, FragmentNumberSet, InlineQos, PayloadKind, SequenceNumber, Timestamp};

/// Samples in the making of one writer.
const MAX_PARTIALS: usize = 64;
/// Bytes that a fragment may leave open behind all that have arrived before it.
const LOOK_AHEAD: usize = 1 << 20;
/// Ranges of received fragments of one sample: more holes than that come from nobody honest.
const MAX_RANGES: usize = 1 << 16;
/// After so long without a fragment, fragments that contradict what has arrived replace it.
const STALE: std::time::Duration = std::time::Duration::from_secs(1);

/// What fragments have brought.
#[derive(Debug)]
pub(super) enum Progress {
    /// Nothing that somebody waits for.
    Incomplete,
    /// The last of the fragments that were asked for then: it is time to ask for more.
    Repaired(Instant),
    /// The rest of a sample.
    Complete(Assembled),
}

/// A sample of which all fragments have arrived.
#[derive(Debug)]
pub(super) struct Assembled {
    pub(super) timestamp: Option<Timestamp>,
    pub(super) inline_qos: InlineQos,
    pub(super) kind: PayloadKind,
    pub(super) payload: Bytes,
    /// When fragments of it had to be asked for.
    pub(super) asked: Option<Instant>,
}

/// How much is to be asked for at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    pub(super) sets: usize,
    /// Bytes of fragments, of which each has 65,535 at the most.
    pub(super) bytes: usize,
}

/// The missing fragments of a sample.
#[derive(Debug)]
pub(super) struct Request {
    pub(super) sequence: SequenceNumber,
    pub(super) missing: FragmentNumberSet,
}

/// The samples in the making of one writer.
#[derive(Debug)]
pub(super) struct Reassembly {
    partials: BTreeMap<SequenceNumber, Partial>,
    /// Bytes of all their buffers.
    bytes: usize,
    max_sample_size: usize,
    /// Whether what is missing is asked for, so that every sample can still be completed.
    is_reliable: bool,
}

#[derive(Debug)]
struct Partial {
    sample_size: usize,
    fragment_size: u16,
    timestamp: Option<Timestamp>,
    inline_qos: InlineQos,
    kind: PayloadKind,
    buffer: Vec<u8>,
    received: Ranges,
    /// The highest fragment that a HEARTBEAT_FRAG has announced.
    announced: u32,
    arrived: Instant,
    /// The highest fragment asked for, and when.
    asked: Option<(i64, Instant)>,
    /// The writer has been told that everything below this fragment is here or has been asked for.
    told: u32,
}

impl Reassembly {
    pub(super) fn new(max_sample_size: usize, is_reliable: bool) -> Self {
        Self {
            partials: BTreeMap::new(),
            bytes: 0,
            max_sample_size,
            is_reliable,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.partials.is_empty()
    }

    /// Bytes that the samples in the making take.
    #[cfg(test)]
    pub(super) fn reserved(&self) -> usize {
        self.partials
            .values()
            .map(|partial| partial.buffer.capacity())
            .sum()
    }

    pub(super) fn contains(&self, sequence: SequenceNumber) -> bool {
        self.partials.contains_key(&sequence)
    }

    /// Takes in fragments.
    pub(super) fn add(
        &mut self,
        now: Instant,
        timestamp: Option<Timestamp>,
        fragment: &DataFrag<'_>,
    ) -> Progress {
        if fragment.sample_size as usize > self.max_sample_size
            || self.make_room(now, fragment).is_none()
        {
            return Progress::Incomplete;
        }
        let partial = self
            .partials
            .entry(fragment.sequence)
            .or_insert_with(|| Partial::new(now, timestamp, fragment));
        let before = partial.buffer.len();
        partial.add(now, fragment);
        self.bytes += partial.buffer.len() - before;
        if !partial.is_complete() {
            return partial
                .completes_request(fragment)
                .map_or(Progress::Incomplete, Progress::Repaired);
        }
        match self.take(fragment.sequence) {
            Some(partial) => Progress::Complete(partial.into_assembled()),
            None => Progress::Incomplete,
        }
    }

    /// A HEARTBEAT_FRAG: fragments up to `last` are there; returns whether the sample is in the making.
    pub(super) fn announce(&mut self, sequence: SequenceNumber, last: u32) -> bool {
        let Some(partial) = self.partials.get_mut(&sequence) else {
            return false;
        };
        let last = last.min(partial.total());
        if last <= partial.announced {
            // The writer asks again: the answer has been lost.
            partial.told = 1;
        }
        partial.announced = partial.announced.max(last);
        true
    }

    /// Drops samples that are not wanted any more.
    pub(super) fn remove(&mut self, range: RangeInclusive<SequenceNumber>) {
        while let Some((&sequence, _)) = self.partials.range(range.clone()).next() {
            self.take(sequence);
        }
    }

    /// The fragments to ask for now, within `limit`, of the samples up to `last` and of those announced by fragments;
    /// and when to look again for what is not to be asked for yet. All fragments have been sent of samples before
    /// `newest`. Takes what is asked for, and what is on its way because it was, from the limit.
    pub(super) fn requests(
        &mut self,
        now: Instant,
        last: SequenceNumber,
        newest: SequenceNumber,
        timing: &ReaderTiming,
        limit: &mut Limit,
    ) -> (Vec<Request>, Option<Instant>) {
        let (mut requests, mut again) = (Vec::new(), None);
        let newest = self
            .partials
            .last_key_value()
            .map_or(newest, |(sequence, _)| newest.max(*sequence));
        for (&sequence, partial) in &mut self.partials {
            if limit.sets == 0 {
                break;
            }
            if sequence > last && partial.announced == 0 {
                continue;
            }
            let (sets, later) = partial.request(now, sequence < newest, timing, limit);
            requests.extend(
                sets.into_iter()
                    .map(|missing| Request { sequence, missing }),
            );
            requests.extend(
                partial
                    .progress()
                    .map(|missing| Request { sequence, missing }),
            );
            again = [again, later].into_iter().flatten().min();
        }
        (requests, again)
    }

    /// Keeps number and bytes of samples in the making in bounds. `None` when there is no room for this fragment.
    fn make_room(&mut self, now: Instant, fragment: &DataFrag<'_>) -> Option<()> {
        let sequence = fragment.sequence;
        match self.partials.get(&sequence) {
            Some(partial) if partial.contradicts(fragment) => {
                if now.saturating_duration_since(partial.arrived) < STALE {
                    return None;
                }
                self.take(sequence);
            }
            Some(_) => {}
            None => self.bound(sequence, |reassembly| {
                reassembly.partials.len() >= MAX_PARTIALS
            })?,
        }
        let budget = self.max_sample_size.saturating_mul(2);
        let end = fragment.offset().saturating_add(fragment.payload.len());
        let present = self.partials.get(&sequence).map_or(0, |p| p.buffer.len());
        let growth = end.saturating_sub(present);
        self.bound(sequence, |reassembly| reassembly.bytes + growth > budget)
    }

    fn bound(&mut self, sequence: SequenceNumber, exceeded: impl Fn(&Self) -> bool) -> Option<()> {
        while exceeded(self) {
            let victim = self.victim(sequence)?;
            self.take(victim);
        }
        Some(())
    }

    /// The sample that makes room for a fragment of `sequence`. With repairs that is the newest, because the oldest
    /// are needed first; without them it is the one that has got nothing for the longest time, because what it
    /// misses is lost.
    fn victim(&self, sequence: SequenceNumber) -> Option<SequenceNumber> {
        if self.is_reliable {
            let (newest, _) = self.partials.last_key_value()?;
            return (*newest > sequence).then_some(*newest);
        }
        self.partials
            .iter()
            .filter(|(other, _)| **other != sequence)
            .min_by_key(|(_, partial)| partial.arrived)
            .map(|(oldest, _)| *oldest)
    }

    fn take(&mut self, sequence: SequenceNumber) -> Option<Partial> {
        let partial = self.partials.remove(&sequence)?;
        self.bytes -= partial.buffer.len();
        Some(partial)
    }
}

impl Partial {
    fn new(now: Instant, timestamp: Option<Timestamp>, first: &DataFrag<'_>) -> Self {
        Self {
            sample_size: first.sample_size as usize,
            fragment_size: first.fragment_size,
            timestamp,
            inline_qos: first.inline_qos,
            kind: first.kind,
            buffer: Vec::new(),
            received: Ranges::default(),
            announced: 0,
            arrived: now,
            asked: None,
            told: 1,
        }
    }

    fn contradicts(&self, fragment: &DataFrag<'_>) -> bool {
        self.sample_size != fragment.sample_size as usize
            || self.fragment_size != fragment.fragment_size
            || self.kind != fragment.kind
    }

    /// How many fragments the sample has.
    fn total(&self) -> u32 {
        self.sample_size
            .div_ceil(usize::from(self.fragment_size))
            .try_into()
            .unwrap_or(u32::MAX)
    }

    fn is_complete(&self) -> bool {
        self.received.covers(1..i64::from(self.total()) + 1)
    }

    fn add(&mut self, now: Instant, fragment: &DataFrag<'_>) {
        let first = i64::from(fragment.first_fragment);
        let numbers = first..first + i64::from(fragment.fragment_count);
        let (start, end) = (
            fragment.offset(),
            fragment.offset().saturating_add(fragment.payload.len()),
        );
        let too_far = start > self.buffer.len().saturating_add(LOOK_AHEAD);
        if too_far || end > self.sample_size || self.received.len() >= MAX_RANGES {
            return;
        }
        if self.received.covers(numbers.clone()) {
            return;
        }
        self.grow(end);
        if start == self.buffer.len() {
            self.buffer.extend_from_slice(fragment.payload);
        } else {
            if end > self.buffer.len() {
                self.buffer.resize(end, 0);
            }
            if let Some(place) = self.buffer.get_mut(start..end) {
                place.copy_from_slice(fragment.payload);
            }
        }
        self.received.insert(numbers);
        self.arrived = now;
    }

    /// Reserves room for `end` bytes: ahead by as much as there is, but not beyond the sample.
    fn grow(&mut self, end: usize) {
        if end > self.buffer.capacity() {
            let wanted = (2 * self.buffer.capacity())
                .max(end)
                .max(LOOK_AHEAD / 16)
                .min(self.sample_size);
            self.buffer.reserve_exact(wanted - self.buffer.len());
        }
    }

    /// When these were asked for, if they are the last of those; they are on the way no more then.
    fn completes_request(&mut self, fragment: &DataFrag<'_>) -> Option<Instant> {
        let (last, asked) = self.asked?;
        let first = i64::from(fragment.first_fragment);
        let numbers = first..first + i64::from(fragment.fragment_count);
        if !numbers.contains(&last) {
            return None;
        }
        self.asked = None;
        Some(asked)
    }

    fn into_assembled(self) -> Assembled {
        Assembled {
            timestamp: self.timestamp,
            inline_qos: self.inline_qos,
            kind: self.kind,
            payload: Bytes::from(self.buffer),
            asked: self.asked.map(|(_, asked)| asked),
        }
    }

    /// How far the sample has come, for a writer that announces its fragments, if that is news: it may wait for it.
    fn progress(&mut self) -> Option<FragmentNumberSet> {
        let from = self.asked.map_or(1, |(last, _)| last + 1);
        let open = u32::try_from(self.received.first_missing(from)).ok()?;
        let is_news = self.announced > 0 && open > self.told;
        is_news.then(|| {
            self.told = open;
            FragmentNumberSet::nothing(open)
        })
    }

    /// The fragments to ask for now, within `limit`, and when to ask for others.
    fn request(
        &mut self,
        now: Instant,
        is_overtaken: bool,
        timing: &ReaderTiming,
        limit: &mut Limit,
    ) -> (Vec<FragmentNumberSet>, Option<Instant>) {
        let (fragments, again) = self.askable(now, is_overtaken, timing);
        let size = usize::from(self.fragment_size);
        let mut room = limit.bytes / size;
        let on_their_way = self.received.missing(1..fragments.start).take(room);
        room -= on_their_way.count();
        let (mut from, mut sets) = (fragments.start, Vec::new());
        while sets.len() < limit.sets {
            let mut missing = self
                .received
                .missing(from..fragments.end)
                .take(room)
                .peekable();
            let Some(&base) = missing.peek() else {
                break;
            };
            from = base + i64::from(FragmentNumberSet::MAX_SPAN);
            let members = missing.take_while(|number| *number < from);
            let members = members.map(|number| number as u32);
            let set = FragmentNumberSet::from_members(base as u32, members);
            room -= set.iter().count();
            sets.push(set);
        }
        limit.sets -= sets.len();
        limit.bytes = room * size;
        if let Some(last) = sets.last() {
            self.asked = Some((i64::from(last.span().end) - 1, now));
        }
        (sets, again)
    }

    /// The fragments that may be asked for now if they are missing, and when others may. Those behind the last
    /// received one may not have been sent yet while others still come, unless a newer sample has overtaken this one;
    /// and the repairs of those asked for lately may be on their way.
    fn askable(
        &self,
        now: Instant,
        is_overtaken: bool,
        timing: &ReaderTiming,
    ) -> (Range<i64>, Option<Instant>) {
        let all = i64::from(self.total()) + 1;
        let silent_from = self.arrived + timing.fragment_silence;
        let sent = self
            .received
            .end()
            .unwrap_or(1)
            .max(i64::from(self.announced) + 1);
        let (end, silence) = if now < silent_from && sent < all && !is_overtaken {
            (sent, Some(silent_from))
        } else {
            (all, None)
        };
        let (start, repair) = match self.asked {
            Some((asked, at)) => {
                let repaired = at.max(self.arrived) + timing.nack_suppression;
                if now < repaired {
                    (asked + 1, Some(repaired))
                } else {
                    (1, None)
                }
            }
            None => (1, None),
        };
        (start..end, [silence, repair].into_iter().flatten().min())
    }
}
