//! Going on where an earlier incarnation stopped, so that remote participants notice nothing.
//!
//! Call these before anything else, our own samples first and in the order of their numbers.

use std::net::IpAddr;
use std::time::Instant;

use super::remote_participant::Standing;
use super::{Discovery, EndpointData, ParticipantData, builtin, sedp};
use crate::wire::{EntityId, Guid, SequenceNumber};

impl Discovery {
    /// What was announced of our participant.
    pub fn restore_announcement(&mut self, sequence: SequenceNumber, payload: &[u8]) {
        self.announcer.resume(sequence, payload);
    }

    /// What is announced of our participant: the number and the bytes of the sample.
    pub fn announcement(&self) -> (SequenceNumber, &[u8]) {
        self.announcer.announced()
    }

    /// An endpoint of ours was announced with this number.
    pub fn restore_endpoint_of_ours(
        &mut self,
        now: Instant,
        sequence: SequenceNumber,
        endpoint: &EndpointData,
    ) {
        self.restore_sequence(sedp::announcer_of(endpoint.guid.entity), sequence);
        self.announce(now, endpoint);
    }

    /// An endpoint of ours was withdrawn with this number, and not everybody may know.
    pub fn restore_withdrawal(&mut self, now: Instant, sequence: SequenceNumber, entity: EntityId) {
        self.restore_sequence(sedp::announcer_of(entity), sequence);
        let timestamp = self.timestamp(now);
        let guid = Guid::new(self.prefix(), entity);
        self.withdrawals
            .withdraw(&mut self.endpoints, now, timestamp, guid);
    }

    /// The number that a built-in writer of ours gives its next sample.
    pub fn restore_sequence(&mut self, writer: EntityId, next: SequenceNumber) {
        if let Some(writer) = self.endpoints.writer_mut(writer)
            && writer.last_sequence() < next
        {
            writer.resume_from(next, 0);
        }
    }

    /// What announces our participant, for one who does it in our name: INFO_TS and DATA.
    pub fn announcement_submessages(&self) -> Vec<u8> {
        self.announcer.submessages()
    }

    /// A remote participant was known, by announcements from `source`.
    pub fn restore_participant(
        &mut self,
        now: Instant,
        source: IpAddr,
        proven: bool,
        data: ParticipantData,
    ) {
        let prefix = data.prefix;
        let standing = if proven {
            Standing::Proven
        } else {
            Standing::Unproven
        };
        self.database.insert(now, source, data, standing);
        self.match_participant(now, prefix);
    }

    /// An endpoint of a restored participant was known.
    pub fn restore_endpoint(&mut self, endpoint: EndpointData) -> bool {
        self.database.insert_endpoint(endpoint)
    }

    /// Everything below `next` was received of a built-in writer of a restored participant.
    pub fn restore_progress(&mut self, writer: Guid, next: SequenceNumber) {
        if let Some(reader) = builtin::reader_of(writer.entity)
            && let Some(reader) = self.endpoints.reader_mut(reader)
            && reader.is_matched(writer)
        {
            reader.resume_from(writer, next, 0);
        }
    }
}
