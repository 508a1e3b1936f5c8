//! The walk over a message's built-in submessages, and what comes of it.

use core::ops::ControlFlow;

use super::{
    announcement::Reading,
    answer::{Answer, MAX_DATAGRAM},
    fill::Speech,
    request::{Request, Scan},
    world::World,
};
use crate::{
    abi::{
        BUILTIN_WRITERS, PARTICIPANT_MESSAGES, PEER_PROVEN, PEER_SUPERVISED, Peer, RemoteWriter,
        WRITER_FRAGMENTED,
    },
    bytes::Bytes,
    entity::{
        ENTITY_ID_UNKNOWN, EntityId, GuidPrefix, SPDP_WRITER, builtin_reader, builtin_writer,
        is_type_lookup_writer,
    },
    submessage::{Submessage, id, part},
    walk::{HEADER_LEN, PREFIX_UNKNOWN},
};

/// A GAP that skips more numbers than this is left to rtpsd, for it may be a lie.
const MAX_GAP: u64 = 1 << 16;

/// What the exchange has to know of a message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Setting {
    /// CLOCK_MONOTONIC, in nanoseconds.
    pub now_ns: u64,
    /// The time since counts began, in nanoseconds.
    pub age_ns: u64,
    /// Where the datagram came from, IPv4 mapped.
    pub source: [u8; 16],
    /// This host's participant in the domain.
    pub own: GuidPrefix,
    /// The participant that the message's header names.
    pub sender: GuidPrefix,
    /// The domain id.
    pub domain_id: u32,
    /// The most bytes of a datagram in answer.
    pub datagram_size: u32,
    /// Where the valid part of the message ends.
    pub end: u32,
    /// Whether an answer may go to where the message came from.
    pub may_answer: bool,
    /// The datagram came from an address of this host.
    pub is_local: bool,
}

/// What comes of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The sender is unknown, and nothing in the message makes it known: nothing else counts.
    pub unknown: bool,
    /// The sender was unknown, and is to be remembered.
    pub new: bool,
    /// rtpsd has to be given the message.
    pub news: bool,
    /// rtpsd need not answer it.
    pub answered: bool,
    /// There is something to answer.
    pub speaks: bool,
}

/// What the exchange is busy with.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Submessages.
    Walk,
    /// The announcement in one of them.
    Announcement,
    /// What ACKNACKs have asked for.
    Requests,
    /// Nothing more.
    Finished,
}

/// An ACKNACK that is due to a built-in writer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Acknack {
    /// The last number that the writer has announced.
    pub(super) last: u64,
    pub(super) is_due: bool,
    /// The writer is to say what it has.
    pub(super) is_greeting: bool,
}

/// The exchange over one message of one sender.
///
/// Plain fields, because the kernel keeps it in a map and its type information cannot describe a tag in the
/// middle of an enum.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Exchange {
    /// As given at the beginning.
    pub setting: Setting,
    /// The sender, as it is to be remembered once the answer is sent.
    pub peer: Peer,
    pub(super) acknacks: [Acknack; BUILTIN_WRITERS as usize],
    pub(super) requests: [Request; BUILTIN_WRITERS as usize],
    pub(super) reading: Reading,
    pub(super) scan: Scan,
    pub(super) speech: Speech,
    phase: Phase,
    /// Of the next submessage.
    offset: u32,
    /// There is a `peer`.
    pub(super) is_known: bool,
    pub(super) is_new: bool,
    pub(super) has_news: bool,
    /// rtpsd has to see to the message as if the kernel had done nothing.
    pub(super) is_passed_on: bool,
    /// Our announcement is due.
    pub(super) is_greeting: bool,
    /// The sender has just shown that it hears us.
    pub(super) is_proof: bool,
    /// INFO_DST names another participant.
    is_foreign: bool,
    /// INFO_DST names us.
    pub(super) is_directed: bool,
    /// INFO_SRC names another participant than the sender.
    is_relayed: bool,
    /// The datagram in the making.
    pub answer: Answer,
}

impl Default for Exchange {
    fn default() -> Self {
        Self::new()
    }
}

impl Exchange {
    /// Without a message.
    pub fn new() -> Self {
        Self {
            setting: Setting::default(),
            peer: Peer::default(),
            acknacks: [Acknack::NONE; BUILTIN_WRITERS as usize],
            requests: [Request::NONE; BUILTIN_WRITERS as usize],
            reading: Reading::NONE,
            scan: Scan::START,
            speech: Speech::START,
            phase: Phase::Finished,
            offset: 0,
            is_known: false,
            is_new: false,
            has_news: false,
            is_passed_on: false,
            is_greeting: false,
            is_proof: false,
            is_foreign: false,
            is_directed: false,
            is_relayed: false,
            answer: Answer::new(),
        }
    }

    /// Begins with a message whose header and submessages have been checked, and what is known of its sender.
    #[inline(always)]
    pub fn begin(&mut self, setting: &Setting, known: Option<&Peer>) {
        self.setting = Setting {
            datagram_size: setting.datagram_size.min(MAX_DATAGRAM),
            ..*setting
        };
        self.is_known = known.is_some();
        if let Some(peer) = known {
            self.peer = *peer;
            self.peer.last_seen_ns = setting.now_ns;
            for writer in &mut self.peer.writers {
                writer.next = writer.next.max(1);
            }
        }
        self.acknacks = [Acknack::NONE; BUILTIN_WRITERS as usize];
        for request in &mut self.requests {
            request.clear();
        }
        self.scan = Scan::START;
        self.speech = Speech::START;
        self.phase = Phase::Walk;
        self.offset = HEADER_LEN;
        self.is_new = false;
        self.has_news = false;
        self.is_passed_on = false;
        self.is_greeting = false;
        self.is_proof = false;
        self.is_foreign = false;
        self.is_directed = false;
        self.is_relayed = false;
    }

    /// One step through the message; to be repeated until it breaks, at most [`TURNS`](super::TURNS) times.
    #[inline(always)]
    pub fn step(&mut self, message: &(impl Bytes + ?Sized), world: &impl World) -> ControlFlow<()> {
        match self.phase {
            Phase::Walk => self.walk(message),
            Phase::Announcement => {
                if self.read_announcement(message, world).is_break() {
                    self.phase = Phase::Walk;
                }
            }
            Phase::Requests => {
                if self.scan_requests(world).is_break() {
                    self.phase = Phase::Finished;
                }
            }
            Phase::Finished => return ControlFlow::Break(()),
        }
        ControlFlow::Continue(())
    }

    /// What has come of the message, after its last step.
    #[inline(always)]
    pub fn outcome(&self) -> Outcome {
        let asks = self.is_greeting
            || self.acknacks.iter().any(|acknack| acknack.is_due)
            || self.requests.iter().any(Request::is_due);
        let can_answer = self.setting.may_answer && self.peer.reply_port != 0;
        let is_beyond_us =
            self.is_passed_on || self.phase != Phase::Finished || asks && !can_answer;
        let is_passed_on = self.is_known && is_beyond_us;
        Outcome {
            unknown: !self.is_known,
            new: self.is_new,
            news: self.is_known && (self.has_news || is_passed_on),
            answered: !is_passed_on,
            speaks: self.is_known && asks && !is_passed_on,
        }
    }

    /// rtpsd has to see to the message.
    #[inline(always)]
    pub(super) const fn pass_on(&mut self) {
        self.is_passed_on = true;
    }

    #[inline(always)]
    fn walk(&mut self, message: &(impl Bytes + ?Sized)) {
        let submessage = if self.offset < self.setting.end {
            Submessage::read(message, self.offset).ok()
        } else {
            None
        };
        let Some(submessage) = submessage else {
            self.phase = Phase::Requests;
            return;
        };
        self.offset = submessage.end();
        match submessage.id {
            id::INFO_DST => self.destination(message, &submessage),
            id::INFO_SRC => self.source(message, &submessage),
            id::DATA
            | id::DATA_FRAG
            | id::HEARTBEAT
            | id::HEARTBEAT_FRAG
            | id::GAP
            | id::ACKNACK
            | id::NACK_FRAG
                if !self.is_foreign && !self.is_relayed =>
            {
                self.follow(message, &submessage);
            }
            _ => {}
        }
    }

    #[inline(always)]
    fn destination(&mut self, message: &(impl Bytes + ?Sized), submessage: &Submessage) {
        let Some(prefix) = message.load::<12>(submessage.start) else {
            return;
        };
        self.is_directed = prefix == self.setting.own;
        self.is_foreign = !self.is_directed && prefix != PREFIX_UNKNOWN;
    }

    #[inline(always)]
    fn source(&mut self, message: &(impl Bytes + ?Sized), submessage: &Submessage) {
        const PREFIX: u32 = 8;
        let Some(prefix) = message.load::<12>(submessage.start + PREFIX) else {
            return;
        };
        self.is_relayed = prefix != self.setting.sender;
        if self.is_relayed {
            self.pass_on();
        }
    }

    /// A submessage between two entities.
    #[inline(always)]
    fn follow(&mut self, message: &(impl Bytes + ?Sized), submessage: &Submessage) {
        let Some(fields) = message.load::<20>(submessage.start) else {
            return;
        };
        let is_data = submessage.id == id::DATA || submessage.id == id::DATA_FRAG;
        let (reader, writer): (EntityId, EntityId) = if is_data {
            (part(&fields, 4), part(&fields, 8))
        } else {
            (part(&fields, 0), part(&fields, 4))
        };
        if writer == SPDP_WRITER {
            if submessage.id == id::DATA {
                self.reading = Reading::begin(submessage, part(&fields, 2));
                self.phase = Phase::Announcement;
            }
            return;
        }
        let Some(number) = number_of(reader, writer) else {
            // rtpsd answers that, and nothing else of the message.
            self.has_news |= is_type_lookup_writer(writer);
            return;
        };
        // To ask an unproven sender for its samples costs no more than to greet it; they are not taken yet.
        let can_ask = self.setting.may_answer && self.peer.reply_port != 0;
        let is_askable = submessage.id == id::HEARTBEAT && can_ask;
        let is_acknack = submessage.id == id::ACKNACK;
        if self.is_known && (self.is_proven(is_acknack) || is_askable) {
            self.take(message, submessage, &fields, number);
        }
    }

    /// Whether the sender takes part in the reliable protocol: it has named us, or acknowledges, which some small stacks
    /// do without INFO_DST, and so has got something from us. From then on its samples are taken. If it knew us before it may think that we have them all, and be silent:
    /// so its writers are greeted. And it is told what ours have: it may not have known them when we announced us.
    #[inline(always)]
    fn is_proven(&mut self, is_acknack: bool) -> bool {
        if self.peer.flags & PEER_PROVEN == 0 {
            if !self.is_directed && !is_acknack {
                return false;
            }
            self.peer.flags |= PEER_PROVEN;
            self.has_news = true;
            self.is_proof = true;
            for acknack in &mut self.acknacks {
                acknack.is_due = true;
                acknack.is_greeting = true;
            }
        }
        true
    }

    #[inline(always)]
    fn take(
        &mut self,
        message: &(impl Bytes + ?Sized),
        submessage: &Submessage,
        fields: &[u8; 20],
        number: u32,
    ) {
        let sequence = match submessage.id {
            id::DATA | id::DATA_FRAG => submessage.i64(part(fields, 12)),
            _ => submessage.i64(part(fields, 8)),
        } as u64;
        match submessage.id {
            id::DATA => self.data(number, sequence),
            id::DATA_FRAG => self.fragment(number, sequence),
            id::HEARTBEAT => self.heartbeat(message, submessage, number, sequence),
            id::GAP => self.gap(message, submessage, number, sequence),
            id::ACKNACK => {
                if let Some(reader) = self.peer.readers.get_mut(number as usize) {
                    reader.acknowledged = sequence;
                }
                if let Some(request) = self.requests.get_mut(number as usize) {
                    let count = submessage.u32(part(fields, 16));
                    request.read(message, submessage, sequence, count);
                }
            }
            id::HEARTBEAT_FRAG => {
                if self
                    .writer(number)
                    .is_some_and(|writer| sequence >= writer.next)
                {
                    self.pass_on();
                }
            }
            // NACK_FRAG.
            _ => self.pass_on(),
        }
    }

    #[inline(always)]
    fn writer(&mut self, number: u32) -> Option<&mut RemoteWriter> {
        self.peer.writers.get_mut(number as usize)
    }

    /// In order or not at all, but for participant messages, of which only the last says anything.
    #[inline(always)]
    fn data(&mut self, number: u32, sequence: u64) {
        let is_message = number == PARTICIPANT_MESSAGES;
        let is_wanted = !is_message || self.peer.flags & PEER_SUPERVISED != 0;
        let Some(writer) = self.writer(number) else {
            return;
        };
        if sequence == writer.next || is_message && sequence > writer.next {
            writer.next = sequence + 1;
            self.has_news |= is_wanted;
        }
    }

    #[inline(always)]
    fn fragment(&mut self, number: u32, sequence: u64) {
        if let Some(writer) = self.writer(number)
            && sequence >= writer.next
        {
            writer.flags |= WRITER_FRAGMENTED;
            self.pass_on();
        }
    }

    /// What is missing is asked for; what is gone without having come is for rtpsd to believe or not, but for
    /// participant messages, which replace one another.
    #[inline(always)]
    fn heartbeat(
        &mut self,
        message: &(impl Bytes + ?Sized),
        submessage: &Submessage,
        number: u32,
        first: u64,
    ) {
        const LAST: u32 = 16;
        let Some(last) = message.load::<8>(submessage.start + LAST) else {
            return;
        };
        let last = submessage.i64(last) as u64;
        let is_proven = self.peer.flags & PEER_PROVEN != 0;
        let Some(writer) = self.writer(number) else {
            return;
        };
        if number == PARTICIPANT_MESSAGES {
            writer.next = writer.next.max(first);
        }
        let next = writer.next;
        let is_beyond_us = writer.flags & WRITER_FRAGMENTED != 0 || first > next;
        let Some(acknack) = self.acknacks.get_mut(number as usize) else {
            return;
        };
        // It has said what it has.
        if acknack.is_greeting {
            *acknack = Acknack::NONE;
        }
        if is_beyond_us {
            self.is_passed_on |= is_proven;
        } else if last >= next || !submessage.is_final() {
            acknack.is_due = true;
            acknack.last = acknack.last.max(last);
        }
    }

    /// A GAP that begins at what is expected is taken; what it says of later numbers is for rtpsd.
    #[inline(always)]
    fn gap(
        &mut self,
        message: &(impl Bytes + ?Sized),
        submessage: &Submessage,
        number: u32,
        start: u64,
    ) {
        const BASE: u32 = 16;
        let Some(list) = message.load::<12>(submessage.start + BASE) else {
            return;
        };
        let base = submessage.i64(part(&list, 0)) as u64;
        let end = base + u64::from(submessage.u32(part(&list, 8)));
        let is_wanted = number != PARTICIPANT_MESSAGES;
        let Some(writer) = self.writer(number) else {
            return;
        };
        let next = writer.next;
        if start <= next && base > next && base - next <= MAX_GAP {
            writer.next = base;
        }
        // The range may be empty, and the list may be.
        self.has_news |= is_wanted && (base > next && start < base || end > base && end > next);
    }
}

impl Acknack {
    pub(super) const NONE: Self = Self {
        last: 0,
        is_due: false,
        is_greeting: false,
    };
}

/// The number of a built-in topic of which both are endpoints; the reader may be any.
#[inline(always)]
fn number_of(reader: EntityId, writer: EntityId) -> Option<u32> {
    let number = builtin_writer(writer)?;
    (reader == ENTITY_ID_UNKNOWN || builtin_reader(reader) == Some(number)).then_some(number)
}
