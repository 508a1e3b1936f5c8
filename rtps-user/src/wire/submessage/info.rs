//! The interpreter submessages: INFO_TS and INFO_SRC (RTPS 2.5 sections 9.4.5.10 and 9.4.5.11). INFO_DST is
//! just a GUID prefix; INFO_REPLY is skipped, because we answer to the locators that discovery announced.

use crate::wire::{Cursor, GuidPrefix, Timestamp, WireError};

const FLAG_INVALIDATE: u8 = 0x02;

/// `None` when the flag says that what follows has no timestamp.
pub(super) fn decode_timestamp(
    flags: u8,
    cursor: &mut Cursor<'_>,
) -> Result<Option<Timestamp>, WireError> {
    if flags & FLAG_INVALIDATE != 0 {
        return Ok(None);
    }
    Timestamp::decode(cursor).map(Some)
}

/// The prefix that follows 4 unused bytes, a version and a vendor.
pub(super) fn decode_source(cursor: &mut Cursor<'_>) -> Result<GuidPrefix, WireError> {
    cursor.take(8)?;
    Ok(GuidPrefix(cursor.array()?))
}
