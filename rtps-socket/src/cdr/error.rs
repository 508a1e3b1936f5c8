//! What can go wrong when a sample is encoded or decoded.

use thiserror::Error;

use super::Extensibility;

/// A string, sequence or map is longer than the bound that its member declares.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("member `{member}` has {len} elements but its type allows at most {bound}")]
pub struct BoundExceeded {
    /// Name of the member as declared.
    pub member: &'static str,
    /// Length found: bytes of a string without its NUL, elements of a sequence or map.
    pub len: usize,
    /// Length allowed.
    pub bound: usize,
}

/// Why a sample cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// A bounded member is too long.
    #[error(transparent)]
    BoundExceeded(#[from] BoundExceeded),
    /// CDR counts in 32 bits.
    #[error("{0} elements or bytes do not fit a 32-bit length")]
    TooLong(usize),
    /// A `char` is an 8-bit character in IDL.
    #[error("the character {0:?} does not fit the 8 bits of an IDL char; use a String")]
    CharOutOfRange(char),
    /// A `wchar` is one UTF-16 unit.
    #[error("the character {0:?} does not fit the 16 bits of an IDL wchar; use a WString")]
    WCharOutOfRange(char),
    /// A bitset's field has a value of more bits.
    #[error("the value of `{member}` takes more than its {bits} bits")]
    BitsExceeded {
        /// Name of the field as declared.
        member: &'static str,
        /// Its bits.
        bits: u8,
    },
    /// IDL strings end at their first NUL.
    #[error("a string holds a NUL character, which IDL strings cannot carry")]
    NulInString,
    /// More levels than [`MAX_DEPTH`](super::MAX_DEPTH).
    #[error("the value nests deeper than {} levels", super::MAX_DEPTH)]
    TooDeep,
}

/// Why a serialized payload is not a value of the type.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The payload, or the enclosing delimited object, ends too early.
    #[error("{needed} bytes are needed where {remaining} remain")]
    UnexpectedEnd {
        /// Bytes that the next object takes.
        needed: usize,
        /// Bytes left.
        remaining: usize,
    },
    /// A count that what remains cannot hold.
    #[error("a collection claims {count} elements but {remaining} bytes remain")]
    CountTooLarge {
        /// Elements claimed.
        count: u32,
        /// Bytes left.
        remaining: usize,
    },
    /// A bounded member is too long.
    #[error(transparent)]
    BoundExceeded(#[from] BoundExceeded),
    /// A boolean is 0 or 1.
    #[error("{0} is not a boolean")]
    InvalidBool(u8),
    /// No literal has this value.
    #[error("{value} is no literal of the enumeration {type_name}")]
    InvalidEnum {
        /// The enumeration.
        type_name: &'static str,
        /// The value received.
        value: i64,
    },
    /// No case of the union has this discriminator and it has no default.
    #[error("{value} selects no member of the union {type_name}")]
    UnknownDiscriminator {
        /// The union.
        type_name: &'static str,
        /// The value received.
        value: i128,
    },
    /// A string has no NUL at its end, or one before it.
    #[error("a string is not ended by its only NUL")]
    InvalidString,
    /// A string is not UTF-8.
    #[error("a string is not valid UTF-8")]
    InvalidUtf8,
    /// A wide string is not UTF-16, or has a NUL.
    #[error("a wide string is not valid UTF-16 without a NUL")]
    InvalidWString,
    /// A key member, or one that must be there, is absent.
    #[error("member `{member}` is missing")]
    MissingMember {
        /// Name of the member as declared.
        member: &'static str,
    },
    /// The sender says that a member must be understood which the type does not have.
    #[error("member id {id} must be understood but the type has no such member")]
    NotUnderstood {
        /// The member's id.
        id: u32,
    },
    /// A parameter header that XTypes 7.4.1.2 does not allow here.
    #[error("invalid member header: {0:#06x}")]
    InvalidMemberHeader(u32),
    /// More levels than [`MAX_DEPTH`](super::MAX_DEPTH).
    #[error("the payload nests deeper than {} levels", super::MAX_DEPTH)]
    TooDeep,
    /// The encapsulation is none of CDR, PL_CDR, CDR2, D_CDR2 and PL_CDR2.
    #[error("representation identifier {0:#06x} is not supported")]
    UnknownEncapsulation(u16),
    /// The encapsulation is not the one that belongs to the type's extensibility.
    #[error(
        "representation identifier {id:#06x} does not fit {extensibility:?} types: declare the \
         type's extensibility as the writer's"
    )]
    EncapsulationMismatch {
        /// The identifier received.
        id: u16,
        /// Extensibility of the type here.
        extensibility: Extensibility,
    },
}

impl DecodeError {
    /// Whether the bytes are well-formed but no value of the type, which a member may survive (XTypes 7.2.2.7).
    pub(super) const fn is_about_value(&self) -> bool {
        matches!(
            self,
            Self::BoundExceeded(_)
                | Self::InvalidBool(_)
                | Self::InvalidEnum { .. }
                | Self::UnknownDiscriminator { .. }
                | Self::InvalidString
                | Self::InvalidUtf8
                | Self::InvalidWString
        )
    }
}
