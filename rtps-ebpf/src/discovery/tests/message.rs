//! Messages of a remote participant, in either byte order.

use std::{vec, vec::Vec};

use super::super::exchange::Setting;
use crate::{
    entity::{
        EntityId, GuidPrefix, PARTICIPANT_MESSAGE_READER, PARTICIPANT_MESSAGE_WRITER,
        SEDP_PUBLICATIONS_READER, SEDP_PUBLICATIONS_WRITER, SEDP_SUBSCRIPTIONS_READER,
        SEDP_SUBSCRIPTIONS_WRITER, SPDP_WRITER,
    },
    frame::mapped,
    submessage::id,
};

pub(super) const OWN: GuidPrefix = *b"own-prefix--";
pub(super) const REMOTE: GuidPrefix = *b"remote------";
pub(super) const OTHER: GuidPrefix = *b"other-one---";
pub(super) const SOURCE: [u8; 16] = mapped([10, 0, 0, 9]);
pub(super) const PORT: u32 = 7410;
pub(super) const DOMAIN: u32 = 7;
pub(super) const NOW: u64 = 5_000_000_000;

pub(super) const WRITERS: [EntityId; 3] = [
    SEDP_PUBLICATIONS_WRITER,
    SEDP_SUBSCRIPTIONS_WRITER,
    PARTICIPANT_MESSAGE_WRITER,
];
pub(super) const READERS: [EntityId; 3] = [
    SEDP_PUBLICATIONS_READER,
    SEDP_SUBSCRIPTIONS_READER,
    PARTICIPANT_MESSAGE_READER,
];

pub(super) fn setting() -> Setting {
    Setting {
        now_ns: NOW,
        age_ns: NOW,
        source: SOURCE,
        own: OWN,
        sender: REMOTE,
        domain_id: DOMAIN,
        datagram_size: 1_472,
        end: 0,
        may_answer: true,
        is_local: false,
    }
}

/// Puts bytes together in one byte order.
#[derive(Clone)]
pub(super) struct Body {
    little: bool,
    pub(super) bytes: Vec<u8>,
}

impl Body {
    pub(super) fn raw(mut self, bytes: &[u8]) -> Self {
        self.bytes.extend_from_slice(bytes);
        self
    }

    pub(super) fn u16(self, value: u16) -> Self {
        let bytes = if self.little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        };
        self.raw(&bytes)
    }

    pub(super) fn u32(self, value: u32) -> Self {
        let bytes = if self.little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        };
        self.raw(&bytes)
    }

    pub(super) fn number(self, value: u64) -> Self {
        self.u32((value >> 32) as u32).u32(value as u32)
    }

    /// A set of the numbers in `members`, `bits` wide.
    pub(super) fn set(self, base: u64, bits: u32, members: &[u64]) -> Self {
        let mut words = vec![0_u32; bits.div_ceil(32) as usize];
        for member in members {
            let bit = (member - base) as usize;
            words[bit / 32] |= 1 << (31 - bit % 32);
        }
        let head = self.number(base).u32(bits);
        words.into_iter().fold(head, Self::u32)
    }
}

/// A message in the making.
#[derive(Clone)]
pub(super) struct Message {
    little: bool,
    pub(super) bytes: Vec<u8>,
}

impl Message {
    /// Of [`REMOTE`], without a submessage.
    pub(super) fn new(little: bool) -> Self {
        let mut bytes = b"RTPS\x02\x05\x01\x10".to_vec();
        bytes.extend_from_slice(&REMOTE);
        Self { little, bytes }
    }

    /// The same, directed at us.
    pub(super) fn to_us(little: bool) -> Self {
        Self::new(little).destination(OWN)
    }

    pub(super) fn body(&self) -> Body {
        Body {
            little: self.little,
            bytes: vec![],
        }
    }

    pub(super) fn submessage(mut self, id: u8, flags: u8, body: Body) -> Self {
        let head = self.body().raw(&[id, flags | u8::from(self.little)]);
        self.bytes.extend(head.u16(body.bytes.len() as u16).bytes);
        self.bytes.extend(body.bytes);
        self
    }

    pub(super) fn destination(self, prefix: GuidPrefix) -> Self {
        let body = self.body().raw(&prefix);
        self.submessage(id::INFO_DST, 0, body)
    }

    pub(super) fn source(self, prefix: GuidPrefix) -> Self {
        let body = self.body().u32(0).raw(&[2, 5, 1, 16]).raw(&prefix);
        self.submessage(id::INFO_SRC, 0, body)
    }

    /// Head of a DATA or DATA_FRAG.
    fn data_body(&self, to_inline_qos: u16, writer: EntityId, sequence: u64) -> Body {
        let body = self.body().u16(0).u16(to_inline_qos);
        let body = body.raw(&[0; 4]).raw(&writer);
        body.number(sequence)
    }

    pub(super) fn data(self, number: usize, sequence: u64) -> Self {
        let body = self.data_body(16, WRITERS[number], sequence);
        self.submessage(id::DATA, 4, body.raw(&[0, 3, 0, 0, 1, 0, 0, 0]))
    }

    pub(super) fn data_frag(self, number: usize, sequence: u64) -> Self {
        let body = self.data_body(28, WRITERS[number], sequence);
        let body = body.u32(1).u16(1).u16(8).u32(99).raw(&[0; 8]);
        self.submessage(id::DATA_FRAG, 0, body)
    }

    pub(super) fn heartbeat(self, number: usize, first: u64, last: u64, is_final: bool) -> Self {
        let body = self.body().raw(&READERS[number]).raw(&WRITERS[number]);
        let body = body.number(first).number(last).u32(1);
        self.submessage(id::HEARTBEAT, 2 * u8::from(is_final), body)
    }

    pub(super) fn heartbeat_frag(self, number: usize, sequence: u64) -> Self {
        let body = self.body().raw(&[0; 4]).raw(&WRITERS[number]);
        let body = body.number(sequence).u32(3).u32(1);
        self.submessage(id::HEARTBEAT_FRAG, 0, body)
    }

    pub(super) fn gap(self, number: usize, start: u64, base: u64, members: &[u64]) -> Self {
        let bits = members.last().map_or(0, |last| last - base + 1) as u32;
        let body = self.body().raw(&[0; 4]).raw(&WRITERS[number]);
        let body = body.number(start).set(base, bits, members);
        self.submessage(id::GAP, 0, body)
    }

    pub(super) fn acknack(self, number: usize, base: u64, members: &[u64], is_final: bool) -> Self {
        let bits = members.last().map_or(0, |last| last - base + 1) as u32;
        let body = self.body().raw(&READERS[number]).raw(&WRITERS[number]);
        let body = body.set(base, bits, members).u32(1);
        self.submessage(id::ACKNACK, 2 * u8::from(is_final), body)
    }

    pub(super) fn nack_frag(self, number: usize, sequence: u64) -> Self {
        let body = self.body().raw(&READERS[number]).raw(&WRITERS[number]);
        let body = body.number(sequence).u32(1).u32(1).u32(1 << 31).u32(1);
        self.submessage(id::NACK_FRAG, 0, body)
    }

    /// An announcement with these parameters, which are in the other byte order than the message.
    pub(super) fn announce(self, parameters: &[(u16, Vec<u8>)]) -> Self {
        let list = parameter_list(!self.little, parameters);
        let body = self.data_body(16, SPDP_WRITER, 1).raw(&list);
        self.submessage(id::DATA, 4, body)
    }

    /// The end of the participant, as status info alone.
    pub(super) fn farewell(self) -> Self {
        let body = self.data_body(16, SPDP_WRITER, 2);
        let body = body.u16(0x70).u16(16).raw(&[9; 16]);
        let body = body.u16(0x71).u16(4).raw(&[0, 0, 0, 3]).u16(1).u16(0);
        self.submessage(id::DATA, 2, body)
    }

    /// A DATA of the announcing writer with any payload.
    pub(super) fn announce_raw(self, flags: u8, payload: &[u8]) -> Self {
        let body = self.data_body(16, SPDP_WRITER, 1).raw(payload);
        self.submessage(id::DATA, flags, body)
    }
}

/// Encapsulation, parameters and sentinel.
pub(super) fn parameter_list(little: bool, parameters: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut body = Body {
        little,
        bytes: vec![0, 2 + u8::from(little), 0, 0],
    };
    for (id, value) in parameters {
        body = body.u16(*id).u16(value.len() as u16).raw(value);
    }
    body.u16(1).u16(0).bytes
}

/// PID_PARTICIPANT_GUID.
pub(super) fn guid(prefix: GuidPrefix) -> (u16, Vec<u8>) {
    (0x50, [&prefix[..], &[0, 0, 1, 0xc1]].concat())
}

/// PID_METATRAFFIC_UNICAST_LOCATOR over IPv4.
pub(super) fn locator(little: bool, address: [u8; 4], port: u32) -> (u16, Vec<u8>) {
    let body = Body {
        little,
        bytes: vec![],
    };
    let body = body.u32(1).u32(port).raw(&[0; 12]).raw(&address);
    (0x32, body.bytes)
}

/// What [`REMOTE`] announces; in a message of that byte order its payload has the other.
pub(super) fn announcement(little: bool) -> Vec<(u16, Vec<u8>)> {
    let domain = Body {
        little: !little,
        bytes: vec![],
    };
    vec![
        (0x15, vec![2, 5, 0, 0]),
        guid(REMOTE),
        locator(!little, [10, 0, 1, 9], 9),
        locator(!little, [10, 0, 0, 9], PORT),
        (0x0f, domain.u32(DOMAIN).bytes),
    ]
}
