//! Repairs that several readers wait for go to all of them in one datagram.
//!
//! It is for no reader in particular, so that those behind the same addresses get it as well. They have it, or take it
//! as gladly; but a reader that a change does not concern must not get it, so that nothing is shared while there are
//! readers that do not want everything (`selection.rs`).

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use super::{Packet, Position, ReaderProxy, Writer};
use crate::Transmit;
use crate::wire::{Guid, Heartbeat, SequenceNumber};

/// Changes, and the readers that wait for each of them.
struct Shared {
    changes: Vec<SequenceNumber>,
    readers: Vec<Guid>,
}

/// Only among so many readers is searched for those that wait for the same.
const MAX_READERS: usize = 32;

impl Writer {
    /// A reader has asked for something that others may ask for as well.
    pub(super) fn look_for_shared(&mut self) {
        self.may_share = self.readers.len() > 1 && !self.selection.is_needed();
    }

    /// The next datagram for several readers, but not for all.
    pub(super) fn poll_shared(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        if !self.may_share {
            return None;
        }
        let transmit = self
            .find_shared(now)
            .and_then(|shared| self.fill_shared(now, &shared, out));
        self.may_share = transmit.is_some();
        transmit
    }

    /// Changes that the same readers wait for, at least two.
    fn find_shared(&self, now: Instant) -> Option<Shared> {
        let proxies = self.readers.values();
        let waiting: Vec<_> = proxies
            .filter_map(|proxy| Some((proxy.guid(), proxy.outbox.sharable(now)?)))
            .take(MAX_READERS)
            .collect();
        let concerns_all_from = self.readers.values().map(ReaderProxy::start).max()?;
        let wanting = |sequence: SequenceNumber| {
            let wanting = waiting.iter().filter(|(_, asks)| asks.wants(sequence));
            wanting.map(|(reader, _)| *reader).collect::<Vec<_>>()
        };
        for (index, (_, request)) in waiting.iter().enumerate() {
            let others = &waiting[index + 1..];
            let mut changes = request.unsent().filter(|sequence| {
                *sequence >= concerns_all_from
                    && others.iter().any(|(_, asks)| asks.wants(*sequence))
                    && self.fits_datagram(*sequence)
            });
            if let Some(first) = changes.next() {
                let readers = wanting(first);
                let alike = changes.filter(|sequence| wanting(*sequence) == readers);
                let changes = std::iter::once(first).chain(alike).collect();
                return Some(Shared { changes, readers });
            }
        }
        None
    }

    /// Whether a change is there and not to be sent in fragments.
    fn fits_datagram(&self, sequence: SequenceNumber) -> bool {
        let change = self.history.get(sequence);
        change.is_some_and(|change| !self.layout.is_fragmented(change.payload.len()))
    }

    fn fill_shared(
        &mut self,
        now: Instant,
        shared: &Shared,
        out: &mut Vec<u8>,
    ) -> Option<Transmit> {
        let layout = self.layout.clone();
        let mut packet = Packet::undirected(out, &layout);
        for sequence in &shared.changes {
            let before = packet.len();
            let change = self.history.get(*sequence)?;
            if !packet.change(&mut Position::start_of(*sequence), change) {
                break;
            }
            let bytes = packet.len() - before;
            for reader in &shared.readers {
                if let Some(proxy) = self.readers.get_mut(reader) {
                    proxy.outbox.share(*sequence, bytes);
                }
            }
        }
        self.ask_again(now, &mut packet);
        let destinations = self.addresses_of(&shared.readers);
        packet.finish().then_some(Transmit {
            destinations,
            dscp: self.dscp,
        })
    }

    /// The readers can say at once what got lost again.
    fn ask_again(&mut self, now: Instant, packet: &mut Packet<'_>) {
        if packet.has_room_for_heartbeat() {
            packet.heartbeat(Heartbeat {
                count: self.heartbeats.next_count(now),
                ..self.heartbeat(SequenceNumber(1))
            });
        } else {
            self.heartbeats.hurry();
        }
    }

    /// Each once.
    pub(super) fn addresses_of(&self, readers: &[Guid]) -> Arc<[SocketAddr]> {
        let proxies = readers.iter().filter_map(|reader| self.readers.get(reader));
        let addresses = proxies.flat_map(ReaderProxy::addresses);
        let addresses: BTreeSet<SocketAddr> = addresses.collect();
        addresses.into_iter().collect()
    }
}
