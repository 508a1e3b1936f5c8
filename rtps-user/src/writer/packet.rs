//! One datagram of a writer: submessages are appended as long as they fit.

use std::sync::Arc;

use crate::history::{CacheChange, Membership};
use crate::qos::{PresentationScope, Qos};
use crate::wire::{
    Data, DataFragment, EntityId, Gap, Guid, HEADER_LEN, Heartbeat, HeartbeatFrag, InlineQos,
    MessageWriter, PayloadKind, SequenceNumber, SequenceNumberSet, Timestamp,
};

use super::{BareKey, Position};

const INFO_DST_LEN: usize = 16;
const INFO_TS_LEN: usize = 12;
const HEARTBEAT_LEN: usize = 32;
const HEARTBEAT_GROUP_LEN: usize = 32;
/// Header, entity ids, start, and a set with all of its bits.
const GAP_LEN: usize = 4 + 8 + 8 + 12 + 32;
const KEY_HASH_LEN: usize = 20;
const STATUS_INFO_LEN: usize = 8;
const SENTINEL_LEN: usize = 4;
/// The most that inline QoS take of a change that belongs to no set.
const INLINE_QOS_LEN: usize = KEY_HASH_LEN + STATUS_INFO_LEN + SENTINEL_LEN;
/// Everything of a DATA but inline QoS and payload.
const DATA_LEN: usize = 4 + 20;
/// Everything of a DATA_FRAG but inline QoS and payload.
const DATA_FRAG_LEN: usize = 4 + 32;
/// By how many bytes datagrams are larger than the fragments that they carry, of a writer without coherent sets.
pub const FRAGMENT_OVERHEAD: usize = Layout::before_payload(DATA_FRAG_LEN + INLINE_QOS_LEN);

/// How a writer's changes are laid out in datagrams; the same for all readers, because fragments must be.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    writer: Guid,
    datagram: usize,
    fragment: u16,
    /// The most bytes that the inline QoS of a change with a payload take.
    inline_qos: usize,
    heartbeat: usize,
    /// What readers that expect inline QoS want with each change.
    parameters: Option<Arc<[u8]>>,
}

impl Layout {
    /// What UDP over IPv4 can carry.
    const MAX_DATAGRAM: usize = 65_507;
    /// Leaves a fragment a useful size.
    const MIN_DATAGRAM: usize = 256;

    /// For datagrams of up to `datagram` bytes.
    pub(super) fn new(writer: Guid, datagram: usize, qos: &Qos) -> Self {
        let datagram = datagram.clamp(Self::MIN_DATAGRAM, Self::MAX_DATAGRAM);
        let is_group = qos.presentation.scope == PresentationScope::Group;
        let has_membership = qos.presentation.coherent || is_group;
        let inline_qos = INLINE_QOS_LEN + usize::from(has_membership) * Membership::MAX_LEN;
        Self {
            writer,
            datagram,
            fragment: Self::fragment_in(datagram, inline_qos),
            inline_qos,
            heartbeat: HEARTBEAT_LEN + usize::from(is_group) * HEARTBEAT_GROUP_LEN,
            parameters: None,
        }
    }

    /// The same with `parameters` for the inline QoS of each change; without them where they would leave too little of a
    /// datagram. Fragments get another size then, so that what a reader has of a change is worth nothing any more.
    pub(super) fn with_parameters(self, parameters: &[u8]) -> Self {
        let inline_qos = self.inline_qos + parameters.len();
        let before = Self::before_payload(DATA_FRAG_LEN + inline_qos);
        if parameters.is_empty() || before > self.datagram * 3 / 4 {
            return self;
        }
        Self {
            fragment: Self::fragment_in(self.datagram, inline_qos),
            inline_qos,
            parameters: Some(parameters.into()),
            ..self
        }
    }

    /// Whether changes carry parameters.
    pub(super) fn has_parameters(&self) -> bool {
        self.parameters.is_some()
    }

    fn fragment_in(datagram: usize, inline_qos: usize) -> u16 {
        let room = datagram - Self::before_payload(DATA_FRAG_LEN + inline_qos);
        (room - room % 4) as u16
    }

    fn parameters(&self) -> &[u8] {
        self.parameters.as_deref().unwrap_or_default()
    }

    /// Bytes of a datagram before the payload of its only DATA or DATA_FRAG, which has so many itself.
    const fn before_payload(submessage: usize) -> usize {
        HEADER_LEN + INFO_DST_LEN + INFO_TS_LEN + submessage
    }

    /// Whether a payload of that length is sent in DATA_FRAGs.
    pub(super) fn is_fragmented(&self, len: usize) -> bool {
        let before = Self::before_payload(DATA_LEN + self.inline_qos);
        len.next_multiple_of(4) > self.datagram - before
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
            filters: None,
            kind: change.payload_kind(),
            payload: &change.payload,
        }
    }

    /// Bytes of a change's DATA, with so many of `filter_info`.
    fn data_len(&self, change: &CacheChange, filter_info: usize) -> usize {
        let more = self.parameters().len() + filter_info;
        let inline_qos = self.inline_qos(change).encoded_len(more);
        DATA_LEN + inline_qos + change.payload.len().next_multiple_of(4)
    }

    /// Samples of the built-in topics hold their key, and are many: only a disposal, which holds nothing else, needs
    /// the hash as well, for those who read nothing else.
    fn inline_qos(&self, change: &CacheChange) -> InlineQos {
        let Guid { entity, .. } = self.writer;
        let is_needed = !entity.is_builtin() || !change.kind.status_info().is_alive();
        let mut qos = InlineQos {
            key_hash: (entity.has_key() && is_needed).then_some(change.instance),
            status: change.kind.status_info(),
            ..InlineQos::default()
        };
        if let Some(membership) = &change.membership {
            membership.write_to(&mut qos);
            qos.key_hash = qos.key_hash.filter(|_| !membership.ends_set());
        }
        qos
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
    /// What keys become; a key so long that it is fragmented stays as it is.
    bare_key: Option<BareKey>,
    timestamp: Option<Timestamp>,
    prologue: usize,
    /// PID_CONTENT_FILTER_INFO of the samples in here.
    filter_info: &'a [u8],
}

impl<'a> Packet<'a> {
    /// For every reader at its destinations. Built-in readers are named: dust_dds 0.16 takes a disposal for any reader to be that
    /// of the participant.
    pub(super) fn undirected(out: &'a mut Vec<u8>, layout: &'a Layout) -> Self {
        let message = MessageWriter::new(out, layout.writer.prefix);
        let message = message.with_parameters(layout.parameters());
        Self {
            prologue: message.len(),
            message,
            layout,
            reader: layout.writer.entity.readers_of_all(),
            bare_key: None,
            timestamp: None,
            filter_info: &[],
        }
    }

    /// For one reader.
    pub(super) fn directed(out: &'a mut Vec<u8>, layout: &'a Layout, reader: Guid) -> Self {
        let message = MessageWriter::new(out, layout.writer.prefix);
        let mut message = message.with_parameters(layout.parameters());
        message.info_destination(reader.prefix);
        Self {
            prologue: message.len(),
            message,
            layout,
            reader: reader.entity,
            bare_key: None,
            timestamp: None,
            filter_info: &[],
        }
    }

    /// Keys are sent as `bare_key` makes them.
    pub(super) fn with_bare_key(self, bare_key: Option<BareKey>) -> Self {
        Self { bare_key, ..self }
    }

    /// Its samples have passed the filters that `info` names.
    pub(super) fn set_filter_info(&mut self, info: &'a [u8]) {
        self.filter_info = info;
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
        if !self.has_room(INFO_TS_LEN + DATA_FRAG_LEN + self.layout.inline_qos + len) {
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
        self.has_room(self.layout.heartbeat)
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
        if !self.has_room(INFO_TS_LEN + self.layout.data_len(change, 0)) {
            return false;
        }
        let filter_info = self.filter_info_for(change);
        self.timestamp(change.timestamp);
        let bare_key = self.bare_key_of(change);
        let mut data = self.layout.data(self.reader, sequence, change);
        if let Some(key) = bare_key.as_deref() {
            data.payload = key;
        }
        match filter_info {
            [] => self.message.data(&data),
            info => self.message.data_with(&data, info),
        }
        true
    }

    /// What a sample says of filters, where that fits as well: readers can do without. Fragments never say it, whose size it
    /// would change.
    fn filter_info_for(&self, change: &CacheChange) -> &'a [u8] {
        let info = self.filter_info;
        if info.is_empty() || change.payload_kind() != PayloadKind::Data {
            return &[];
        }
        match self.has_room(INFO_TS_LEN + self.layout.data_len(change, info.len())) {
            true => info,
            false => &[],
        }
    }

    /// The key in the form that the reader knows, where that is another.
    fn bare_key_of(&self, change: &CacheChange) -> Option<Vec<u8>> {
        let make = self.bare_key?;
        let key = match change.payload_kind() {
            PayloadKind::Key => make(&change.payload),
            PayloadKind::Data | PayloadKind::None => None,
        };
        key.filter(|key| key.len() <= change.payload.len())
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
            let layout = Layout::new(WRITER, size, &Qos::default());
            assert_sizes(&layout, (0..3000).chain([65_000, 65_400, 65_507, 200_001]));
            for parameters in [4, 40, 400, 4000] {
                let layout = layout.clone().with_parameters(&vec![0; parameters]);
                assert_sizes(&layout, (0..3000).step_by(97).chain([65_400]));
            }
        }
    }

    fn assert_sizes(layout: &Layout, payloads: impl Iterator<Item = usize>) {
        for bytes in payloads {
            for kind in [ChangeKind::Alive, ChangeKind::DisposedUnregistered] {
                let lengths = datagrams(layout, kind, bytes);
                assert!(lengths.iter().all(|length| *length <= layout.datagram));
                assert_eq!(lengths.len() > 1, layout.is_fragmented(bytes), "{bytes}");
            }
        }
    }
}
