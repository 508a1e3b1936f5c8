//! Discovery beside a low-level layer that keeps what is known and answers: what each has to tell the other.
//!
//! It hands over the samples of a remote built-in writer in their order, and never acknowledges what it could not hand
//! over; so both agree on how far each writer has got. Only where it cannot know (fragments, GAPs, HEARTBEATs that it
//! leaves to us) it is told. Participant messages that nobody waits for it keeps to itself.

use std::collections::BTreeSet;
use std::time::Instant;

use super::builtin;
use super::{Discovery, DiscoveryEvent};
use crate::wire::{
    EntityId, Guid, GuidPrefix, Heartbeat, MessageReceiver, Received, SequenceNumber, Submessage,
};
use crate::writer::{Publication, Writer};

/// How far a remote built-in writer had got.
#[derive(Debug)]
pub(super) struct Progress {
    reader: EntityId,
    writer: Guid,
    next: Option<SequenceNumber>,
}

impl Discovery {
    /// The low-level layer has seen that a remote built-in reader has all below `base`.
    pub fn acknowledged(&mut self, now: Instant, reader: Guid, base: SequenceNumber) {
        if let Some(writer) = builtin::writer_of(reader.entity)
            && let Some(writer) = self.endpoints.writer_mut(writer)
        {
            writer.acknowledge(now, reader, base);
            self.collect(now);
        }
    }

    /// The participants with built-in readers that have not acknowledged what they were sent.
    pub fn unacknowledged(&self) -> impl Iterator<Item = GuidPrefix> + use<> {
        let lagging: BTreeSet<_> = builtin::topics()
            .filter_map(|(writer, _)| self.endpoints.writer(writer))
            .flat_map(Writer::lagging_readers)
            .map(|reader| reader.prefix)
            .collect();
        lagging.into_iter()
    }

    /// What has happened to the samples of a built-in writer of ours.
    pub fn poll_publication(&mut self) -> Option<(EntityId, Publication)> {
        for (id, reader) in builtin::topics() {
            let writer = self.endpoints.writer(id);
            if writer.is_some_and(Writer::has_publications) {
                let writer = self.endpoints.writer_mut(id)?;
                return Some((id, writer.poll_publication(reader)?));
            }
        }
        None
    }

    /// An app waits for signs of life of a participant's writers, or does not any more.
    pub fn supervise(&mut self, participant: GuidPrefix, is_supervised: bool) {
        self.database.supervise(participant, is_supervised);
    }

    /// The built-in writers of a participant whose samples have to come one after the other, and how far they have
    /// got.
    pub fn progress(
        &self,
        participant: GuidPrefix,
    ) -> impl Iterator<Item = (Guid, SequenceNumber)> {
        builtin::topics()
            .filter(|(writer, _)| *writer != EntityId::PARTICIPANT_MESSAGE_WRITER)
            .filter_map(move |(writer, reader)| {
                let writer = Guid::new(participant, writer);
                let next = self.endpoints.reader(reader)?.progress(writer)?;
                Some((writer, next))
            })
    }

    /// Prepares for the submessages of a message. Gives those writers that may get further without the knowledge of the
    /// low-level layer.
    pub(super) fn note_progress(
        &mut self,
        receiver: MessageReceiver<'_>,
        is_answered: bool,
    ) -> Vec<Progress> {
        let sender = receiver.header().prefix;
        let mut introduces_itself = false;
        let mut noted: Vec<Progress> = Vec::new();
        for received in receiver.map_while(Result::ok) {
            let Some((reader, writer)) = sent_by(&received) else {
                continue;
            };
            introduces_itself |= writer.entity == EntityId::SPDP_WRITER;
            if let Submessage::Data(data) = &received.submessage {
                if writer.entity == EntityId::PARTICIPANT_MESSAGE_WRITER {
                    self.skip_to(reader, writer, data.sequence);
                }
                continue;
            }
            if noted.iter().all(|progress| progress.writer != writer) {
                let next = self.endpoints.reader(reader);
                let next = next.and_then(|reader| reader.progress(writer));
                noted.push(Progress {
                    reader,
                    writer,
                    next,
                });
            }
            if let (Submessage::Heartbeat(heartbeat), false) = (&received.submessage, is_answered) {
                self.skip_messages(reader, writer, heartbeat);
            }
        }
        if !introduces_itself && self.database.get(sender).is_none() {
            self.disown(sender);
        }
        noted
    }

    /// Tells which of the noted writers have got further, and of what the low-level layer has not answered how far they
    /// all have got.
    pub(super) fn tell_progress(&mut self, noted: Vec<Progress>, is_answered: bool) {
        for Progress {
            reader,
            writer,
            next: before,
        } in noted
        {
            let reader = self.endpoints.reader(reader);
            let now = reader.and_then(|reader| reader.progress(writer));
            if let (true, Some(next)) = (!is_answered || now != before, now) {
                self.events
                    .push_back(DiscoveryEvent::Overtaken { writer, next });
            }
        }
    }

    /// The low-level layer knows a participant that we do not: it has to make itself known again.
    pub(super) fn disown(&mut self, participant: GuidPrefix) {
        if self.config.kernel_discovery {
            self.events.push_back(DiscoveryEvent::Disowned(participant));
        }
    }

    /// Of the messages that a HEARTBEAT announces those that the low-level layer has kept to itself will not come, and
    /// no others are wanted of who is not supervised.
    fn skip_messages(&mut self, reader: EntityId, writer: Guid, heartbeat: &Heartbeat) {
        if writer.entity != EntityId::PARTICIPANT_MESSAGE_WRITER {
            return;
        }
        let participant = self.database.get(writer.prefix);
        let next = match participant.is_some_and(|participant| participant.is_supervised) {
            true => heartbeat.last,
            false => heartbeat.last.next(),
        };
        self.skip_to(reader, writer, next);
    }

    fn skip_to(&mut self, reader: EntityId, writer: Guid, next: SequenceNumber) {
        if let Some(reader) = self.endpoints.reader_mut(reader) {
            reader.skip_to(writer, next);
        }
    }
}

/// The writer of a submessage that comes from a writer of discovery, and our reader for it.
fn sent_by(received: &Received<'_>) -> Option<(EntityId, Guid)> {
    let writer = match &received.submessage {
        Submessage::Data(data) => data.writer,
        Submessage::DataFrag(data) => data.writer,
        Submessage::Gap(gap) => gap.writer,
        Submessage::Heartbeat(heartbeat) => heartbeat.writer,
        _ => return None,
    };
    let reader = match writer {
        EntityId::SPDP_WRITER => EntityId::SPDP_READER,
        _ => builtin::reader_of(writer)?,
    };
    Some((reader, Guid::new(received.source, writer)))
}
