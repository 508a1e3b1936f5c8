//! Which endpoint a received submessage is for (RTPS 2.5 sections 8.3.4 and 8.3.8).
//!
//! By entity id where the submessage names one; a submessage of a writer that names no reader is for every reader
//! that is matched with the writer.

use std::net::SocketAddr;
use std::time::Instant;

use super::Endpoints;
use crate::reader::Reader;
use crate::wire::{EntityId, Guid, MessageReceiver, Received, Submessage, WireError};
use crate::writer::Writer;

impl Endpoints {
    /// Takes in a datagram.
    ///
    /// # Errors
    /// Says what is malformed; what stood before that in the datagram has been processed (RTPS 8.3.4.1).
    pub fn handle_datagram(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        for received in MessageReceiver::new(self.prefix, datagram)? {
            let received = received.inspect_err(
                |error| tracing::debug!(%source, %error, "rest of a message dropped"),
            )?;
            self.dispatch(now, &received);
        }
        Ok(())
    }

    fn dispatch(&mut self, now: Instant, received: &Received<'_>) {
        let guid = |entity| Guid::new(received.source, entity);
        let timestamp = received.timestamp;
        match &received.submessage {
            Submessage::Data(data) => {
                let writer = guid(data.writer);
                self.with_readers(writer, data.reader, |reader| {
                    reader.handle_data(now, writer, timestamp, data);
                });
            }
            Submessage::DataFrag(data) => {
                let writer = guid(data.writer);
                self.with_readers(writer, data.reader, |reader| {
                    reader.handle_data_frag(now, writer, timestamp, data);
                });
            }
            Submessage::Gap(gap) => {
                let writer = guid(gap.writer);
                self.with_readers(writer, gap.reader, |reader| {
                    reader.handle_gap(now, writer, gap);
                });
            }
            Submessage::Heartbeat(heartbeat) => {
                let writer = guid(heartbeat.writer);
                self.with_readers(writer, heartbeat.reader, |reader| {
                    reader.handle_heartbeat(now, writer, heartbeat);
                });
            }
            Submessage::HeartbeatFrag(heartbeat) => {
                let writer = guid(heartbeat.writer);
                self.with_readers(writer, heartbeat.reader, |reader| {
                    reader.handle_heartbeat_frag(now, writer, heartbeat);
                });
            }
            Submessage::AckNack(acknack) => self.with_writer(acknack.writer, |writer| {
                writer.handle_acknack(now, guid(acknack.reader), acknack);
            }),
            Submessage::NackFrag(nack) => self.with_writer(nack.writer, |writer| {
                writer.handle_nack_frag(now, guid(nack.reader), nack);
            }),
            // What the receiver has dealt with, or skips.
            Submessage::InfoDestination(_)
            | Submessage::InfoSource(_)
            | Submessage::InfoTimestamp(_)
            | Submessage::Skipped(_) => {}
        }
    }

    fn with_writer(&mut self, id: EntityId, act: impl FnOnce(&mut Writer)) {
        if let Some(writer) = self.writer_mut(id) {
            act(writer);
        }
    }

    fn with_readers(&mut self, writer: Guid, id: EntityId, mut act: impl FnMut(&mut Reader)) {
        let matched = self.matched.get(&writer).map_or(&[][..], Vec::as_slice);
        let concerned = if id == EntityId::UNKNOWN {
            matched
        } else {
            std::slice::from_ref(&id)
        };
        for id in concerned {
            let Some(scheduled) = self.endpoints.get_mut(id) else {
                continue;
            };
            if let Some(reader) = scheduled.endpoint.as_reader_mut() {
                act(reader);
                self.schedule.touch(*id, &mut scheduled.mark);
            }
        }
    }
}
