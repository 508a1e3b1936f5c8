//! What readers ask for, and how far the answer has got (RTPS 2.5 sections 8.4.7.2.7 and 8.3.8.11).

use super::outbox::Source;
use super::{Packet, Position};
use crate::wire::{FragmentNumberSet, SequenceNumber, SequenceNumberSet};

/// The changes that an ACKNACK asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChangeRequest {
    missing: SequenceNumberSet,
    first: SequenceNumber,
    end: SequenceNumber,
    position: Position,
    /// Members that were sent to several readers at once, and not by [`fill`](Self::fill).
    shared: SequenceNumberSet,
    has_begun: bool,
}

impl ChangeRequest {
    /// The members of `missing` from 1 to below `end`; `None` without any.
    pub(super) fn new(missing: SequenceNumberSet, end: SequenceNumber) -> Option<Self> {
        let first = missing.iter().find(|member| member.0 > 0)?;
        if first >= end {
            return None;
        }
        Some(Self {
            missing,
            first,
            end,
            position: Position::start_of(first),
            shared: SequenceNumberSet::empty(missing.base),
            has_begun: false,
        })
    }

    /// What the reader still waits for, now that it says what is `missing`: this and what it asked for before from
    /// the base on, as far as it has not been sent; `None` without any.
    pub(super) fn merge(self, missing: SequenceNumberSet, end: SequenceNumber) -> Option<Self> {
        let all = self.unsent().chain(missing.iter());
        let all = SequenceNumberSet::from_members(missing.base, all);
        let mut request = Self::new(all, end)?;
        // A large change that is half sent is not begun anew, unless it is asked for again.
        if request.first == self.position.sequence && !missing.contains(request.first) {
            request.position = self.position;
            request.has_begun = self.has_begun && missing.is_empty();
        }
        Some(request)
    }

    /// What has not been sent.
    pub(super) fn unsent(&self) -> impl Iterator<Item = SequenceNumber> + '_ {
        let wanted = self.missing.iter();
        let wanted = wanted.filter(|m| (self.position.sequence..self.end).contains(m));
        wanted.filter(|member| !self.shared.contains(*member))
    }

    /// Whether a change is asked for and has not been sent.
    pub(super) fn wants(&self, sequence: SequenceNumber) -> bool {
        (self.position.sequence..self.end).contains(&sequence)
            && self.missing.contains(sequence)
            && !self.shared.contains(sequence)
    }

    /// A change was sent to others as well.
    pub(super) fn share(&mut self, sequence: SequenceNumber) {
        self.shared.insert(sequence);
    }

    /// Whether a part of the answer was sent to others as well.
    pub(super) fn is_shared(&self) -> bool {
        !self.shared.is_empty()
    }

    /// What it begins with.
    pub(super) fn first(&self) -> Position {
        Position::start_of(self.first)
    }

    /// What comes next.
    pub(super) fn position(&self) -> Position {
        self.position
    }

    /// Whether a part of the answer has been sent.
    pub(super) fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Appends a GAP for all that is not there, then the changes; gives whether the answer is complete.
    pub(super) fn fill(&mut self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        if !self.has_begun {
            if !self.fill_gap(source, packet) {
                return false;
            }
            self.has_begun = true;
        }
        while let Some(sequence) = self.member_from(self.position.sequence) {
            self.position.skip_to(sequence);
            let change = source
                .history
                .get(sequence)
                .filter(|_| source.has(sequence));
            match change {
                Some(change) if !packet.change(&mut self.position, change) => return false,
                Some(_) => {}
                None => self.position.skip_to(sequence.next()),
            }
        }
        // What is shared may lie behind the last that was sent here.
        let members = self.missing.iter().filter(|member| *member < self.end);
        if let Some(last) = members.last() {
            self.position.skip_to(last.next());
        }
        true
    }

    fn member_from(&self, from: SequenceNumber) -> Option<SequenceNumber> {
        let end = self.missing.base.plus(SequenceNumberSet::MAX_SPAN);
        (from.0..end.min(self.end).0)
            .map(SequenceNumber)
            .find(|sequence| self.wants(*sequence))
    }

    /// One GAP says it all: a range from the first that is not there, and later ones as members of its list.
    fn fill_gap(&self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        let members = || {
            let members = self.missing.iter();
            members.filter(|member| (self.first..self.end).contains(member))
        };
        let Some(first) = members().find(|member| !source.has(*member)) else {
            return true;
        };
        let range_end = source.end_of_gap(first);
        let others = members().filter(|member| *member > range_end && !source.has(*member));
        packet.gap(first, SequenceNumberSet::from_members(range_end, others))
    }
}

/// The fragments that a NACK_FRAG asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct FragmentRequest {
    sequence: SequenceNumber,
    missing: FragmentNumberSet,
    next: u32,
    has_begun: bool,
}

impl FragmentRequest {
    /// All members of `missing`.
    pub(super) fn new(sequence: SequenceNumber, missing: FragmentNumberSet) -> Self {
        Self {
            sequence,
            missing,
            next: 1,
            has_begun: false,
        }
    }

    /// Leaves to a newer request for fragments of `sequence` what that speaks of; gives whether any remain.
    pub(super) fn supersede(
        &mut self,
        sequence: SequenceNumber,
        newer: &FragmentNumberSet,
    ) -> bool {
        if sequence != self.sequence {
            return true;
        }
        let span = newer.span();
        let others = self.missing.iter().filter(|member| !span.contains(member));
        self.missing = FragmentNumberSet::from_members(self.missing.base, others);
        self.next().is_some()
    }

    /// The change that the fragments are of.
    pub(super) fn sequence(&self) -> SequenceNumber {
        self.sequence
    }

    /// The next fragment that is asked for.
    pub(super) fn next(&self) -> Option<Position> {
        let fragment = self.missing.iter().find(|member| *member >= self.next)?;
        Some(Position {
            sequence: self.sequence,
            fragment,
        })
    }

    /// How far the answer has got.
    pub(super) fn position(&self) -> Position {
        Position {
            sequence: self.sequence,
            fragment: self.next,
        }
    }

    /// Whether a part of the answer has been sent.
    pub(super) fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Appends the fragments, or a GAP where the change is gone; gives whether the answer is complete.
    pub(super) fn fill(&mut self, source: &Source<'_>, packet: &mut Packet<'_>) -> bool {
        self.has_begun = true;
        let change = source.history.get(self.sequence);
        let Some(change) = change.filter(|_| source.has(self.sequence)) else {
            let list = SequenceNumberSet::empty(self.sequence.next());
            return packet.gap(self.sequence, list);
        };
        while let Some(Position { fragment, .. }) = self.next() {
            if !packet.has_fragment(fragment, change) {
                break;
            }
            if !packet.fragment(self.sequence, fragment, change) {
                return false;
            }
            self.next = fragment + 1;
        }
        true
    }
}
