//! The wire format of RTPS 2.5: what chapter 9 (the UDP/IP platform-specific model) writes into a datagram.
//!
//! Two levels. Values ([`Guid`], [`SequenceNumber`], [`Locator`], ...) each have a file. A message is read by
//! [`MessageReceiver`], which follows the interpreter submessages (INFO_DST, INFO_SRC, INFO_TS) and yields the
//! rest as [`Submessage`]s that borrow from the datagram, and written by [`MessageWriter`], which appends to a
//! buffer. Nothing here allocates or loops by a number that came from the wire.

mod cursor;
mod error;
mod guid;
mod locator;
mod message;
mod parameter_list;
mod receiver;
mod sequence_number;
mod submessage;
mod time;
mod writer;

pub use cursor::{Cursor, Endianness};
pub use error::WireError;
pub use guid::{EntityId, EntityKind, Guid, GuidPrefix, VendorId};
pub use locator::{Locator, LocatorKind};
pub use message::{
    HEADER_LEN, Header, PROTOCOL_VERSION, ProtocolVersion, SUBMESSAGE_HEADER_LEN, Submessages,
};
pub use parameter_list::{Parameter, ParameterId, ParameterList, ParameterWriter};
pub use receiver::{MessageReceiver, Received};
pub use sequence_number::{FragmentNumberSet, SequenceNumber, SequenceNumberSet};
pub use submessage::{
    AckNack, ContentFilterInfo, Data, DataFrag, FilterSignature, Gap, GroupDigest, Heartbeat,
    HeartbeatFrag, HeartbeatGroup, InlineQos, KeyHash, NackFrag, PayloadKind, StatusInfo,
    Submessage, SubmessageKind,
};
pub use time::{Duration, Timestamp};
pub use writer::{DataFragment, MessageWriter};
