//! Which endpoint a received submessage is for (RTPS 2.5 sections 8.3.4 and 8.3.8).
//!
//! By entity id where the submessage names one; a submessage of a writer that names no reader is for every reader
//! that is matched with the writer.

use std::net::{IpAddr, SocketAddr};
use std::time::Instant;

use rtps_ebpf::entity::is_type_lookup_writer;

use super::Endpoints;
use super::matched::Local;
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
        let mut receiver = MessageReceiver::new(self.prefix, datagram)?;
        // By reference, because a submessage is large.
        while let Some(received) = &receiver.next() {
            match received {
                Ok(received) => self.dispatch(now, source.ip(), received),
                Err(error) => {
                    tracing::debug!(%source, %error, "rest of a message dropped");
                    return Err(*error);
                }
            }
        }
        Ok(())
    }

    /// Takes in a datagram that another has answered already in our name: samples count, and acknowledgements, but
    /// nothing is asked for or repeated.
    ///
    /// # Errors
    /// As those of [`handle_datagram`](Self::handle_datagram).
    pub fn handle_answered(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        for received in MessageReceiver::new(self.prefix, datagram)? {
            let received = received?;
            match &received.submessage {
                Submessage::AckNack(acknack) if is_answered(acknack.writer) => {
                    let reader = Guid::new(received.source, acknack.reader);
                    self.with_writer(source.ip(), reader, acknack.writer, |writer| {
                        writer.acknowledge(now, reader, acknack.state.base);
                    });
                }
                Submessage::Heartbeat(heartbeat) if is_answered(heartbeat.writer) => {}
                _ => self.dispatch(now, source.ip(), &received),
            }
        }
        Ok(())
    }

    fn dispatch(&mut self, now: Instant, source: IpAddr, received: &Received<'_>) {
        let guid = |entity| Guid::new(received.source, entity);
        let timestamp = received.timestamp;
        match &received.submessage {
            Submessage::Data(data) => {
                let writer = guid(data.writer);
                self.with_readers(source, writer, data.reader, |reader| {
                    reader.handle_data(now, writer, timestamp, data);
                });
            }
            Submessage::DataFrag(data) => {
                let writer = guid(data.writer);
                self.with_readers(source, writer, data.reader, |reader| {
                    reader.handle_data_frag(now, writer, timestamp, data);
                });
            }
            Submessage::Gap(gap) => {
                let writer = guid(gap.writer);
                self.with_readers(source, writer, gap.reader, |reader| {
                    reader.handle_gap(now, writer, gap);
                });
            }
            Submessage::Heartbeat(heartbeat) => {
                let writer = guid(heartbeat.writer);
                self.with_readers(source, writer, heartbeat.reader, |reader| {
                    reader.handle_heartbeat(now, writer, heartbeat);
                });
            }
            Submessage::HeartbeatFrag(heartbeat) => {
                let writer = guid(heartbeat.writer);
                self.with_readers(source, writer, heartbeat.reader, |reader| {
                    reader.handle_heartbeat_frag(now, writer, heartbeat);
                });
            }
            Submessage::AckNack(acknack) => {
                let reader = guid(acknack.reader);
                self.with_writer(source, reader, acknack.writer, |writer| {
                    writer.handle_acknack(now, reader, acknack);
                });
            }
            Submessage::NackFrag(nack) => {
                let reader = guid(nack.reader);
                self.with_writer(source, reader, nack.writer, |writer| {
                    writer.handle_nack_frag(now, reader, nack);
                });
            }
            // What the receiver has dealt with, or skips.
            Submessage::InfoDestination(_)
            | Submessage::InfoSource(_)
            | Submessage::InfoTimestamp(_)
            | Submessage::Skipped(_) => {}
        }
    }

    fn with_writer(
        &mut self,
        source: IpAddr,
        reader: Guid,
        id: EntityId,
        act: impl FnOnce(&mut Writer),
    ) {
        let Some(matched) = self.matched.get_mut(reader) else {
            return;
        };
        if !matched.accepts(source) {
            self.foreign += 1;
            return;
        }
        if let Some(writer) = self.writer_mut(id) {
            act(writer);
        }
    }

    #[inline]
    fn with_readers(
        &mut self,
        source: IpAddr,
        writer: Guid,
        id: EntityId,
        mut act: impl FnMut(&mut Reader),
    ) {
        let Some(matched) = self.matched.get_mut(writer) else {
            return;
        };
        if !matched.accepts(source) {
            self.foreign += 1;
            return;
        }
        let named;
        let concerned = if id == EntityId::UNKNOWN {
            matched.locals()
        } else {
            named = self.endpoints.find(id).map(|place| Local { id, place });
            named.as_slice()
        };
        for &Local { place, .. } in concerned {
            let Some(scheduled) = self.endpoints.at_mut(place) else {
                continue;
            };
            if let Some(reader) = scheduled.endpoint.as_reader_mut() {
                act(reader);
                self.schedule.touch(place, &mut scheduled.mark);
            }
        }
    }
}

/// Whether it is a writer of those built-in topics for which the low-level layer answers.
fn is_answered(writer: EntityId) -> bool {
    !is_type_lookup_writer(writer.0)
}
