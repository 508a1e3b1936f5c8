//! What a remote participant announces (RTPS 2.5, 8.5.3): whether it is new, changed, or gone, and where it can
//! be answered.
//!
//! First all that is announced is hashed; only what differs from before is read. The hash does not depend on the
//! order of the parameters: a host on several networks may name its locators in another order on each.

use core::ops::ControlFlow;

use super::{answer::PROLOGUE_LEN, exchange::Exchange, world::World};
use crate::{
    abi::{PEER_ANY_ADDRESS, PEER_PROVEN, Peer, RemoteReader, RemoteWriter},
    bytes::Bytes,
    frame::mapped,
    submessage::{Submessage, flag, part},
};

/// Longer announcements are not hashed, and so are always news.
const MAX_HASHED: u32 = 4_096;
/// More parameters are left to rtpsd.
const MAX_PARAMETERS: u32 = 128;
/// Bytes that are hashed in one step.
const STRIDE: u32 = 32;
const HASH_SEED: u64 = 0xcbf2_9ce4_8422_2325;
const HASH_FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

const PID_SENTINEL: u16 = 0x0001;
const PID_DOMAIN_ID: u16 = 0x000f;
const PID_DEFAULT_UNICAST_LOCATOR: u16 = 0x0031;
const PID_METATRAFFIC_UNICAST_LOCATOR: u16 = 0x0032;
const PID_PARTICIPANT_GUID: u16 = 0x0050;
const PID_STATUS_INFO: u16 = 0x0071;
const PID_DOMAIN_TAG: u16 = 0x4014;

const LOCATOR_KIND_UDP_V4: u32 = 1;
const LOCATOR_KIND_UDP_V6: u32 = 2;
/// NOT_ALIVE_DISPOSED and NOT_ALIVE_UNREGISTERED in the last byte of StatusInfo_t (9.6.4.9).
const NOT_ALIVE: u8 = 0x03;

/// How far the reading has got.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Hash,
    InlineQos,
    Encapsulation,
    Parameters,
}

/// The reading of one announcement.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    /// Of the parameter that is being hashed; in the end of all.
    hash: u64,
    /// The hashes of what lies before it.
    sum: u64,
    stage: Stage,
    /// Of inline QoS or payload.
    start: u32,
    /// Of what comes next.
    at: u32,
    end: u32,
    /// Of the parameter that is being hashed.
    parameter_end: u32,
    /// Parameters so far.
    parameters: u32,
    /// Its metatraffic port at the source of the datagram; 0 for none.
    port: u32,
    /// Addresses that it announces beside its source.
    addresses: u32,
    /// Of the submessage.
    flags: u8,
    is_little_endian: bool,
    is_gone: bool,
    /// It says whose announcement it is, and may.
    is_own: bool,
    /// It belongs to another domain.
    is_elsewhere: bool,
}

/// A parameter's head.
#[derive(Clone, Copy)]
struct Parameter {
    id: u16,
    value: u32,
    len: u32,
}

impl Reading {
    pub(super) const NONE: Self = Self {
        hash: 0,
        sum: 0,
        stage: Stage::Hash,
        start: 0,
        at: 0,
        end: 0,
        parameter_end: 0,
        parameters: 0,
        port: 0,
        addresses: 0,
        flags: 0,
        is_little_endian: false,
        is_gone: false,
        is_own: false,
        is_elsewhere: false,
    };

    /// Of a DATA that was found valid.
    #[inline(always)]
    pub(super) fn begin(submessage: &Submessage, octets_to_inline_qos: [u8; 2]) -> Self {
        let start = submessage.start + 4 + u32::from(submessage.u16(octets_to_inline_qos));
        let flags = submessage.flags & (flag::INLINE_QOS | flag::DATA | flag::KEY);
        Self {
            hash: HASH_SEED ^ u64::from(flags),
            start,
            at: start,
            end: submessage.end(),
            parameter_end: start,
            flags: submessage.flags,
            is_little_endian: submessage.has(flag::LITTLE_ENDIAN),
            ..Self::NONE
        }
    }

    /// Takes in some bytes; breaks at the end.
    #[inline(always)]
    fn hash(&mut self, message: &(impl Bytes + ?Sized)) -> ControlFlow<()> {
        if self.at >= self.end {
            self.hash = self.hash.wrapping_add(self.sum);
            return ControlFlow::Break(());
        }
        if self.at >= self.parameter_end {
            self.next_hash(message);
        }
        let left = self.parameter_end.saturating_sub(self.at);
        let taken = if left >= STRIDE {
            message.load::<{ STRIDE as usize }>(self.at).map(|bytes| {
                self.mix(u64::from_le_bytes(part(&bytes, 0)));
                self.mix(u64::from_le_bytes(part(&bytes, 8)));
                self.mix(u64::from_le_bytes(part(&bytes, 16)));
                self.mix(u64::from_le_bytes(part(&bytes, 24)));
                STRIDE
            })
        } else if left >= 8 {
            message.load::<8>(self.at).map(|bytes| {
                self.mix(u64::from_le_bytes(bytes));
                8
            })
        } else if left >= 4 {
            message.load::<4>(self.at).map(|bytes| {
                self.mix(u64::from(u32::from_le_bytes(bytes)));
                4
            })
        } else {
            message.load::<1>(self.at).map(|[byte]| {
                self.mix(u64::from(byte));
                1
            })
        };
        let Some(taken) = taken else {
            return ControlFlow::Break(());
        };
        self.at += taken;
        ControlFlow::Continue(())
    }

    /// Begins with the encapsulation header, or with the next parameter. Inline QoS, and what is no parameter, are
    /// hashed as one with all that follows.
    #[inline(always)]
    fn next_hash(&mut self, message: &(impl Bytes + ?Sized)) {
        let is_first = self.at == self.start;
        if !is_first {
            self.sum = self.sum.wrapping_add(self.hash);
            self.hash = HASH_SEED;
        }
        let has_inline_qos = self.flags & flag::INLINE_QOS != 0;
        let len = match message.load::<4>(self.at) {
            Some([_, kind, _, _]) if is_first && !has_inline_qos => {
                // PL_CDR_LE; what else there is matters when it is read.
                self.is_little_endian = kind == 3;
                Some(0)
            }
            Some([a, b, c, d]) if !is_first && self.u16([a, b]) != PID_SENTINEL => {
                Some(u32::from(self.u16([c, d])))
            }
            _ => None,
        };
        self.parameter_end = match len {
            Some(len) => self.end.min(self.at + 4 + len),
            None => self.end,
        };
    }

    #[inline(always)]
    const fn mix(&mut self, word: u64) {
        let mixed = (self.hash ^ word).wrapping_mul(HASH_FACTOR);
        self.hash = mixed ^ mixed >> 32;
    }

    /// The next parameter; nothing where there is none.
    #[inline(always)]
    fn parameter(&mut self, message: &(impl Bytes + ?Sized)) -> Option<Parameter> {
        let [a, b, c, d] = message.load::<4>(self.at)?;
        let (id, len) = (self.u16([a, b]), u32::from(self.u16([c, d])));
        let value = self.at + 4;
        if value > self.end || id != PID_SENTINEL && (len & 3 != 0 || len > self.end - value) {
            return None;
        }
        self.at = if id == PID_SENTINEL {
            value
        } else {
            value + len
        };
        self.parameters += 1;
        Some(Parameter { id, value, len })
    }

    #[inline(always)]
    const fn u16(&self, bytes: [u8; 2]) -> u16 {
        if self.is_little_endian {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        }
    }

    #[inline(always)]
    const fn u32(&self, bytes: [u8; 4]) -> u32 {
        if self.is_little_endian {
            u32::from_le_bytes(bytes)
        } else {
            u32::from_be_bytes(bytes)
        }
    }

    /// Address and port of a locator.
    #[inline(always)]
    fn locator(&self, locator: [u8; 24]) -> Option<([u8; 16], u32)> {
        let port = self.u32(part(&locator, 4));
        match self.u32(part(&locator, 0)) {
            LOCATOR_KIND_UDP_V4 => Some((mapped(part(&locator, 20)), port)),
            LOCATOR_KIND_UDP_V6 => Some((part(&locator, 8), port)),
            _ => None,
        }
    }
}

impl Exchange {
    /// One step through the announcement; breaks at its end.
    #[inline(always)]
    pub(super) fn read_announcement(
        &mut self,
        message: &(impl Bytes + ?Sized),
        world: &impl World,
    ) -> ControlFlow<()> {
        match self.reading.stage {
            Stage::Hash => self.hash_announcement(message, world),
            Stage::InlineQos => self.read_inline_qos(message),
            Stage::Encapsulation => self.read_encapsulation(message),
            Stage::Parameters => self.read_parameter(message, world),
        }
    }

    #[inline(always)]
    fn hash_announcement(
        &mut self,
        message: &(impl Bytes + ?Sized),
        world: &impl World,
    ) -> ControlFlow<()> {
        let reading = &mut self.reading;
        let is_long = reading.end.saturating_sub(reading.start) > MAX_HASHED;
        if !is_long && reading.hash(message).is_continue() {
            return ControlFlow::Continue(());
        }
        // 0 stands for none.
        reading.hash = if is_long { 0 } else { reading.hash.max(1) };
        let is_same = !is_long && reading.hash == self.peer.announcement_hash;
        if self.is_known && is_same {
            self.greet_again(world);
            return ControlFlow::Break(());
        }
        reading.at = reading.start;
        reading.stage = if reading.flags & flag::INLINE_QOS != 0 {
            Stage::InlineQos
        } else {
            Stage::Encapsulation
        };
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn read_inline_qos(&mut self, message: &(impl Bytes + ?Sized)) -> ControlFlow<()> {
        const STATUS: u32 = 3;
        let reading = &mut self.reading;
        let Some(parameter) = reading.parameter(message) else {
            return ControlFlow::Break(());
        };
        match parameter.id {
            PID_SENTINEL => reading.stage = Stage::Encapsulation,
            PID_STATUS_INFO if parameter.len > STATUS => {
                if let Some([status]) = message.load::<1>(parameter.value + STATUS) {
                    reading.is_gone |= status & NOT_ALIVE != 0;
                }
            }
            _ => {}
        }
        if reading.parameters < MAX_PARAMETERS {
            return ControlFlow::Continue(());
        }
        self.pass_on();
        ControlFlow::Break(())
    }

    #[inline(always)]
    fn read_encapsulation(&mut self, message: &(impl Bytes + ?Sized)) -> ControlFlow<()> {
        if self.reading.is_gone {
            self.farewell();
            return ControlFlow::Break(());
        }
        let reading = &mut self.reading;
        if reading.flags & flag::DATA == 0 {
            return ControlFlow::Break(());
        }
        // PL_CDR_BE and PL_CDR_LE.
        reading.is_little_endian = match message.load::<4>(reading.at) {
            Some([0, 2, _, _]) => false,
            Some([0, 3, _, _]) => true,
            _ => return ControlFlow::Break(()),
        };
        reading.at += 4;
        reading.parameters = 0;
        reading.stage = Stage::Parameters;
        if !self.is_known {
            self.peer = Peer::default();
            self.peer.addresses[0] = self.setting.source;
        }
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn read_parameter(
        &mut self,
        message: &(impl Bytes + ?Sized),
        world: &impl World,
    ) -> ControlFlow<()> {
        let Some(Parameter { id, value, len }) = self.reading.parameter(message) else {
            return ControlFlow::Break(());
        };
        match id {
            PID_SENTINEL => {
                if self.reading.is_own {
                    self.announced(world);
                }
                return ControlFlow::Break(());
            }
            PID_PARTICIPANT_GUID if len >= 16 => {
                let Some(prefix) = message.load::<12>(value) else {
                    return ControlFlow::Break(());
                };
                if prefix != self.setting.sender {
                    return ControlFlow::Break(());
                }
                self.reading.is_own = true;
            }
            PID_METATRAFFIC_UNICAST_LOCATOR | PID_DEFAULT_UNICAST_LOCATOR if len >= 24 => {
                if let Some(locator) = message.load::<24>(value) {
                    self.note_locator(locator, id == PID_METATRAFFIC_UNICAST_LOCATOR);
                }
            }
            // A string's length counts its NUL.
            PID_DOMAIN_ID | PID_DOMAIN_TAG if len >= 4 => {
                let reading = &mut self.reading;
                let number = message
                    .load::<4>(value)
                    .map_or(0, |bytes| reading.u32(bytes));
                reading.is_elsewhere |= if id == PID_DOMAIN_ID {
                    number != self.setting.domain_id
                } else {
                    number > 1
                };
            }
            _ => {}
        }
        if self.reading.parameters < MAX_PARAMETERS {
            return ControlFlow::Continue(());
        }
        if self.reading.is_own {
            self.announced(world);
        }
        self.pass_on();
        ControlFlow::Break(())
    }

    /// A locator of the participant: a port to answer to if it lies at the source, and an address that it may send
    /// from.
    #[inline(always)]
    fn note_locator(&mut self, locator: [u8; 24], is_metatraffic: bool) {
        let reading = &mut self.reading;
        let Some((address, port)) = reading.locator(locator) else {
            return;
        };
        let is_port = port <= u32::from(u16::MAX);
        if is_metatraffic && reading.port == 0 && is_port && address == self.setting.source {
            reading.port = port;
        }
        if self.is_known || self.peer.addresses.contains(&address) {
            return;
        }
        reading.addresses += 1;
        match self.peer.addresses.get_mut(reading.addresses as usize) {
            Some(free) => *free = address,
            None => self.peer.flags |= PEER_ANY_ADDRESS,
        }
    }

    /// A participant that is new, or says something new.
    #[inline(always)]
    fn announced(&mut self, world: &impl World) {
        if !self.is_known {
            self.is_known = true;
            self.is_new = true;
            self.peer.last_seen_ns = self.setting.now_ns;
            // What comes from this host may come from any address of it, and from nobody else.
            if self.setting.is_local {
                self.peer.flags |= PEER_ANY_ADDRESS;
            }
            self.forget_progress();
        }
        let reading = &self.reading;
        let is_elsewhere = reading.is_elsewhere;
        self.peer.reply_port = if is_elsewhere { 0 } else { reading.port };
        self.peer.announcement_hash = reading.hash;
        self.has_news = true;
        if self.peer.flags & PEER_PROVEN == 0 && !is_elsewhere {
            let can_greet = self.setting.may_answer && self.peer.reply_port != 0;
            if can_greet && self.can_announce(world) {
                self.is_greeting = true;
            } else {
                self.pass_on();
            }
        }
    }

    /// Who says the same again and nothing else may not have got our answer; who says it to us has, and two hosts
    /// must not answer each other for ever.
    #[inline(always)]
    fn greet_again(&mut self, world: &impl World) {
        let is_proven = self.is_directed || self.peer.flags & PEER_PROVEN != 0;
        let is_waiting = !is_proven && self.peer.reply_port != 0;
        if is_waiting && self.setting.may_answer && self.can_announce(world) {
            self.is_greeting = true;
        }
    }

    /// A participant that is gone. Should it come again, all begins anew.
    #[inline(always)]
    fn farewell(&mut self) {
        if !self.is_known {
            return;
        }
        self.has_news = true;
        self.peer.announcement_hash = self.reading.hash;
        self.peer.reply_port = 0;
        self.peer.flags &= !PEER_PROVEN;
        self.forget_progress();
    }

    #[inline(always)]
    fn forget_progress(&mut self) {
        for writer in &mut self.peer.writers {
            *writer = RemoteWriter {
                next: 1,
                acknack_count: writer.acknack_count,
                flags: 0,
            };
        }
        for reader in &mut self.peer.readers {
            *reader = RemoteReader {
                heartbeat_count: reader.heartbeat_count,
                ..RemoteReader::default()
            };
        }
    }

    /// Whether our announcement is there and fits a datagram.
    #[inline(always)]
    fn can_announce(&self, world: &impl World) -> bool {
        let room = self.setting.datagram_size.saturating_sub(PROLOGUE_LEN);
        world
            .announcement()
            .is_some_and(|announcement| announcement.len != 0 && announcement.len <= room)
    }
}
