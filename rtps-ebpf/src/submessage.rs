//! Submessages (RTPS 2.5, 8.3.8 and 9.4.5): where each ends, whether its fields are valid, and
//! which entity it addresses. Payloads, parameters and timestamps are not looked at: that is the
//! full decoder's work, in the app.

use crate::{
    bytes::Bytes,
    counter::Reason,
    entity::{EntityId, GuidPrefix},
    number_set::{bitmap_len, check_fragment_base, check_sequence_base},
};

/// submessageId of the submessages that this module knows.
pub(crate) mod id {
    pub(crate) const PAD: u8 = 0x01;
    pub(crate) const ACKNACK: u8 = 0x06;
    pub(crate) const HEARTBEAT: u8 = 0x07;
    pub(crate) const GAP: u8 = 0x08;
    pub(crate) const INFO_TS: u8 = 0x09;
    pub(crate) const INFO_SRC: u8 = 0x0c;
    pub(crate) const INFO_REPLY_IP4: u8 = 0x0d;
    pub(crate) const INFO_DST: u8 = 0x0e;
    pub(crate) const INFO_REPLY: u8 = 0x0f;
    pub(crate) const NACK_FRAG: u8 = 0x12;
    pub(crate) const HEARTBEAT_FRAG: u8 = 0x13;
    pub(crate) const DATA: u8 = 0x15;
    pub(crate) const DATA_FRAG: u8 = 0x16;
}

/// Flags in a submessage header; the meaning of a bit depends on the submessage.
pub(crate) mod flag {
    pub(crate) const LITTLE_ENDIAN: u8 = 0x01;
    pub(crate) const INLINE_QOS: u8 = 0x02;
    pub(crate) const DATA: u8 = 0x04;
    pub(crate) const KEY: u8 = 0x08;
    pub(crate) const INVALIDATE: u8 = 0x02;
    pub(crate) const FINAL: u8 = 0x02;
    pub(crate) const MULTICAST: u8 = 0x02;
}

/// Bytes of a submessage header.
const HEADER_LEN: u32 = 4;
/// Bytes of the fields of a DATA.
const DATA_FIELDS: usize = 20;
/// Bytes of an INFO_TS with a timestamp.
const INFO_TS: usize = 12;
/// Bytes of a DATA before what differs in length.
const LEAD: usize = HEADER_LEN as usize + DATA_FIELDS;
/// Bytes of a parameter list that holds its sentinel only.
const MIN_PARAMETER_LIST: u32 = 4;
/// Bytes of the encapsulation header that every serialized payload begins with.
const MIN_PAYLOAD: u32 = 4;
/// Bytes that may fill a submessage up to a multiple of four.
const MAX_PADDING: u32 = 3;
/// The lowest valid sequence number.
const FIRST_SEQUENCE_NUMBER: i64 = 1;

/// What a valid submessage means to the receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// Nothing that matters here.
    Other,
    /// What follows comes from this participant.
    Source(GuidPrefix),
    /// What follows is for this participant; all zero: for anyone.
    Destination(GuidPrefix),
    /// From a writer to a reader, or to all its readers.
    ToReader { reader: EntityId, writer: EntityId },
    /// From a reader to a writer.
    ToWriter(EntityId),
}

/// One submessage: where its body lies, within bounds, and how to read it.
#[derive(Clone, Copy)]
pub(crate) struct Submessage {
    pub(crate) id: u8,
    pub(crate) flags: u8,
    pub(crate) start: u32,
    len: u32,
    /// Its header said 0: all that is left.
    to_end: bool,
}

impl Submessage {
    /// Reads the header at `offset`, which must not be the end.
    #[inline(always)]
    pub(crate) fn read(bytes: &(impl Bytes + ?Sized), offset: u32) -> Result<Self, Reason> {
        match bytes.load::<4>(offset) {
            Some(header) => Self::new(header, offset, bytes.len()),
            None => Err(Reason::SubmessageHeader),
        }
    }

    /// Reads the submessage at `offset`, or the one behind it where that is a timestamp, and says what it means.
    ///
    /// Samples come as INFO_TS and DATA, many in a message: both are read at once, because each read is a call for
    /// the kernel's programs.
    #[inline(always)]
    pub(crate) fn read_next(
        bytes: &(impl Bytes + ?Sized),
        offset: u32,
    ) -> Result<(Self, Meaning), Reason> {
        let Some(window) = bytes.load::<{ INFO_TS + LEAD }>(offset) else {
            let submessage = Self::read(bytes, offset)?;
            return Ok((submessage, submessage.meaning(bytes)?));
        };
        let (offset, lead): (u32, [u8; LEAD]) = if is_timestamp(&window) {
            (offset + INFO_TS as u32, part(&window, INFO_TS))
        } else {
            (offset, part(&window, 0))
        };
        let submessage = Self::new(part(&lead, 0), offset, bytes.len())?;
        let meaning = if submessage.id == id::DATA && submessage.len >= DATA_FIELDS as u32 {
            submessage.data_of(&part(&lead, HEADER_LEN as usize))?
        } else {
            submessage.meaning(bytes)?
        };
        Ok((submessage, meaning))
    }

    /// With this header at `offset` of a message of `end` bytes.
    #[inline(always)]
    fn new([id, flags, a, b]: [u8; 4], offset: u32, end: u32) -> Result<Self, Reason> {
        let start = offset + HEADER_LEN;
        let left = end - start;
        let mut submessage = Self {
            id,
            flags,
            start,
            len: 0,
            to_end: false,
        };
        let len = u32::from(submessage.u16([a, b]));
        // 9.4.5.1.3: 0 means "the rest of the message", but for the two that may be empty.
        submessage.to_end = len == 0 && id != id::PAD && id != id::INFO_TS;
        submessage.len = if submessage.to_end { left } else { len };
        if submessage.len > left {
            return Err(Reason::SubmessageLength);
        }
        Ok(submessage)
    }

    /// The offset of the next submessage.
    #[inline(always)]
    pub(crate) const fn end(&self) -> u32 {
        self.start + self.len
    }

    /// Flag F of HEARTBEAT and ACKNACK: no answer is needed.
    #[inline(always)]
    pub(crate) const fn is_final(&self) -> bool {
        self.has(flag::FINAL)
    }

    /// Checks the fields and says what they mean.
    #[inline(always)]
    pub(crate) fn meaning(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        match self.id {
            id::DATA => self.data(bytes),
            id::HEARTBEAT => self.heartbeat(bytes),
            id::ACKNACK => self.acknack(bytes),
            id::GAP => self.gap(bytes),
            id::DATA_FRAG => self.data_frag(bytes),
            id::HEARTBEAT_FRAG => self.heartbeat_frag(bytes),
            id::NACK_FRAG => self.nack_frag(bytes),
            id::INFO_DST => self.info_dst(bytes),
            id::INFO_SRC => self.info_src(bytes),
            id::INFO_TS => self.info_ts(),
            id::INFO_REPLY => self.info_reply(bytes),
            id::INFO_REPLY_IP4 => self.info_reply_ip4(),
            _ => Ok(Meaning::Other),
        }
    }

    /// RTPS 2.5, 9.4.5.4.
    #[inline(always)]
    fn data(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        self.data_of(&self.fields(bytes)?)
    }

    #[inline(always)]
    fn data_of(&self, fields: &[u8; DATA_FIELDS]) -> Result<Meaning, Reason> {
        let reader = part(fields, 4);
        let writer = part(fields, 8);
        self.check_number(part(fields, 12))?;
        let rest = self.after_inline_qos_offset(part(fields, 2), DATA_FIELDS as u32)?;
        let (data, key) = (self.has(flag::DATA), self.has(flag::KEY));
        let needed = self.inline_qos_len() + if data | key { MIN_PAYLOAD } else { 0 };
        if data & key | (rest < needed) {
            return Err(Reason::Payload);
        }
        Ok(Meaning::ToReader { reader, writer })
    }

    /// RTPS 2.5, 9.4.5.5.
    #[inline(always)]
    fn data_frag(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let fields = self.fields::<32>(bytes)?;
        let reader = part(&fields, 4);
        let writer = part(&fields, 8);
        self.check_number(part(&fields, 12))?;
        let rest = self.after_inline_qos_offset(part(&fields, 2), 32)?;
        let start = u64::from(self.u32(part(&fields, 20)));
        let count = u64::from(self.u16(part(&fields, 24)));
        let size = u64::from(self.u16(part(&fields, 26)));
        let sample = u64::from(self.u32(part(&fields, 28)));
        if size == 0 || size > sample {
            return Err(Reason::FragmentSize);
        }
        if count == 0 {
            return Err(Reason::FragmentCount);
        }
        if start == 0 {
            return Err(Reason::FragmentStart);
        }
        // 32 + 16 bits at most, so nothing here overflows.
        let first = (start - 1) * size;
        let last = first + (count - 1) * size;
        if last >= sample {
            return Err(Reason::FragmentRange);
        }
        let expected = (count * size).min(sample - first);
        self.check_fragment_bytes(u64::from(rest), expected)?;
        Ok(Meaning::ToReader { reader, writer })
    }

    /// Whether inline QoS (of unknown length) and fragments fit the `rest` of the submessage.
    #[inline(always)]
    fn check_fragment_bytes(&self, rest: u64, expected: u64) -> Result<(), Reason> {
        let inline_qos = self.inline_qos_len();
        let surplus = inline_qos == 0 && rest > expected + u64::from(MAX_PADDING);
        if rest < expected + u64::from(inline_qos) || surplus {
            return Err(Reason::FragmentBytes);
        }
        Ok(())
    }

    /// RTPS 2.5, 9.4.5.7.
    #[inline(always)]
    fn heartbeat(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let fields = self.fields::<28>(bytes)?;
        let first = self.i64(part(&fields, 8));
        let last = self.i64(part(&fields, 16));
        if first < FIRST_SEQUENCE_NUMBER || last < first - 1 {
            return Err(Reason::HeartbeatRange);
        }
        // Group information (flag G) may follow, so a length of 0 proves nothing here.
        Ok(Meaning::ToReader {
            reader: part(&fields, 0),
            writer: part(&fields, 4),
        })
    }

    /// RTPS 2.5, 9.4.5.6.
    #[inline(always)]
    fn gap(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let fields = self.fields::<28>(bytes)?;
        if self.i64(part(&fields, 8)) < FIRST_SEQUENCE_NUMBER {
            return Err(Reason::GapStart);
        }
        check_sequence_base(self.i64(part(&fields, 16)), FIRST_SEQUENCE_NUMBER)?;
        bitmap_len(self.u32(part(&fields, 24)), self.len - 28)?;
        Ok(Meaning::ToReader {
            reader: part(&fields, 0),
            writer: part(&fields, 4),
        })
    }

    /// RTPS 2.5, 9.4.5.3. Some vendors ask for a HEARTBEAT with a set that begins at 0.
    #[inline(always)]
    fn acknack(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        const COUNT: u32 = 4;
        let fields = self.fields::<20>(bytes)?;
        check_sequence_base(self.i64(part(&fields, 8)), 0)?;
        let room = self.len.saturating_sub(20 + COUNT);
        let bitmap = bitmap_len(self.u32(part(&fields, 16)), room)?;
        self.check_end(20 + bitmap + COUNT)?;
        Ok(Meaning::ToWriter(part(&fields, 4)))
    }

    /// RTPS 2.5, 9.4.5.14.
    #[inline(always)]
    fn nack_frag(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        const COUNT: u32 = 4;
        let fields = self.fields::<24>(bytes)?;
        self.check_number(part(&fields, 8))?;
        check_fragment_base(self.u32(part(&fields, 16)))?;
        let room = self.len.saturating_sub(24 + COUNT);
        let bitmap = bitmap_len(self.u32(part(&fields, 20)), room)?;
        self.check_end(24 + bitmap + COUNT)?;
        Ok(Meaning::ToWriter(part(&fields, 4)))
    }

    /// RTPS 2.5, 9.4.5.8.
    #[inline(always)]
    fn heartbeat_frag(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let fields = self.fields::<24>(bytes)?;
        self.check_number(part(&fields, 8))?;
        if self.u32(part(&fields, 16)) == 0 {
            return Err(Reason::FragmentStart);
        }
        self.check_end(24)?;
        Ok(Meaning::ToReader {
            reader: part(&fields, 0),
            writer: part(&fields, 4),
        })
    }

    /// RTPS 2.5, 9.4.5.9.
    #[inline(always)]
    fn info_dst(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let prefix = self.fields::<12>(bytes)?;
        self.check_end(12)?;
        Ok(Meaning::Destination(prefix))
    }

    /// RTPS 2.5, 9.4.5.12: unused, version, vendor, prefix.
    #[inline(always)]
    fn info_src(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let fields = self.fields::<20>(bytes)?;
        self.check_end(20)?;
        Ok(Meaning::Source(part(&fields, 8)))
    }

    /// RTPS 2.5, 9.4.5.13.
    #[inline(always)]
    fn info_ts(&self) -> Result<Meaning, Reason> {
        self.check_len(if self.has(flag::INVALIDATE) { 0 } else { 8 })
    }

    /// RTPS 2.5, 9.4.5.10: one or two lists of 24-byte locators.
    #[inline(always)]
    fn info_reply(&self, bytes: &(impl Bytes + ?Sized)) -> Result<Meaning, Reason> {
        let unicast = self.locators_end(bytes, 0)?;
        if self.has(flag::MULTICAST) {
            self.locators_end(bytes, unicast)?;
        }
        Ok(Meaning::Other)
    }

    /// RTPS 2.5, 9.4.5.11: one or two pairs of address and port.
    #[inline(always)]
    fn info_reply_ip4(&self) -> Result<Meaning, Reason> {
        self.check_len(if self.has(flag::MULTICAST) { 16 } else { 8 })
    }

    /// Where the locator list at `offset` of the body ends.
    #[inline(always)]
    fn locators_end(&self, bytes: &(impl Bytes + ?Sized), offset: u32) -> Result<u32, Reason> {
        const LOCATOR: u64 = 24;
        let Some(list) = (offset + 4 <= self.len).then_some(self.start + offset) else {
            return Err(Reason::SubmessageTooShort);
        };
        let Some(count) = bytes.load::<4>(list) else {
            return Err(Reason::SubmessageTooShort);
        };
        let end = u64::from(offset) + 4 + u64::from(self.u32(count)) * LOCATOR;
        if end > u64::from(self.len) {
            return Err(Reason::LocatorList);
        }
        Ok(end as u32)
    }

    /// The first `N` bytes of the body.
    #[inline(always)]
    fn fields<const N: usize>(&self, bytes: &(impl Bytes + ?Sized)) -> Result<[u8; N], Reason> {
        if (self.len as usize) < N {
            return Err(Reason::SubmessageTooShort);
        }
        bytes
            .load::<N>(self.start)
            .ok_or(Reason::SubmessageTooShort)
    }

    /// For a body of `len` bytes without fields of interest.
    #[inline(always)]
    fn check_len(&self, len: u32) -> Result<Meaning, Reason> {
        if self.len < len {
            return Err(Reason::SubmessageTooShort);
        }
        self.check_end(len)?;
        Ok(Meaning::Other)
    }

    /// For a submessage whose fields end at `len`: with a header that says 0 it must be the last,
    /// so more bytes mean that it stands in the middle.
    #[inline(always)]
    fn check_end(&self, len: u32) -> Result<(), Reason> {
        if self.to_end && self.len > len + MAX_PADDING {
            return Err(Reason::ZeroLength);
        }
        Ok(())
    }

    /// A writerSN must be a positive number.
    #[inline(always)]
    fn check_number(&self, number: [u8; 8]) -> Result<(), Reason> {
        if self.i64(number) < FIRST_SEQUENCE_NUMBER {
            return Err(Reason::SequenceNumber);
        }
        Ok(())
    }

    /// Follows octetsToInlineQos, which counts from its own end, over at least the fields that
    /// this version of the protocol has; returns the number of bytes behind.
    #[inline(always)]
    fn after_inline_qos_offset(&self, octets: [u8; 2], fields: u32) -> Result<u32, Reason> {
        let offset = 4 + u32::from(self.u16(octets));
        if offset < fields || offset > self.len {
            return Err(Reason::InlineQosOffset);
        }
        Ok(self.len - offset)
    }

    /// The least that inline QoS takes, when there is any.
    #[inline(always)]
    const fn inline_qos_len(&self) -> u32 {
        if self.has(flag::INLINE_QOS) {
            MIN_PARAMETER_LIST
        } else {
            0
        }
    }

    #[inline(always)]
    pub(crate) const fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }

    #[inline(always)]
    pub(crate) const fn u16(&self, bytes: [u8; 2]) -> u16 {
        u16_by(self.flags, bytes)
    }

    #[inline(always)]
    pub(crate) const fn u32(&self, bytes: [u8; 4]) -> u32 {
        if self.has(flag::LITTLE_ENDIAN) {
            u32::from_le_bytes(bytes)
        } else {
            u32::from_be_bytes(bytes)
        }
    }

    /// A SequenceNumber_t: the high word comes first in both byte orders (9.3.2).
    #[inline(always)]
    pub(crate) fn i64(&self, bytes: [u8; 8]) -> i64 {
        let high = self.u32(part(&bytes, 0));
        let low = self.u32(part(&bytes, 4));
        i64::from(high) << 32 | i64::from(low)
    }
}

/// Whether the bytes begin with an INFO_TS that has a timestamp (RTPS 2.5, 9.4.5.13).
#[inline(always)]
fn is_timestamp<const N: usize>(bytes: &[u8; N]) -> bool {
    let [id, flags, a, b]: [u8; 4] = part(bytes, 0);
    id == id::INFO_TS
        && flags & flag::INVALIDATE == 0
        && usize::from(u16_by(flags, [a, b])) == INFO_TS - HEADER_LEN as usize
}

/// A number in the byte order that a submessage's flags say.
#[inline(always)]
const fn u16_by(flags: u8, bytes: [u8; 2]) -> u16 {
    if flags & flag::LITTLE_ENDIAN != 0 {
        u16::from_le_bytes(bytes)
    } else {
        u16::from_be_bytes(bytes)
    }
}

/// `M` of `N` bytes; `at` is a constant in every call and within bounds.
#[inline(always)]
pub(crate) const fn part<const N: usize, const M: usize>(bytes: &[u8; N], at: usize) -> [u8; M] {
    let mut part = [0; M];
    let mut index = 0;
    while index < M {
        part[index] = bytes[at + index];
        index += 1;
    }
    part
}
