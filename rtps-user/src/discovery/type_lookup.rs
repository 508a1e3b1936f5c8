//! The TypeLookup service (XTypes 7.6.3.3.4): requests for TypeObjects and replies to them, on their way from and to
//! the built-in endpoints. What is known and what is wanted is decided by who uses discovery.

use std::collections::{BTreeSet, VecDeque};
use std::time::Instant;

use super::{Discovery, DiscoveryEvent, sedp};
use crate::history::{ChangeKind, NewChange};
use crate::reader::Sample;
use crate::wire::{EntityId, KeyHash, WireError};
use crate::xtypes::lookup::{Answer, Operation, Reply, Request};
use crate::xtypes::{TypeHash, TypeIdentifier};

/// Types that were asked for are remembered up to so many.
const MAX_ASKED: usize = 4096;
/// Types that one request names.
const MAX_TYPES: usize = 64;
/// Replies that wait to be sent; further requests go without.
const MAX_REPLIES: usize = 64;

/// What is to be sent.
#[derive(Debug, Default)]
pub(super) struct TypeLookup {
    wanted: BTreeSet<TypeHash>,
    asked: BTreeSet<TypeHash>,
    replies: VecDeque<Reply>,
}

impl Discovery {
    /// Asks all participants for these TypeObjects, unless that was done before.
    pub fn ask_for_types(&mut self, types: impl IntoIterator<Item = TypeHash>) {
        let TypeLookup { wanted, asked, .. } = &mut self.type_lookup;
        for hash in types {
            if asked.len() >= MAX_ASKED {
                asked.clear();
            }
            if asked.insert(hash) {
                wanted.insert(hash);
            }
        }
    }

    /// Answers a request.
    pub fn reply_to_lookup(&mut self, reply: Reply) {
        if self.type_lookup.replies.len() < MAX_REPLIES {
            self.type_lookup.replies.push_back(reply);
        }
    }

    /// Writes what waits.
    pub(super) fn flush_type_lookup(&mut self, now: Instant) {
        while let Some(reply) = self.type_lookup.replies.pop_front() {
            self.write_lookup(now, EntityId::TYPE_LOOKUP_REPLY_WRITER, reply.encode());
        }
        while !self.type_lookup.wanted.is_empty() {
            self.write_request(now);
        }
    }

    fn write_request(&mut self, now: Instant) {
        let mut types = Vec::new();
        while let Some(hash) = self.type_lookup.wanted.pop_first() {
            types.push(TypeIdentifier::Hash(hash));
            if types.len() == MAX_TYPES {
                break;
            }
        }
        let id = EntityId::TYPE_LOOKUP_REQUEST_WRITER;
        let Some(writer) = self.endpoints.writer(id) else {
            return;
        };
        let request = Request {
            id: (writer.guid(), writer.last_sequence().next()),
            instance: "dds.builtin.TOS".to_owned(),
            operation: Operation::Types,
            types,
        };
        self.write_lookup(now, id, request.encode());
    }

    fn write_lookup(&mut self, now: Instant, writer: EntityId, payload: Vec<u8>) {
        let change = NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash([0; 16]),
            payload: payload.into(),
            timestamp: self.timestamp(now),
        };
        sedp::write(&mut self.endpoints, now, writer, change);
    }

    /// Reads a request or a reply. Requests count only of participants that have proven to be where they say, because
    /// the answer may be far larger.
    pub(super) fn handle_lookup(
        &mut self,
        reader: EntityId,
        sample: &Sample,
    ) -> Result<(), WireError> {
        if !sample.info.valid_data {
            return Ok(());
        }
        if reader == EntityId::TYPE_LOOKUP_REQUEST_READER {
            let participant = self.database.get(sample.info.writer.prefix);
            if participant.is_some_and(|participant| participant.is_proven()) {
                let request = Request::decode(&sample.payload)?;
                self.events
                    .push_back(DiscoveryEvent::TypesRequested(Box::new(request)));
            }
            return Ok(());
        }
        let reply = Reply::decode(&sample.payload)?;
        if let Answer::Types { objects, .. } = reply.answer {
            let asked = &self.type_lookup.asked;
            let wanted = objects.into_iter().filter(|(hash, _)| asked.contains(hash));
            self.events
                .push_back(DiscoveryEvent::TypesFound(wanted.collect()));
        }
        Ok(())
    }
}
