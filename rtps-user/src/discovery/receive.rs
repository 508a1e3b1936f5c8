//! What arrives: datagrams, and the samples that the built-in readers make of them.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use super::builtin;
use super::database::{Announced, Proof};
use super::remote_participant::Standing;
use super::sedp::{SedpSample, read_sedp};
use super::spdp::{SpdpSample, read_spdp};
use super::{Discovery, DiscoveryEvent, EndpointData, ParticipantData, ParticipantMessageData};
use crate::endpoints::EndpointEvent;
use crate::reader::{Sample, Selection};
use crate::wire::{
    EntityId, Guid, GuidPrefix, Header, MessageReceiver, Received, Submessage, WireError,
};

/// When writers are greeted whose participant the low-level layer has greeted, if they have still not been heard.
const GREETED: Duration = Duration::from_secs(1);

impl Discovery {
    /// Reads a datagram that came from `source`. Where a part of it is malformed, the parts before it still count.
    pub fn handle_datagram(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        self.handle(now, source, datagram, false)
    }

    /// Reads a message that the low-level layer has handed over and answered.
    pub fn handle_answered(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        self.handle(now, source, datagram, true)
    }

    fn handle(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
        is_answered: bool,
    ) -> Result<(), WireError> {
        let receiver = MessageReceiver::new(self.prefix(), datagram)?;
        let Header { prefix, .. } = *receiver.header();
        // The group gives back to us what we send to it.
        if prefix == self.prefix() {
            return Ok(());
        }
        if !self.database.is_foreign(prefix, source.ip()) {
            self.database.renew(now, prefix);
        }
        for received in receiver.clone().map_while(Result::ok) {
            // The built-in endpoints refuse the same.
            if self.database.is_foreign(received.source, source.ip()) {
                self.refused.foreign += 1;
            } else {
                self.handle_submessage(now, source, &received, is_answered);
            }
        }
        if !self.config.kernel_discovery {
            let result = self.endpoints.handle_datagram(now, source, datagram);
            self.collect(now);
            return result;
        }
        let before = self.note_progress(receiver, is_answered);
        let result = if is_answered {
            self.endpoints.handle_answered(now, source, datagram)
        } else {
            self.endpoints.handle_datagram(now, source, datagram)
        };
        self.collect(now);
        self.tell_progress(before, is_answered);
        result
    }

    fn handle_submessage(
        &mut self,
        now: Instant,
        source: SocketAddr,
        received: &Received<'_>,
        is_answered: bool,
    ) {
        let from = received.source;
        if let Submessage::Data(data) = &received.submessage
            && data.writer == EntityId::SPDP_WRITER
        {
            match read_spdp(from, data) {
                Ok(SpdpSample::Alive(data)) => {
                    self.handle_announcement(now, source, *data, is_answered);
                }
                Ok(SpdpSample::Gone(prefix)) => self.remove_participant(now, prefix),
                Err(error) => self.refuse_malformed(from, error),
            }
            return;
        }
        // Who takes part in the reliable protocol and names us has got something from us: it is no mere invention. So
        // has who acknowledges. Some small stacks do that without INFO_DST.
        let is_builtin = received
            .submessage
            .sender()
            .is_some_and(EntityId::is_builtin);
        let is_answer =
            received.is_directed || matches!(received.submessage, Submessage::AckNack(_));
        if is_builtin && is_answer {
            self.prove(now, from);
        }
    }

    fn prove(&mut self, now: Instant, prefix: GuidPrefix) {
        let before = match self.database.prove(now, prefix) {
            Proof::Old => return,
            Proof::NoRoom => {
                self.refused.participants += 1;
                return;
            }
            Proof::New { before, evicted } => {
                if let Some(evicted) = evicted {
                    self.evict(now, evicted);
                }
                before
            }
        };
        let is_new = before == Standing::Pending;
        self.events
            .push_back(DiscoveryEvent::ParticipantFound { prefix, is_new });
        if is_new {
            self.match_participant(now, prefix);
            // The low-level layer has greeted them.
            for (writer, reader) in builtin::topics() {
                if let Some(of_ours) = self.endpoints.writer_mut(writer) {
                    of_ours.greeting(now, Guid::new(prefix, reader));
                }
                if let Some(of_ours) = self.endpoints.reader_mut(reader) {
                    of_ours.greet_at(now + GREETED, Guid::new(prefix, writer));
                }
            }
        }
    }

    /// Whether a participant is one of our domain, and another than we.
    fn concerns_us(&self, data: &ParticipantData) -> bool {
        let ours = &self.config.participant;
        let is_domain_ours = match (data.domain, ours.domain) {
            (Some(theirs), Some(ours)) => theirs == ours,
            _ => true,
        };
        is_domain_ours
            && data.domain_tag == ours.domain_tag
            && data.prefix != GuidPrefix::UNKNOWN
            && data.prefix != ours.prefix
    }

    fn handle_announcement(
        &mut self,
        now: Instant,
        source: SocketAddr,
        data: ParticipantData,
        is_answered: bool,
    ) {
        let prefix = data.prefix;
        if !self.concerns_us(&data) {
            return;
        }
        let is_new = match self.database.announce(now, source.ip(), data, is_answered) {
            Announced::Unchanged => return,
            Announced::NoRoom => {
                self.refused.participants += 1;
                self.disown(prefix);
                return;
            }
            Announced::Changed => false,
            Announced::New { evicted } => {
                if let Some(evicted) = evicted {
                    self.evict(now, evicted);
                }
                true
            }
        };
        let Some(participant) = self.database.get(prefix).filter(|p| !p.is_pending()) else {
            return;
        };
        if let (true, Some(address)) = (is_new, participant.metatraffic.first()) {
            self.announcer.answer(now, prefix, *address);
        }
        self.match_participant(now, prefix);
        self.events
            .push_back(DiscoveryEvent::ParticipantFound { prefix, is_new });
    }

    /// Forgets a participant that another has to have room for.
    fn evict(&mut self, now: Instant, prefix: GuidPrefix) {
        self.refused.participants += 1;
        self.remove_participant(now, prefix);
    }

    /// Takes what the built-in endpoints have.
    pub(super) fn collect(&mut self, now: Instant) {
        while let Some(event) = self.endpoints.poll_event() {
            match event {
                EndpointEvent::DataAvailable(reader) => self.take_samples(now, reader),
                EndpointEvent::Acknowledged(announcer) => self.clean_up(announcer),
                _ => {}
            }
        }
    }

    fn take_samples(&mut self, now: Instant, reader: EntityId) {
        let Some(samples) = self
            .endpoints
            .reader_mut(reader)
            .map(|reader| reader.take(usize::MAX, &Selection::default()))
        else {
            return;
        };
        if builtin::is_type_lookup(reader) {
            for sample in &samples {
                if let Err(error) = self.handle_lookup(reader, sample) {
                    self.refuse_malformed(sample.info.writer.prefix, error);
                }
            }
            return;
        }
        let mut writers: Vec<_> = samples.iter().map(|sample| sample.info.writer).collect();
        writers.sort();
        writers.dedup();
        for sample in &samples {
            let result = if reader == EntityId::PARTICIPANT_MESSAGE_READER {
                self.handle_assertion(sample)
            } else {
                self.handle_endpoint_sample(now, sample)
            };
            if let Err(error) = result {
                self.refuse_malformed(sample.info.writer.prefix, error);
            }
        }
        for writer in writers {
            let progress = self
                .endpoints
                .reader(reader)
                .and_then(|reader| reader.progress(writer));
            if let Some(next) = progress {
                self.events
                    .push_back(DiscoveryEvent::Progress { writer, next });
            }
        }
    }

    fn handle_endpoint_sample(&mut self, now: Instant, sample: &Sample) -> Result<(), WireError> {
        match read_sedp(sample)? {
            SedpSample::Alive(data) => self.handle_endpoint(now, sample.info.writer, *data),
            SedpSample::Gone(guid) => {
                if self.database.remove_endpoint(guid) {
                    self.events.push_back(DiscoveryEvent::EndpointLost(guid));
                }
            }
        }
        Ok(())
    }

    fn handle_endpoint(&mut self, now: Instant, writer: Guid, data: EndpointData) {
        let guid = data.guid;
        if self.database.insert_endpoint(data) {
            self.events.push_back(DiscoveryEvent::EndpointFound(guid));
            return;
        }
        self.refused.endpoints += 1;
        // Or else its samples would fill the reader's table of instances.
        if let Some(reader) = builtin::reader_of(writer.entity) {
            self.endpoints.unmatch(now, reader, writer);
        }
    }

    fn handle_assertion(&mut self, sample: &Sample) -> Result<(), WireError> {
        if !sample.info.valid_data {
            return Ok(());
        }
        let Some(message) = ParticipantMessageData::decode(&sample.payload)? else {
            return Ok(());
        };
        if message.participant != sample.info.writer.prefix {
            return Err(WireError::InvalidData);
        }
        self.events.push_back(DiscoveryEvent::Liveliness {
            participant: message.participant,
            manual: message.manual,
        });
        Ok(())
    }

    fn refuse_malformed(&mut self, prefix: GuidPrefix, error: WireError) {
        self.refused.malformed += 1;
        tracing::debug!(%prefix, %error, "a discovery sample was refused");
    }
}
