//! A host with its samples, and the loops that drive the exchange.

use std::{boxed::Box, collections::BTreeMap, vec::Vec};

use super::{
    super::{Exchange, FILL_TURNS, MAX_DATAGRAMS, Outcome, Setting, TURNS, World},
    message::{Message, OWN, PORT, SOURCE, setting},
    speech::{Said, listen},
};
use crate::{
    abi::{
        Announcement, BuiltinWriter, PEER_PROVEN, Peer, RemoteReader, RemoteWriter,
        SUBMESSAGE_BYTES, Sample,
    },
    entity::Guid,
    walk::{MAX_STEPS, Routes, Step, Walk},
};

/// What a host has to say.
pub(super) struct Host {
    pub(super) writers: [BuiltinWriter; 3],
    pub(super) samples: BTreeMap<(u32, u64), Sample>,
    pub(super) announcement: Announcement,
}

/// What came of a message.
pub(super) struct Played {
    pub(super) outcome: Outcome,
    pub(super) peer: Peer,
    pub(super) datagrams: Vec<Vec<u8>>,
}

impl World for Host {
    fn writer(&self, writer: u32) -> Option<&BuiltinWriter> {
        self.writers.get(writer as usize)
    }

    fn sample(&self, writer: u32, sequence: u64) -> Option<&Sample> {
        self.samples.get(&(writer, sequence))
    }

    fn announcement(&self) -> Option<&Announcement> {
        Some(&self.announcement)
    }
}

struct Anywhere;

impl Routes for Anywhere {
    fn add_readers(&self, _: &Guid, _: &mut crate::SlotSet) {}
}

/// A submessage of the length that it claims to have.
fn submessage(id: u8, content: &[u8], len: usize) -> ([u8; SUBMESSAGE_BYTES], u32) {
    let mut bytes = [0; SUBMESSAGE_BYTES];
    bytes[..4].copy_from_slice(&[id, 1, 0, 0]);
    bytes[2..4].copy_from_slice(&(len as u16 - 4).to_le_bytes());
    bytes[4..4 + content.len()].copy_from_slice(content);
    (bytes, len as u32)
}

impl Host {
    /// Has announced itself, and no sample yet.
    pub(super) fn new() -> Self {
        let (bytes, len) = submessage(0x80, b"announcement", 200);
        let none = BuiltinWriter {
            first: 1,
            ..BuiltinWriter::default()
        };
        Self {
            writers: [none; 3],
            samples: BTreeMap::new(),
            announcement: Announcement {
                bytes,
                len,
                reserved: 0,
            },
        }
    }

    /// With these samples of a writer, each of `len` bytes.
    pub(super) fn with(
        mut self,
        writer: u32,
        numbers: impl IntoIterator<Item = u64>,
        len: usize,
    ) -> Self {
        for number in numbers {
            let mut content = Vec::from(&[0, 0, 16, 0][..]);
            content.extend([0; 8]);
            content.extend(((number >> 32) as u32).to_le_bytes());
            content.extend((number as u32).to_le_bytes());
            content.push(writer as u8);
            let (bytes, len) = submessage(0x15, &content, len);
            let timestamp = (number / 10).to_le_bytes();
            let sample = Sample {
                bytes,
                len,
                reserved: 0,
                timestamp,
            };
            self.samples.insert((writer, number), sample);
            let of = &mut self.writers[writer as usize];
            of.last = of.last.max(number);
        }
        let first = self.samples.range((writer, 0)..).next();
        let of = &mut self.writers[writer as usize];
        of.first = first.map_or(of.last + 1, |((_, number), _)| *number);
        self
    }

    /// The exchange over a message.
    pub(super) fn play(&self, setting: Setting, known: Option<&Peer>, message: &Message) -> Played {
        self.play_bytes(setting, known, &message.bytes)
    }

    pub(super) fn play_bytes(
        &self,
        setting: Setting,
        known: Option<&Peer>,
        message: &[u8],
    ) -> Played {
        let mut walk = Walk::new(OWN);
        (0..MAX_STEPS).find(|_| walk.step(message, &Anywhere) != Step::Continue);
        let setting = Setting {
            end: walk.end(),
            ..setting
        };
        let mut exchange = Box::new(Exchange::new());
        exchange.begin(&setting, known);
        (0..TURNS).find(|_| exchange.step(message, self).is_break());
        let outcome = exchange.outcome();
        let mut datagrams = Vec::new();
        for _ in 0..MAX_DATAGRAMS {
            if !outcome.speaks {
                break;
            }
            exchange.open();
            (0..FILL_TURNS).find(|_| exchange.fill(self).is_break());
            if exchange.has_datagram() {
                let answer = &exchange.answer;
                datagrams.push(answer.bytes[..answer.len as usize].to_vec());
            }
            if !exchange.has_more() {
                break;
            }
        }
        Played {
            outcome,
            peer: exchange.peer,
            datagrams,
        }
    }

    /// The same, of a known participant, with what was said.
    pub(super) fn hear(&self, known: &Peer, message: &Message) -> (Played, Vec<Said>) {
        let played = self.play(setting(), Some(known), message);
        let said = played.datagrams.iter().flat_map(|bytes| listen(bytes));
        let said = said.collect();
        (played, said)
    }
}

/// A participant that takes part in the reliable protocol.
pub(super) fn peer() -> Peer {
    let mut peer = stranger();
    peer.flags = PEER_PROVEN;
    peer
}

/// One that has only announced itself.
pub(super) fn stranger() -> Peer {
    let mut peer = Peer {
        announcement_hash: 1,
        reply_port: PORT,
        writers: [RemoteWriter {
            next: 1,
            ..RemoteWriter::default()
        }; 3],
        readers: [RemoteReader::default(); 3],
        ..Peer::default()
    };
    peer.addresses[0] = SOURCE;
    peer
}

/// Nothing for rtpsd, nothing to say.
pub(super) const QUIET: Outcome = Outcome {
    unknown: false,
    new: false,
    news: false,
    answered: true,
    speaks: false,
};
/// For rtpsd, which need not answer.
pub(super) const NEWS: Outcome = Outcome {
    news: true,
    ..QUIET
};
/// For rtpsd to answer.
pub(super) const PASSED_ON: Outcome = Outcome {
    answered: false,
    ..NEWS
};
/// Answered, and that is all.
pub(super) const ANSWERED: Outcome = Outcome {
    speaks: true,
    ..QUIET
};
/// Nobody knows who that is.
pub(super) const UNKNOWN: Outcome = Outcome {
    unknown: true,
    ..QUIET
};
