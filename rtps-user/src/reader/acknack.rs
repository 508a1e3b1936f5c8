//! ACKNACK and NACK_FRAG: when and what a reliable reader answers (RTPS 2.5 sections 8.3.8.1, 8.3.8.11 and
//! 8.4.12.2).
//!
//! A number that has been asked for is not asked for again while its repair may be on the way; a number of which
//! fragments have come is asked for by fragments. Repairs come in order: when the last of those that were asked for
//! together has come, what is still missing of them is lost again. That is also the time to ask for more, where not
//! everything was asked for at once.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::reassembly::Limit;
use super::repair_time::RepairTime;
use super::writer_proxy::WriterProxy;
use super::{ReaderConfig, ReaderTiming};
use crate::count::Count;
use crate::wire::{AckNack, MessageWriter, NackFrag, SequenceNumber, SequenceNumberSet};

/// Requests that are remembered; of older ones it is forgotten that they were made.
const MAX_REQUESTS: usize = 16;
/// How often something is asked for while nothing is heard of the writer.
const MAX_UNANSWERED: u32 = 4;
/// Bytes of a message with INFO_DST and the longest ACKNACK.
const ACKNACK_MESSAGE_LEN: usize = 20 + 16 + 60;
/// Bytes of a NACK_FRAG with a full bitmap and its header.
const NACK_FRAG_LEN: usize = 68;
/// What can be asked for at once whatever the configuration says: the largest fragment.
const LEAST_REQUESTED_BYTES: usize = 1 << 16;

/// What has been answered to one writer.
#[derive(Debug, Default)]
pub(super) struct Responder {
    /// The writer wants an answer even where nothing is missing.
    requested: bool,
    /// The base of the last ACKNACK.
    acknowledged: SequenceNumber,
    acknack_count: Count,
    nack_frag_count: Count,
    requests: VecDeque<Request>,
    repair_time: RepairTime,
    /// How often something was asked for since the writer was heard.
    unanswered: u32,
    /// How long to wait for an answer to the last greeting.
    patience: Duration,
    greetings: u32,
}

/// Numbers that were asked for together.
#[derive(Clone, Copy, Debug)]
struct Request {
    first: SequenceNumber,
    last: SequenceNumber,
    at: Instant,
}

impl Responder {
    pub(super) fn resume(&mut self, count: i32) {
        self.acknack_count = Count::after(count);
        self.nack_frag_count = Count::after(count);
    }

    /// The greater of its counts.
    pub(super) fn count(&self) -> i32 {
        self.acknack_count.max(self.nack_frag_count).value()
    }

    /// An ACKNACK is due even where nothing is missing.
    pub(super) fn request(&mut self) {
        self.requested = true;
    }

    /// Until when `number` is not to be asked for, because it has been lately.
    fn suppressed(&self, number: SequenceNumber, timing: &ReaderTiming) -> Option<Instant> {
        let covers = |request: &&Request| request.first <= number && number <= request.last;
        let latest = self.requests.iter().rev().find(covers)?;
        latest.at.checked_add(timing.nack_suppression)
    }

    /// The writer is there to answer.
    pub(super) fn heard(&mut self) {
        self.unanswered = 0;
    }

    /// What was asked for at that time has come.
    pub(super) fn measured(&mut self, now: Instant, asked: Instant) {
        self.repair_time
            .measured(now.saturating_duration_since(asked));
    }

    /// Whether `number` is the last of those that were asked for together; they are on the way no more then.
    pub(super) fn completes(&mut self, now: Instant, number: SequenceNumber) -> bool {
        if self.requests.is_empty() {
            return false;
        }
        self.forget(now, |request| request.last == number)
    }

    /// As [`completes`](Self::completes), for all numbers below `next`.
    pub(super) fn completes_below(&mut self, now: Instant, next: SequenceNumber) -> bool {
        self.forget(now, |request| request.last < next)
    }

    /// Forgets the requests that are answered; returns whether there was one.
    fn forget(&mut self, now: Instant, is_answered: impl Fn(&Request) -> bool) -> bool {
        let first = self.requests.iter().find(|request| is_answered(request));
        let Some(asked) = first.map(|request| request.at) else {
            return false;
        };
        self.measured(now, asked);
        self.requests.retain(|request| !is_answered(request));
        true
    }

    /// Something is asked for; returns when to look whether it has come. A writer that does not answer has to be
    /// heard first.
    fn ask(&mut self, now: Instant, patience: Duration) -> Option<Instant> {
        self.unanswered = self.unanswered.saturating_add(1);
        (self.unanswered <= MAX_UNANSWERED).then(|| now + patience)
    }

    fn remember(&mut self, now: Instant, timing: &ReaderTiming, asked: &SequenceNumberSet) {
        self.requests
            .retain(|request| request.at + timing.nack_suppression > now);
        if let Some(first) = asked.iter().next() {
            if self.requests.len() >= MAX_REQUESTS {
                self.requests.pop_front();
            }
            let last = asked.iter().last().unwrap_or(first);
            self.requests.push_back(Request {
                first,
                last,
                at: now,
            });
        }
    }
}

impl WriterProxy {
    /// Writes the ACKNACK that greets the writer, so that it tells what it has; returns when to do it again.
    pub(super) fn greet(
        &mut self,
        now: Instant,
        config: &ReaderConfig,
        out: &mut Vec<u8>,
    ) -> Option<Instant> {
        let ReaderTiming {
            greeting_period: shortest,
            greeting_period_max: longest,
            ..
        } = config.timing;
        let patience = (2 * self.responder.patience).clamp(shortest, longest.max(shortest));
        self.responder.patience = patience;
        self.responder.greetings += 1;
        let state = SequenceNumberSet::empty(self.greeting_base());
        let mut message = MessageWriter::new(out, config.guid.prefix);
        message.info_destination(self.guid.prefix);
        message.acknack(&self.acknack(now, config, state, false));
        (self.responder.greetings < config.timing.max_greetings).then(|| now + patience)
    }

    /// Writes what is to be answered to the writer now; returns whether there is something to send, and when to
    /// try again for what must not be asked for yet.
    pub(super) fn respond(
        &mut self,
        now: Instant,
        config: &ReaderConfig,
        out: &mut Vec<u8>,
    ) -> (bool, Option<Instant>) {
        let patience = self
            .responder
            .repair_time
            .patience(config.timing.nack_suppression);
        let timing = &ReaderTiming {
            nack_suppression: patience,
            fragment_silence: config.timing.fragment_silence.min(patience),
            ..config.timing
        };
        let sets = config.datagram_size.saturating_sub(ACKNACK_MESSAGE_LEN) / NACK_FRAG_LEN;
        let bytes = timing.max_requested_bytes.max(LEAST_REQUESTED_BYTES);
        let mut limit = Limit {
            sets: sets.max(1),
            bytes,
        };
        let (announced, newest) = (self.announced(), self.newest_held());
        let (fragments, later) = self
            .reassembly
            .requests(now, announced, newest, timing, &mut limit);
        // However large it is, one has to come some day.
        let least = usize::from(limit.bytes == bytes);
        let most = self.changes_in(limit.bytes).max(least);
        let (missing, again) = self.missing_now(now, timing, most);
        self.responder.remember(now, timing, &missing);
        let is_asking = !missing.is_empty() || !fragments.is_empty();
        let retry = is_asking
            .then(|| self.responder.ask(now, patience))
            .flatten();
        let again = [again, later, retry].into_iter().flatten().min();
        let asks = self.filter.ask();
        // An answer that says nothing new can wait for what is to be asked for soon.
        let says_nothing = missing.is_empty()
            && fragments.is_empty()
            && again.is_some()
            && self.responder.acknowledged == self.base();
        let answers = self.responder.requested && !says_nothing;
        let acknack = answers || asks || !missing.is_empty();
        self.responder.requested &= !acknack;

        let mut message = MessageWriter::new(out, config.guid.prefix);
        message.info_destination(self.guid.prefix);
        if acknack {
            let is_final = missing.is_empty() && !asks;
            message.acknack(&self.acknack(now, config, missing, is_final));
        }
        let mut sent = acknack;
        for request in fragments {
            message.nack_frag(&NackFrag {
                reader: config.guid.entity,
                writer: self.guid.entity,
                sequence: request.sequence,
                missing: request.missing,
                count: self
                    .responder
                    .nack_frag_count
                    .advance(now, timing.count_clock)
                    .value(),
            });
            sent = true;
        }
        (sent, again)
    }

    /// The numbers to ask for now, of the first `most` that are missing, and when others may be asked for again.
    fn missing_now(
        &self,
        now: Instant,
        timing: &ReaderTiming,
        most: usize,
    ) -> (SequenceNumberSet, Option<Instant>) {
        let mut set = SequenceNumberSet::empty(self.base());
        let mut again = None;
        let whole = self
            .missing()
            .filter(|number| !self.reassembly.contains(*number));
        for number in whole.take(most) {
            match self.responder.suppressed(number, timing) {
                Some(until) if until > now => {
                    again = [again, Some(until)].into_iter().flatten().min();
                }
                _ => {
                    set.insert(number);
                }
            }
        }
        (set, again)
    }

    fn acknack(
        &mut self,
        now: Instant,
        config: &ReaderConfig,
        state: SequenceNumberSet,
        is_final: bool,
    ) -> AckNack {
        self.responder.acknowledged = state.base;
        let count = &mut self.responder.acknack_count;
        AckNack {
            reader: config.guid.entity,
            writer: self.guid.entity,
            state,
            count: count.advance(now, config.timing.count_clock).value(),
            is_final,
        }
    }
}
