//! The answer to a message, datagram by datagram: our announcement, what our readers say, what our writers say.

use core::ops::ControlFlow;

use super::{
    answer::{ACKNACK_LEN, Ends, GAP_LEN, HEARTBEAT_LEN, INFO_TS_LEN},
    count::next_count,
    exchange::Exchange,
    world::World,
};
use crate::{
    abi::{BUILTIN_WRITERS, BuiltinWriter, PARTICIPANT_MESSAGES, PUBLICATIONS},
    entity::{
        PARTICIPANT_MESSAGE_READER, PARTICIPANT_MESSAGE_WRITER, SEDP_PUBLICATIONS_READER,
        SEDP_PUBLICATIONS_WRITER, SEDP_SUBSCRIPTIONS_READER, SEDP_SUBSCRIPTIONS_WRITER,
    },
    number_set::MAX_BITS,
};

/// A set cannot begin where not all of its numbers would exist.
const MAX_BASE: u64 = i64::MAX as u64 - MAX_BITS as u64;

/// Fast DDS answers an empty ACKNACK only if it begins at 0, which others take for malformed.
const FAST_DDS: [u8; 2] = [0x01, 0x0f];

/// What is to be said next.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    /// Our announcement.
    Announcement,
    /// What each of our writers has, to a participant that is new to us.
    Heartbeats,
    /// What each of our readers has.
    Acknacks,
    /// What of the things asked of a writer is gone.
    Gap,
    /// What of them is there.
    Samples,
    /// What the writer has, after all that.
    Heartbeat,
    /// Nothing.
    Nothing,
}

/// How far the answer has got.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Speech {
    topic: Topic,
    /// The built-in topic in question.
    number: u32,
    /// Within a request.
    bit: u32,
    /// The datagram has the `timestamp`.
    has_timestamp: bool,
    timestamp: [u8; 8],
}

impl Speech {
    pub(super) const START: Self = Self {
        topic: Topic::Announcement,
        number: 0,
        bit: 0,
        has_timestamp: false,
        timestamp: [0; 8],
    };

    /// Goes on with the same for the next built-in topic, or with something else.
    #[inline(always)]
    fn next_or(&mut self, topic: Topic) {
        self.number += 1;
        if self.number >= BUILTIN_WRITERS {
            self.number = 0;
            self.topic = topic;
        }
    }
}

impl Exchange {
    /// Begins a datagram.
    #[inline(always)]
    pub fn open(&mut self) {
        let Self {
            answer, setting, ..
        } = self;
        answer.begin(setting.datagram_size, &setting.own, &setting.sender);
        self.speech.has_timestamp = false;
    }

    /// Says one thing more; breaks when the datagram is complete. To be repeated at most
    /// [`FILL_TURNS`](super::FILL_TURNS) times.
    #[inline(always)]
    pub fn fill(&mut self, world: &impl World) -> ControlFlow<()> {
        match self.speech.topic {
            Topic::Announcement => self.fill_announcement(world),
            Topic::Heartbeats => self.fill_heartbeats(world),
            Topic::Acknacks => self.fill_acknack(),
            Topic::Gap => self.fill_gap(),
            Topic::Samples => self.fill_sample(world),
            Topic::Heartbeat => self.fill_heartbeat(world),
            Topic::Nothing => ControlFlow::Break(()),
        }
    }

    /// Whether the datagram says anything.
    #[inline(always)]
    pub fn has_datagram(&self) -> bool {
        !self.answer.is_empty()
    }

    /// Whether something remains for another datagram.
    #[inline(always)]
    pub fn has_more(&self) -> bool {
        self.speech.topic != Topic::Nothing && self.has_datagram()
    }

    #[inline(always)]
    fn fill_announcement(&mut self, world: &impl World) -> ControlFlow<()> {
        self.speech.topic = if self.is_proof {
            Topic::Heartbeats
        } else {
            Topic::Acknacks
        };
        if let Some(announcement) = world.announcement().filter(|_| self.is_greeting)
            && self.answer.room(announcement.len).is_continue()
            && let Some(rest) = self.answer.rest()
        {
            world.copy(&announcement.bytes, rest);
            self.answer.advance(announcement.len);
            self.speech.topic = Topic::Heartbeats;
        }
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn fill_heartbeats(&mut self, world: &impl World) -> ControlFlow<()> {
        let number = self.speech.number;
        self.say_heartbeat(world, number, false)?;
        self.speech.next_or(Topic::Acknacks);
        ControlFlow::Continue(())
    }

    /// All from what is expected to what was announced, or that there is nothing to ask for.
    #[inline(always)]
    fn fill_acknack(&mut self) -> ControlFlow<()> {
        let number = self.speech.number;
        if let (Some(acknack), Some(writer)) = (
            self.acknacks.get(number as usize),
            self.peer.writers.get_mut(number as usize),
        ) && acknack.is_due
        {
            self.answer.room(ACKNACK_LEN)?;
            let base = writer.next.min(MAX_BASE);
            let missing = (acknack.last + 1).saturating_sub(base);
            let bits = missing.min(MAX_BITS.into()) as u32;
            writer.acknack_count = next_count(writer.acknack_count, self.setting.age_ns);
            let ends = ends(number);
            let is_greeting = acknack.is_greeting && bits == 0;
            let is_fast_dds = self.setting.sender[..2] == FAST_DDS && base == 1;
            let base = if is_greeting && is_fast_dds { 0 } else { base };
            let is_final = bits == 0 && !is_greeting;
            self.answer
                .acknack(ends, base, bits, writer.acknack_count, is_final);
        }
        self.speech.next_or(Topic::Gap);
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn fill_gap(&mut self) -> ControlFlow<()> {
        let number = self.speech.number;
        let (Some(request), Some(reader)) = (
            self.requests.get(number as usize),
            self.peer.readers.get_mut(number as usize),
        ) else {
            return ControlFlow::Break(());
        };
        if request.gap_start != 0 {
            self.answer.room(GAP_LEN)?;
            let (start, base) = (request.gap_start, request.gap_base);
            let ends = ends(number);
            self.answer
                .gap(ends, start, base, request.gap_bits, &request.gap_list);
        }
        if request.is_due() {
            reader.sent_ns = self.setting.now_ns;
            reader.sent_from = request.first;
            reader.sent_to = request.first;
        }
        self.speech.topic = Topic::Samples;
        self.speech.bit = 0;
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn fill_sample(&mut self, world: &impl World) -> ControlFlow<()> {
        let Speech { number, bit, .. } = self.speech;
        let (Some(request), Some(reader)) = (
            self.requests.get(number as usize),
            self.peer.readers.get_mut(number as usize),
        ) else {
            return ControlFlow::Break(());
        };
        if request.first == 0 || bit >= request.count {
            self.speech.topic = Topic::Heartbeat;
            return ControlFlow::Continue(());
        }
        let sequence = request.base + u64::from(bit);
        if request.bits.contains(bit)
            && let Some(sample) = world.sample(number, sequence)
        {
            self.answer.room(INFO_TS_LEN + sample.len)?;
            let speech = &mut self.speech;
            if !speech.has_timestamp || speech.timestamp != sample.timestamp {
                speech.has_timestamp = true;
                speech.timestamp = sample.timestamp;
                self.answer.timestamp(sample.timestamp);
            }
            if let Some(rest) = self.answer.rest() {
                world.copy(&sample.bytes, rest);
                self.answer.advance(sample.len);
            }
        }
        reader.sent_to = sequence + 1;
        self.speech.bit = bit + 1;
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn fill_heartbeat(&mut self, world: &impl World) -> ControlFlow<()> {
        let number = self.speech.number;
        let Some(request) = self.requests.get(number as usize) else {
            return ControlFlow::Break(());
        };
        let base = request.base;
        let has_all = world
            .writer(number)
            .is_some_and(|writer| base > writer.last);
        if request.heartbeat {
            self.say_heartbeat(world, number, has_all)?;
        }
        self.speech.topic = Topic::Gap;
        self.speech.next_or(Topic::Nothing);
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn say_heartbeat(
        &mut self,
        world: &impl World,
        number: u32,
        is_final: bool,
    ) -> ControlFlow<()> {
        let (Some(writer), Some(reader)) = (
            world.writer(number),
            self.peer.readers.get_mut(number as usize),
        ) else {
            return ControlFlow::Continue(());
        };
        self.answer.room(HEARTBEAT_LEN)?;
        let BuiltinWriter { first, last, .. } = *writer;
        reader.heartbeat_count = next_count(reader.heartbeat_count, self.setting.age_ns);
        let ends = ends(number);
        let first = first.max(1).min(last + 1);
        self.answer
            .heartbeat(ends, first, last, reader.heartbeat_count, is_final);
        ControlFlow::Continue(())
    }
}

/// The endpoints of a built-in topic, whichever of them is ours.
#[inline(always)]
const fn ends(number: u32) -> Ends {
    match number {
        PUBLICATIONS => Ends {
            reader: SEDP_PUBLICATIONS_READER,
            writer: SEDP_PUBLICATIONS_WRITER,
        },
        PARTICIPANT_MESSAGES => Ends {
            reader: PARTICIPANT_MESSAGE_READER,
            writer: PARTICIPANT_MESSAGE_WRITER,
        },
        _ => Ends {
            reader: SEDP_SUBSCRIPTIONS_READER,
            writer: SEDP_SUBSCRIPTIONS_WRITER,
        },
    }
}
