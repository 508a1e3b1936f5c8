//! The typed serialization of samples: Extended CDR, DDS-XTypes 1.3 section 7.4.
//!
//! Version 1 (CDR, and PL_CDR for mutable types) and version 2 (PLAIN_CDR2, DELIMITED_CDR2 and
//! PL_CDR2) are written little endian and read in either byte order.
//!
//! A type gets its encoding from `#[derive(DdsType)]`. [`to_payload`] and [`from_payload`] are what
//! writers and readers call; [`key_payload`], [`from_key_payload`] and [`key_hash`] treat the key
//! alone. [`Encoder`] and [`Decoder`] serve whoever implements [`CdrType`] by hand.
//!
//! ```
//! use rtps_socket::DdsType;
//! use rtps_socket::cdr::{Representation, from_payload, to_payload};
//!
//! #[derive(Debug, PartialEq, DdsType)]
//! struct Reading {
//!     #[dds(key)]
//!     sensor: u32,
//!     celsius: f64,
//! }
//!
//! let reading = Reading { sensor: 7, celsius: 21.5 };
//! let mut payload = Vec::new();
//! to_payload(&reading, Representation::Xcdr1, &mut payload)?;
//! assert_eq!(from_payload::<Reading>(&payload)?, reading);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Decoding trusts nothing: every read is bounded, a count is compared with the bytes that are
//! there before memory is reserved for it, and nesting is limited to [`MAX_DEPTH`].

mod collections;
mod decoder;
mod encoder;
mod error;
mod fields;
mod inheritance;
mod key;
mod members;
mod payload;
mod primitives;
mod types;
mod wide;

#[cfg(test)]
mod tests;

pub use decoder::{Decoder, MemberDecoder, MemberHeader};
pub use encoder::{Encoder, MemberEncoder};
pub use error::{BoundExceeded, DecodeError, EncodeError};
pub use fields::member_type;
pub use inheritance::{MemberIds, Struct};
pub use key::{KeySize, key_hash};
pub use members::{Bounded, Member, MemberInfo, check_bound, is_beyond, trim};
pub use payload::{
    Encapsulation, Representation, from_key_payload, from_payload, key_payload, to_payload,
};
pub use rtps_user::filter::{FieldType, Fields, Kind, Value};
pub use rtps_user::xtypes::{
    Bitfield, Bitflag, Definition, Extensibility, Literal, StructMember, TryConstruct, TypeBuilder,
    TypeKind, TypePair, TypeSupport, UnionMember,
};
pub use types::{ByteOrder, CdrType, DdsType, LengthCode, Scope, min_struct_size};
pub use wide::{LongDouble, WChar, WString};

/// How deep aggregated types may nest in one sample, in both directions.
///
/// Only recursive types can come near it. Without a limit a small sample could exhaust the stack.
pub const MAX_DEPTH: u8 = 64;
