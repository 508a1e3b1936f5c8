//! A message: its header and the list of its submessages (RTPS 2.5 sections 9.4.4 and 9.4.5.1).

use serde::{Deserialize, Serialize};

use super::{Cursor, Endianness, GuidPrefix, Submessage, SubmessageKind, VendorId, WireError};

/// Bytes of the message header.
pub const HEADER_LEN: usize = 20;
/// Bytes of a submessage header.
pub const SUBMESSAGE_HEADER_LEN: usize = 4;
/// What we speak.
pub const PROTOCOL_VERSION: ProtocolVersion = ProtocolVersion { major: 2, minor: 5 };

const MAGIC: [u8; 4] = *b"RTPS";

/// ProtocolVersion_t.
#[derive(Clone, Copy, Debug, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub struct ProtocolVersion {
    /// Only 2 is understood.
    pub major: u8,
    /// Any is understood: minor versions are compatible.
    pub minor: u8,
}

/// The header of a message.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Header {
    /// The sender's protocol version.
    pub version: ProtocolVersion,
    /// The sender's implementation.
    pub vendor: VendorId,
    /// The sender's participant.
    pub prefix: GuidPrefix,
}

impl Header {
    /// Reads and checks a header.
    pub fn decode(cursor: &mut Cursor<'_>) -> Result<Self, WireError> {
        if cursor.array::<4>()? != MAGIC {
            return Err(WireError::NotRtps);
        }
        let [major, minor] = cursor.array()?;
        if major != PROTOCOL_VERSION.major {
            return Err(WireError::UnsupportedVersion(major));
        }
        Ok(Self {
            version: ProtocolVersion { major, minor },
            vendor: VendorId(cursor.array()?),
            prefix: GuidPrefix(cursor.array()?),
        })
    }

    /// Writes the header of a message of ours.
    pub fn encode(prefix: GuidPrefix, out: &mut Vec<u8>) {
        out.extend_from_slice(&MAGIC);
        out.extend_from_slice(&[PROTOCOL_VERSION.major, PROTOCOL_VERSION.minor]);
        out.extend_from_slice(&VendorId::UNKNOWN.0);
        out.extend_from_slice(&prefix.0);
    }
}

/// The submessages of a message, in order; ends after the first malformed one, because what follows it cannot
/// be trusted, while what preceded it stays valid (RTPS 8.3.4.1).
#[derive(Clone, Debug)]
pub struct Submessages<'a> {
    rest: &'a [u8],
}

impl<'a> Submessages<'a> {
    /// Splits a datagram into header and submessages.
    pub fn parse(message: &'a [u8]) -> Result<(Header, Self), WireError> {
        let mut cursor = Cursor::new(message, Endianness::Big);
        let header = Header::decode(&mut cursor)?;
        Ok((
            header,
            Self {
                rest: cursor.rest(),
            },
        ))
    }

    #[inline]
    fn decode_next(&mut self) -> Result<Submessage<'a>, WireError> {
        let (&[kind, flags, first, second], body) = self
            .rest
            .split_first_chunk::<SUBMESSAGE_HEADER_LEN>()
            .ok_or(WireError::UnexpectedEnd)?;
        let length = match Endianness::from_flags(flags) {
            Endianness::Big => u16::from_be_bytes([first, second]),
            Endianness::Little => u16::from_le_bytes([first, second]),
        };
        let kind = SubmessageKind(kind);
        // A length of 0 means "to the end of the message", except for submessages that can be empty.
        let to_the_end = length == 0 && !kind.may_be_empty();
        let length = if to_the_end {
            body.len()
        } else {
            usize::from(length)
        };
        let (body, rest) = body
            .split_at_checked(length)
            .ok_or(WireError::SubmessageTooLong)?;
        self.rest = rest;
        Submessage::decode(kind, flags, body)
    }
}

impl<'a> Iterator for Submessages<'a> {
    type Item = Result<Submessage<'a>, WireError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let submessage = self.decode_next();
        if submessage.is_err() {
            self.rest = &[];
        }
        Some(submessage)
    }
}
