//! One datagram of a writer: submessages are appended as long as they fit.

use crate::history::CacheChange;
use crate::wire::{
    Data, DataFragment, EntityId, Gap, Guid, HEADER_LEN, Heartbeat, HeartbeatFrag, InlineQos,
    MessageWriter, SequenceNumber, SequenceNumberSet, Timestamp,
};

use super::Position;

const INFO_DST_LEN: usize = 16;
const INFO_TS_LEN: usize = 12;
const HEARTBEAT_LEN: usize = 32;
/// Header, entity ids, start, and a set with all of its bits.
const GAP_LEN: usize = 4 + 8 + 8 + 12 + 32;
const KEY_HASH_LEN: usize = 20;
const STATUS_INFO_LEN: usize = 8;
const SENTINEL_LEN: usize = 4;
/// The most that inline QoS take.
const INLINE_QOS_LEN: usize = KEY_HASH_LEN + STATUS_INFO_LEN + SENTINEL_LEN;
/// Everything of a DATA but the payload.
const DATA_LEN: usize = 4 + 20 + INLINE_QOS_LEN;
/// Everything of a DATA_FRAG but the payload.
const DATA_FRAG_LEN: usize = 4 + 32 + INLINE_QOS_LEN;

/// How a writer's changes are laid out in datagrams; the same for all readers, because fragments must be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    writer: Guid,
    datagram: usize,
    fragment: u16,
}

impl Layout {
    /// What UDP over IPv4 can carry.
    const MAX_DATAGRAM: usize = 65_507;
    /// Leaves a fragment a useful size.
    const MIN_DATAGRAM: usize = 256;

    /// For datagrams of up to `datagram` bytes.
    pub(super) fn new(writer: Guid, datagram: usize) -> Self {
        let datagram = datagram.clamp(Self::MIN_DATAGRAM, Self::MAX_DATAGRAM);
        let room = datagram - HEADER_LEN - INFO_DST_LEN - INFO_TS_LEN - DATA_FRAG_LEN;
        Self {
            writer,
            datagram,
            fragment: (room - room % 4) as u16,
        }
    }

    /// Whether a payload of that length is sent in DATA_FRAGs.
    pub(super) fn is_fragmented(&self, len: usize) -> bool {
        let rest = self.datagram - HEADER_LEN - INFO_DST_LEN - INFO_TS_LEN - DATA_LEN;
        len.next_multiple_of(4) > rest
    }

    /// A change as a DATA for `reader`; empty where it is sent in fragments.
    pub(super) fn submessage(
        &self,
        reader: EntityId,
        sequence: SequenceNumber,
        change: &CacheChange,
    ) -> Vec<u8> {
        let mut out = Vec::new();
        if !self.is_fragmented(change.payload.len()) {
            MessageWriter::resume(&mut out).data(&self.data(reader, sequence, change));
        }
        out
    }

    fn data<'a>(
        &self,
        reader: EntityId,
        sequence: SequenceNumber,
        change: &'a CacheChange,
    ) -> Data<'a> {
        Data {
            reader,
            writer: self.writer.entity,
            sequence,
            inline_qos: self.inline_qos(change),
            kind: change.payload_kind(),
            payload: &change.payload,
        }
    }

    /// Bytes of a change's DATA.
    fn data_len(&self, change: &CacheChange) -> usize {
        let qos = self.inline_qos(change);
        let parameters = usize::from(qos.key_hash.is_some()) * KEY_HASH_LEN
            + usize::from(!qos.status.is_alive()) * STATUS_INFO_LEN;
        let sentinel = if parameters > 0 { SENTINEL_LEN } else { 0 };
        let without_qos = DATA_LEN - INLINE_QOS_LEN;
        without_qos + parameters + sentinel + change.payload.len().next_multiple_of(4)
    }

    /// Samples of the built-in topics hold their key, and are many: only a disposal, which holds nothing else, needs
    /// the hash as well, for those who read nothing else.
    fn inline_qos(&self, change: &CacheChange) -> InlineQos {
        let Guid { entity, .. } = self.writer;
        let is_needed = !entity.is_builtin() || !change.kind.status_info().is_alive();
        InlineQos {
            key_hash: (entity.has_key() && is_needed).then_some(change.instance),
            status: change.kind.status_info(),
            coherent_set: None,
        }
    }

    /// Bytes of a sample in one DATA_FRAG, at least 1.
    pub(super) fn fragment_size(&self) -> usize {
        usize::from(self.fragment).max(1)
    }

    /// How many DATA_FRAGs that are.
    fn fragments(&self, len: usize) -> u32 {
        u32::try_from(len.div_ceil(usize::from(self.fragment))).unwrap_or(u32::MAX)
    }
}

/// A datagram in the making, behind what its buffer holds already.
#[derive(Debug)]
pub(super) struct Packet<'a> {
    message: MessageWriter<'a>,
    layout: &'a Layout,
    reader: EntityId,
    timestamp: Option<Timestamp>,
    prologue: usize,
}

impl<'a> Packet<'a> {
    /// For every reader at its destinations.
    pub(super) fn undirected(out: &'a mut Vec<u8>, layout: &'a Layout) -> Self {
        let message = MessageWriter::new(out, layout.writer.prefix);
        Self {
            prologue: message.len(),
            message,
            layout,
            reader: EntityId::UNKNOWN,
            timestamp: None,
        }
    }

    /// For one reader.
    pub(super) fn directed(out: &'a mut Vec<u8>, layout: &'a Layout, reader: Guid) -> Self {
        let mut message = MessageWriter::new(out, layout.writer.prefix);
        message.info_destination(reader.prefix);
        Self {
            prologue: message.len(),
            message,
            layout,
            reader: reader.entity,
            timestamp: None,
        }
    }

    /// Whether nothing has been appended.
    pub(super) fn is_empty(&self) -> bool {
        self.message.len() == self.prologue
    }

    /// Bytes of the datagram so far.
    pub(super) fn len(&self) -> usize {
        self.message.len()
    }

    /// Ends the datagram. Gives whether there is one: where nothing has been appended it is taken back.
    pub(super) fn finish(self) -> bool {
        let is_empty = self.is_empty();
        if is_empty {
            self.message.discard();
        }
        !is_empty
    }

    /// Appends what fits of a change from `position` on, and moves `position`, behind the change at last. Gives
    /// whether that point was reached.
    pub(super) fn change(&mut self, position: &mut Position, change: &CacheChange) -> bool {
        let sequence = position.sequence;
        if self.layout.is_fragmented(change.payload.len()) {
            let fragments = self.layout.fragments(change.payload.len());
            while position.fragment <= fragments {
                if !self.fragment(sequence, position.fragment, change) {
                    return false;
                }
                position.fragment += 1;
            }
        } else if !self.data(sequence, change) {
            return false;
        }
        position.skip_to(sequence.next());
        true
    }

    /// Whether a change is sent in fragments and has that one.
    pub(super) fn has_fragment(&self, fragment: u32, change: &CacheChange) -> bool {
        let len = change.payload.len();
        self.layout.is_fragmented(len) && (1..=self.layout.fragments(len)).contains(&fragment)
    }

    /// Appends one fragment of a change; gives whether it fitted.
    pub(super) fn fragment(
        &mut self,
        sequence: SequenceNumber,
        fragment: u32,
        change: &CacheChange,
    ) -> bool {
        let start = (fragment as usize - 1).saturating_mul(usize::from(self.layout.fragment));
        let len = change.payload.len().saturating_sub(start);
        let len = len.min(usize::from(self.layout.fragment));
        if !self.has_room(INFO_TS_LEN + DATA_FRAG_LEN + len) {
            return false;
        }
        self.timestamp(change.timestamp);
        self.message.data_fragment(&DataFragment {
            reader: self.reader,
            writer: self.layout.writer.entity,
            sequence,
            fragment,
            fragment_size: self.layout.fragment,
            inline_qos: self.layout.inline_qos(change),
            kind: change.payload_kind(),
            sample: &change.payload,
        });
        true
    }

    /// Appends a GAP of the numbers from `start` to below the base of `list`, and of its members; gives whether
    /// it fitted.
    pub(super) fn gap(&mut self, start: SequenceNumber, list: SequenceNumberSet) -> bool {
        if !self.has_room(GAP_LEN) {
            return false;
        }
        self.message.gap(&Gap {
            reader: self.reader,
            writer: self.layout.writer.entity,
            start,
            list,
        });
        true
    }

    /// Whether a HEARTBEAT fits.
    pub(super) fn has_room_for_heartbeat(&self) -> bool {
        self.has_room(HEARTBEAT_LEN)
    }

    /// Appends a HEARTBEAT, whose entity ids are filled in here.
    pub(super) fn heartbeat(&mut self, heartbeat: Heartbeat) {
        self.message.heartbeat(&Heartbeat {
            reader: self.reader,
            writer: self.layout.writer.entity,
            ..heartbeat
        });
    }

    /// Appends a HEARTBEAT_FRAG.
    pub(super) fn heartbeat_frag(
        &mut self,
        sequence: SequenceNumber,
        last_fragment: u32,
        count: i32,
    ) {
        self.message.heartbeat_frag(&HeartbeatFrag {
            reader: self.reader,
            writer: self.layout.writer.entity,
            sequence,
            last_fragment,
            count,
        });
    }

    fn data(&mut self, sequence: SequenceNumber, change: &CacheChange) -> bool {
        if !self.has_room(INFO_TS_LEN + self.layout.data_len(change)) {
            return false;
        }
        self.timestamp(change.timestamp);
        self.message
            .data(&self.layout.data(self.reader, sequence, change));
        true
    }

    fn timestamp(&mut self, timestamp: Timestamp) {
        if self.timestamp.replace(timestamp) != Some(timestamp) {
            self.message.info_timestamp(timestamp);
        }
    }

    fn has_room(&self, bytes: usize) -> bool {
        self.message.len() + bytes <= self.layout.datagram
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{ChangeKind, HistoryCache, NewChange};
    use crate::wire::{GuidPrefix, KeyHash};

    const WRITER: Guid = Guid {
        prefix: GuidPrefix([1; 12]),
        entity: EntityId([1, 0, 1, 2]),
    };
    const READER: Guid = Guid {
        prefix: GuidPrefix([2; 12]),
        entity: EntityId([1, 0, 1, 7]),
    };

    fn history(kind: ChangeKind, bytes: usize) -> HistoryCache {
        let mut history = HistoryCache::default();
        let change = NewChange {
            kind,
            instance: KeyHash([3; 16]),
            payload: vec![0; bytes].into(),
            timestamp: Timestamp::default(),
        };
        history.insert(SequenceNumber(1), change);
        history
    }

    /// Datagrams that a change of `bytes` takes.
    fn datagrams(layout: &Layout, kind: ChangeKind, bytes: usize) -> Vec<usize> {
        let history = history(kind, bytes);
        let change = history.get(SequenceNumber(1)).unwrap();
        let mut position = Position::start_of(SequenceNumber(1));
        let mut lengths = Vec::new();
        let mut out = Vec::new();
        while position.sequence == SequenceNumber(1) {
            let start = out.len();
            let mut packet = Packet::directed(&mut out, layout, READER);
            packet.change(&mut position, change);
            assert!(packet.finish(), "no progress");
            lengths.push(out.len() - start);
        }
        lengths
    }

    #[test]
    fn no_datagram_exceeds_its_size() {
        for size in [0, 256, 511, 1472, 65_507, usize::MAX] {
            let layout = Layout::new(WRITER, size);
            for bytes in (0..3000).chain([65_000, 65_400, 65_507, 200_001]) {
                for kind in [ChangeKind::Alive, ChangeKind::DisposedUnregistered] {
                    let lengths = datagrams(&layout, kind, bytes);
                    assert!(lengths.iter().all(|length| *length <= layout.datagram));
                    assert_eq!(lengths.len() > 1, layout.is_fragmented(bytes), "{bytes}");
                }
            }
        }
    }
}
