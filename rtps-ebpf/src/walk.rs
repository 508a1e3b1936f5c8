//! The walk over a message's submessages (RTPS 2.5, 8.3.4): whom does it concern?
//!
//! [`Walk::step`] takes one submessage at a time, so that the kernel drives it with `bpf_loop` and
//! user space ([`examine`]) with a plain loop. The rule for broken messages is the standard's
//! (8.3.4.1): from the first malformed submessage on nothing counts, what came before does.

use crate::{
    abi::MAX_SUBMESSAGES,
    bytes::Bytes,
    counter::{Counter, Reason},
    entity::{ENTITY_ID_UNKNOWN, EntityId, Guid, GuidPrefix, guid, is_built_in, slot},
    slot_set::SlotSet,
    submessage::{Meaning, Submessage},
};

/// The header, the submessages, and the step that finds the end.
pub const MAX_STEPS: u32 = MAX_SUBMESSAGES + 2;
/// Bytes of an RTPS header: "RTPS", version, vendor, GUID prefix.
pub(crate) const HEADER_LEN: u32 = 20;
pub(crate) const MAGIC: u32 = u32::from_be_bytes(*b"RTPS");
pub(crate) const MAJOR_VERSION: u8 = 2;
/// INFO_DST with this prefix: to everyone.
pub(crate) const PREFIX_UNKNOWN: GuidPrefix = [0; 12];
/// The slot of rtpsd, which no app has.
const DAEMON_SLOT: u8 = 0;

/// Which apps read from a remote writer.
pub trait Routes {
    /// Adds the slots of all apps with a reader that is matched with `writer`.
    fn add_readers(&self, writer: &Guid, slots: &mut SlotSet);

    /// Whether the participant may have sent the datagram in hand, as far as its source address tells: one whose
    /// addresses are known sends from these only.
    #[inline(always)]
    fn may_send(&self, _participant: &GuidPrefix) -> bool {
        true
    }
}

/// What a step came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// There may be more submessages.
    Continue,
    /// The message is at its end.
    Done,
    /// The rest of the message does not count.
    Malformed(Reason),
}

/// Where a walk stands, and what it has found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Walk {
    /// This host's participant in the domain.
    own: GuidPrefix,
    /// The participant that the current submessages come from.
    source: GuidPrefix,
    /// The participant that sent the message, whatever INFO_SRC says.
    sender: GuidPrefix,
    targets: SlotSet,
    /// The writer of the source whose readers are among the targets: a datagram mostly has samples of one writer.
    published: EntityId,
    offset: u32,
    /// INFO_DST named another participant.
    foreign: bool,
    skipped_foreign: bool,
    foreign_source: bool,
    built_in: bool,
}

/// What a walk over a message found.
///
/// Plain fields, because the kernel's type information cannot describe a tag in the middle of an
/// enum; [`Findings::concerned`] has the shape to match on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Findings {
    /// The apps that the valid part of the message concerns.
    pub targets: SlotSet,
    /// The valid part concerns rtpsd.
    pub built_in: bool,
    /// A valid submessage was for another participant.
    pub skipped_foreign: bool,
    /// It names a known participant as its sender, which does not send from that address: nothing of it counts.
    pub foreign_source: bool,
    /// Why only a part of the message is valid.
    pub malformed: Option<Reason>,
}

/// Whom a message concerns: at least an app, or rtpsd.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Concerned {
    /// The apps.
    pub targets: SlotSet,
    /// Also or only rtpsd.
    pub built_in: bool,
}

impl Findings {
    /// Whom the message concerns, or the counter of what to drop it for.
    #[inline(always)]
    pub const fn concerned(&self) -> Result<Concerned, Counter> {
        if self.foreign_source {
            return Err(Counter::DropForeignSource);
        }
        if self.built_in || !self.targets.is_empty() {
            return Ok(Concerned {
                targets: self.targets,
                built_in: self.built_in,
            });
        }
        Err(match (self.malformed, self.skipped_foreign) {
            (Some(_), _) => Counter::DropMalformed,
            (None, true) => Counter::DropForeignDestination,
            (None, false) => Counter::DropUnroutable,
        })
    }
}

impl Walk {
    /// At the beginning of a message. `own` is this host's GUID prefix in the domain.
    #[inline(always)]
    pub const fn new(own: GuidPrefix) -> Self {
        Self {
            own,
            source: PREFIX_UNKNOWN,
            sender: PREFIX_UNKNOWN,
            targets: SlotSet::EMPTY,
            published: ENTITY_ID_UNKNOWN,
            offset: 0,
            foreign: false,
            skipped_foreign: false,
            foreign_source: false,
            built_in: false,
        }
    }

    /// Goes on with another message of the same burst, from the same address. What it concerns is added, and what has
    /// been looked up need not be again.
    #[inline(always)]
    pub const fn next_message(&mut self) {
        self.offset = 0;
        self.foreign = false;
    }

    /// Takes the header, or one submessage, with the timestamp before it.
    #[inline(always)]
    pub fn step(&mut self, bytes: &(impl Bytes + ?Sized), routes: &impl Routes) -> Step {
        let taken = if self.offset == 0 {
            self.header(bytes, routes)
        } else if self.foreign_source {
            return Step::Done;
        } else if self.offset < bytes.len() {
            self.submessage(bytes, routes)
        } else {
            return Step::Done;
        };
        match taken {
            Ok(()) => Step::Continue,
            Err(reason) => Step::Malformed(reason),
        }
    }

    /// The participant that sent the message.
    pub const fn sender(&self) -> &GuidPrefix {
        &self.sender
    }

    /// Where the valid part of the message ends, as far as the walk has got.
    #[inline(always)]
    pub const fn end(&self) -> u32 {
        self.offset
    }

    /// What there was, given how the walk ended.
    #[inline(always)]
    pub const fn findings(&self, malformed: Option<Reason>) -> Findings {
        Findings {
            targets: self.targets,
            built_in: self.built_in,
            skipped_foreign: self.skipped_foreign,
            foreign_source: self.foreign_source,
            malformed,
        }
    }

    /// RTPS 2.5, 8.3.5.
    #[inline(always)]
    fn header(
        &mut self,
        bytes: &(impl Bytes + ?Sized),
        routes: &impl Routes,
    ) -> Result<(), Reason> {
        let Some(header) = bytes.load::<{ HEADER_LEN as usize }>(0) else {
            return Err(Reason::TooShort);
        };
        let [m0, m1, m2, m3, major, _minor, _, _, prefix @ ..] = header;
        if u32::from_be_bytes([m0, m1, m2, m3]) != MAGIC {
            return Err(Reason::BadMagic);
        }
        if major != MAJOR_VERSION {
            return Err(Reason::BadVersion);
        }
        self.sender = prefix;
        if prefix != self.source {
            self.comes_from(prefix, routes);
        }
        self.offset = HEADER_LEN;
        Ok(())
    }

    #[inline(always)]
    fn submessage(
        &mut self,
        bytes: &(impl Bytes + ?Sized),
        routes: &impl Routes,
    ) -> Result<(), Reason> {
        let (submessage, meaning) = Submessage::read_next(bytes, self.offset)?;
        self.follow(meaning, routes);
        self.offset = submessage.end();
        Ok(())
    }

    #[inline(always)]
    fn follow(&mut self, meaning: Meaning, routes: &impl Routes) {
        match meaning {
            Meaning::Other => {}
            Meaning::Source(prefix) => self.comes_from(prefix, routes),
            Meaning::Destination(prefix) => {
                self.foreign = prefix != PREFIX_UNKNOWN && prefix != self.own;
            }
            Meaning::ToReader { .. } | Meaning::ToWriter(_) if self.foreign => {
                self.skipped_foreign = true;
            }
            Meaning::ToReader { reader, writer } if reader == ENTITY_ID_UNKNOWN => {
                self.publish(writer, routes);
            }
            Meaning::ToReader { reader, .. } => self.direct(reader),
            Meaning::ToWriter(writer) => self.direct(writer),
        }
    }

    /// What follows names `participant` as its source.
    #[inline(always)]
    fn comes_from(&mut self, participant: GuidPrefix, routes: &impl Routes) {
        self.source = participant;
        self.published = ENTITY_ID_UNKNOWN;
        self.foreign_source |= !routes.may_send(&participant);
    }

    /// From `writer` to whoever reads from it.
    #[inline(always)]
    fn publish(&mut self, writer: EntityId, routes: &impl Routes) {
        if is_built_in(writer) {
            self.built_in = true;
        } else if writer != self.published {
            routes.add_readers(&guid(&self.source, writer), &mut self.targets);
            self.published = writer;
        }
    }

    /// To one entity of this host.
    #[inline(always)]
    fn direct(&mut self, entity: EntityId) {
        if is_built_in(entity) || slot(entity) == DAEMON_SLOT {
            self.built_in = true;
        } else {
            self.targets.insert(slot(entity));
        }
    }
}

/// Walks a whole message: exactly what the kernel does, for user space.
pub fn examine(message: &(impl Bytes + ?Sized), own: GuidPrefix, routes: &impl Routes) -> Findings {
    let mut walk = Walk::new(own);
    let malformed = (0..MAX_STEPS)
        .find_map(|_| match walk.step(message, routes) {
            Step::Continue => None,
            Step::Done => Some(None),
            Step::Malformed(reason) => Some(Some(reason)),
        })
        .unwrap_or(Some(Reason::TooManySubmessages));
    walk.findings(malformed)
}

#[cfg(test)]
mod tests;
