//! What arrives: datagrams, and the samples that the built-in readers make of them.

use std::net::SocketAddr;
use std::time::Instant;

use super::builtin;
use super::database::Announced;
use super::sedp::{SedpSample, read_sedp};
use super::spdp::{SpdpSample, read_spdp};
use super::{Discovery, DiscoveryEvent, EndpointData, ParticipantData, ParticipantMessageData};
use crate::endpoints::EndpointEvent;
use crate::reader::{Sample, Selection};
use crate::wire::{
    EntityId, Guid, GuidPrefix, Header, MessageReceiver, Received, Submessage, WireError,
};

impl Discovery {
    /// Reads a datagram that came from `source`. Where a part of it is malformed, the parts before it still count.
    pub fn handle_datagram(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
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
        for received in receiver.map_while(Result::ok) {
            // The built-in endpoints refuse the same.
            if self.database.is_foreign(received.source, source.ip()) {
                self.refused.foreign += 1;
            } else {
                self.handle_submessage(now, source, &received);
            }
        }
        let result = self.endpoints.handle_datagram(now, source, datagram);
        self.collect(now);
        result
    }

    fn handle_submessage(&mut self, now: Instant, source: SocketAddr, received: &Received<'_>) {
        let from = received.source;
        let sender = match received.submessage {
            Submessage::Data(data) if data.writer == EntityId::SPDP_WRITER => {
                match read_spdp(from, &data) {
                    Ok(SpdpSample::Alive(data)) => self.handle_announcement(now, source, *data),
                    Ok(SpdpSample::Gone(prefix)) => self.remove_participant(now, prefix),
                    Err(error) => self.refuse_malformed(from, error),
                }
                return;
            }
            Submessage::Data(data) => data.writer,
            Submessage::Heartbeat(heartbeat) => heartbeat.writer,
            Submessage::AckNack(acknack) => acknack.reader,
            _ => return,
        };
        // Who takes part in the reliable protocol and names us has got something from us: it is no mere invention.
        let may_prove = sender.is_builtin() && received.is_directed;
        if may_prove && self.database.prove(now, from) {
            self.events.push_back(DiscoveryEvent::ParticipantFound {
                prefix: from,
                is_new: false,
            });
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

    fn handle_announcement(&mut self, now: Instant, source: SocketAddr, data: ParticipantData) {
        let prefix = data.prefix;
        if !self.concerns_us(&data) {
            return;
        }
        let is_new = match self.database.announce(now, source.ip(), data) {
            Announced::Unchanged => return,
            Announced::NoRoom => {
                self.refused.participants += 1;
                return;
            }
            Announced::Changed => false,
            Announced::New { evicted } => {
                if let Some(evicted) = evicted {
                    self.refused.participants += 1;
                    self.remove_participant(now, evicted);
                }
                true
            }
        };
        let participant = self.database.get(prefix);
        let address = participant.and_then(|participant| participant.metatraffic.first());
        if let (true, Some(address)) = (is_new, address) {
            self.announcer.answer(now, prefix, *address);
        }
        self.match_participant(now, prefix);
        self.events
            .push_back(DiscoveryEvent::ParticipantFound { prefix, is_new });
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
        for (reader, of_topic) in builtin::readers() {
            if of_topic == writer.entity {
                self.endpoints.unmatch(now, reader, writer);
            }
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
