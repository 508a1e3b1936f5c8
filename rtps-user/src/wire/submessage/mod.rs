//! The submessages, one file each; every one decodes from and encodes to its body, header excluded
//! (RTPS 2.5 section 9.4.5).

mod acknack;
mod content_filter_info;
mod data;
mod data_frag;
mod gap;
mod heartbeat;
mod heartbeat_frag;
mod info;
mod inline_qos;
mod nack_frag;

pub use acknack::AckNack;
pub use content_filter_info::{ContentFilterInfo, FilterSignature};
pub use data::{Data, PayloadKind};
pub use data_frag::DataFrag;
pub use gap::Gap;
pub use heartbeat::{Heartbeat, HeartbeatGroup};
pub use heartbeat_frag::HeartbeatFrag;
pub use inline_qos::{GroupDigest, InlineQos, KeyHash, StatusInfo};
pub use nack_frag::NackFrag;

use super::{Cursor, Endianness, EntityId, GuidPrefix, Timestamp, WireError};

/// SubmessageKind (RTPS 9.4.5.1.1).
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct SubmessageKind(pub u8);

impl SubmessageKind {
    /// Padding.
    pub const PAD: Self = Self(0x01);
    /// [`AckNack`].
    pub const ACKNACK: Self = Self(0x06);
    /// [`Heartbeat`].
    pub const HEARTBEAT: Self = Self(0x07);
    /// [`Gap`].
    pub const GAP: Self = Self(0x08);
    /// The source timestamp of what follows.
    pub const INFO_TS: Self = Self(0x09);
    /// The participant that what follows comes from.
    pub const INFO_SRC: Self = Self(0x0c);
    /// The participant that what follows is for.
    pub const INFO_DST: Self = Self(0x0e);
    /// [`NackFrag`].
    pub const NACK_FRAG: Self = Self(0x12);
    /// [`HeartbeatFrag`].
    pub const HEARTBEAT_FRAG: Self = Self(0x13);
    /// [`Data`].
    pub const DATA: Self = Self(0x15);
    /// [`DataFrag`].
    pub const DATA_FRAG: Self = Self(0x16);

    /// Whether a length of 0 means just that.
    pub(super) fn may_be_empty(self) -> bool {
        matches!(self, Self::PAD | Self::INFO_TS)
    }
}

/// One submessage, borrowing its payload from the datagram.
#[derive(Clone, Debug, PartialEq)]
pub enum Submessage<'a> {
    /// What a reliable reader has and lacks.
    AckNack(AckNack),
    /// A change.
    Data(Data<'a>),
    /// Fragments of a change.
    DataFrag(DataFrag<'a>),
    /// Changes that will not come.
    Gap(Gap),
    /// What a reliable writer has.
    Heartbeat(Heartbeat),
    /// What a reliable writer has of a fragmented change.
    HeartbeatFrag(HeartbeatFrag),
    /// The participant that what follows is for.
    InfoDestination(GuidPrefix),
    /// The participant that what follows comes from.
    InfoSource(GuidPrefix),
    /// The source timestamp of what follows, or none.
    InfoTimestamp(Option<Timestamp>),
    /// The fragments that a reliable reader lacks.
    NackFrag(NackFrag),
    /// Padding, or a kind that we don't know or use: to be skipped.
    Skipped(SubmessageKind),
}

impl<'a> Submessage<'a> {
    /// The endpoint that it comes from, where it comes from one.
    pub fn sender(&self) -> Option<EntityId> {
        match self {
            Self::AckNack(acknack) => Some(acknack.reader),
            Self::Data(data) => Some(data.writer),
            Self::DataFrag(data) => Some(data.writer),
            Self::Gap(gap) => Some(gap.writer),
            Self::Heartbeat(heartbeat) => Some(heartbeat.writer),
            Self::HeartbeatFrag(heartbeat) => Some(heartbeat.writer),
            Self::NackFrag(nack) => Some(nack.reader),
            Self::InfoDestination(_)
            | Self::InfoSource(_)
            | Self::InfoTimestamp(_)
            | Self::Skipped(_) => None,
        }
    }

    /// What most submessages are comes first, and in line: the others' decoders would only be in its way.
    #[inline]
    pub(super) fn decode(
        kind: SubmessageKind,
        flags: u8,
        body: &'a [u8],
    ) -> Result<Self, WireError> {
        let mut cursor = Cursor::new(body, Endianness::from_flags(flags));
        match kind {
            SubmessageKind::DATA => Ok(Self::Data(Data::decode(flags, &mut cursor)?)),
            SubmessageKind::DATA_FRAG => Ok(Self::DataFrag(DataFrag::decode(flags, &mut cursor)?)),
            SubmessageKind::INFO_TS => Ok(Self::InfoTimestamp(info::decode_timestamp(
                flags,
                &mut cursor,
            )?)),
            _ => Self::decode_rare(kind, flags, cursor),
        }
    }

    fn decode_rare(
        kind: SubmessageKind,
        flags: u8,
        mut cursor: Cursor<'a>,
    ) -> Result<Self, WireError> {
        Ok(match kind {
            SubmessageKind::ACKNACK => Self::AckNack(AckNack::decode(flags, &mut cursor)?),
            SubmessageKind::HEARTBEAT => Self::Heartbeat(Heartbeat::decode(flags, &mut cursor)?),
            SubmessageKind::GAP => Self::Gap(Gap::decode(&mut cursor)?),
            SubmessageKind::INFO_SRC => Self::InfoSource(info::decode_source(&mut cursor)?),
            SubmessageKind::INFO_DST => Self::InfoDestination(GuidPrefix(cursor.array()?)),
            SubmessageKind::NACK_FRAG => Self::NackFrag(NackFrag::decode(&mut cursor)?),
            SubmessageKind::HEARTBEAT_FRAG => {
                Self::HeartbeatFrag(HeartbeatFrag::decode(&mut cursor)?)
            }
            other => Self::Skipped(other),
        })
    }
}
