//! Serialized payloads: the encapsulation header of RTPS 2.5 section 10.2 and what follows it.

use rtps_user::writer::BareKey;

use super::{ByteOrder, DdsType, DecodeError, Decoder, EncodeError, Encoder, Extensibility, Scope};

/// Representation identifier and options.
const HEADER_SIZE: usize = 4;

/// The low bits of the options tell how many bytes of padding end the payload (XTypes 7.6.3.1.2).
const PADDING_MASK: u8 = 3;

/// Fast DDS 2 takes a serialized key of at most 16 bytes, encapsulation header and all, for the key hash, and
/// then ends an instance that nobody knows. Readers of CDR leave alone what follows a key.
const SHORTEST_KEY_PAYLOAD: usize = 20;

/// A version of Extended CDR, as the DATA_REPRESENTATION policy names it (XTypes 7.6.3.1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Representation {
    /// Version 1: what every implementation reads.
    #[default]
    Xcdr1,
    /// Version 2.
    Xcdr2,
}

impl Representation {
    /// The DataRepresentationId_t.
    #[must_use]
    pub const fn id(self) -> i16 {
        match self {
            Self::Xcdr1 => 0,
            Self::Xcdr2 => 2,
        }
    }

    /// The representation with a DataRepresentationId_t; `None` for XML and unknown ones.
    #[must_use]
    pub const fn from_id(id: i16) -> Option<Self> {
        match id {
            0 => Some(Self::Xcdr1),
            2 => Some(Self::Xcdr2),
            _ => None,
        }
    }

    pub(super) const fn max_alignment(self) -> usize {
        match self {
            Self::Xcdr1 => 8,
            Self::Xcdr2 => 4,
        }
    }
}

/// What the representation identifier of a payload says (RTPS 2.5 table 10.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encapsulation {
    /// Version of Extended CDR.
    pub representation: Representation,
    /// Extensibility of the top-level type; CDR serves final and appendable types and is read as
    /// final.
    pub extensibility: Extensibility,
    /// Order of the bytes of primitives.
    pub byte_order: ByteOrder,
}

impl Encapsulation {
    /// The identifier.
    #[must_use]
    pub const fn id(self) -> u16 {
        let big_endian = match (self.representation, self.extensibility) {
            (Representation::Xcdr1, Extensibility::Final | Extensibility::Appendable) => 0x0000,
            (Representation::Xcdr1, Extensibility::Mutable) => 0x0002,
            (Representation::Xcdr2, Extensibility::Final) => 0x0006,
            (Representation::Xcdr2, Extensibility::Appendable) => 0x0008,
            (Representation::Xcdr2, Extensibility::Mutable) => 0x000a,
        };
        match self.byte_order {
            ByteOrder::Big => big_endian,
            ByteOrder::Little => big_endian + 1,
        }
    }

    /// Splits a payload into its encapsulation and the serialized data without padding.
    ///
    /// # Errors
    /// When the header is incomplete, unknown, or claims more padding than there are bytes.
    pub fn split(payload: &[u8]) -> Result<(Self, &[u8]), DecodeError> {
        let Some((&[high, low, _, options], data)) = payload.split_first_chunk::<HEADER_SIZE>()
        else {
            return Err(DecodeError::UnexpectedEnd {
                needed: HEADER_SIZE,
                remaining: payload.len(),
            });
        };
        let id = u16::from_be_bytes([high, low]);
        let (representation, extensibility) = match id & !1 {
            0x0000 => (Representation::Xcdr1, Extensibility::Final),
            0x0002 => (Representation::Xcdr1, Extensibility::Mutable),
            0x0006 => (Representation::Xcdr2, Extensibility::Final),
            0x0008 => (Representation::Xcdr2, Extensibility::Appendable),
            0x000a => (Representation::Xcdr2, Extensibility::Mutable),
            _ => return Err(DecodeError::UnknownEncapsulation(id)),
        };
        let byte_order = match id & 1 {
            0 => ByteOrder::Big,
            _ => ByteOrder::Little,
        };
        let padding = usize::from(options & PADDING_MASK);
        let end = data.len().checked_sub(padding);
        let data = end
            .and_then(|end| data.get(..end))
            .ok_or(DecodeError::UnexpectedEnd {
                needed: padding,
                remaining: data.len(),
            })?;
        let encapsulation = Self {
            representation,
            extensibility,
            byte_order,
        };
        Ok((encapsulation, data))
    }
}

/// Appends the serialized payload of `value`, little endian and padded to a multiple of 4 bytes.
///
/// # Errors
/// When the value exceeds what its type or CDR can carry; `out` is then as before.
pub fn to_payload<T: DdsType>(
    value: &T,
    representation: Representation,
    out: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    append_payload(value, representation, ByteOrder::Little, Scope::Sample, out)
}

/// Appends the serialized key of `value`, for a dispose or unregister, followed by zeros where it is
/// short; the header alone when the type has no key.
///
/// # Errors
/// When the key exceeds what its type or CDR can carry; `out` is then as before.
pub fn key_payload<T: DdsType>(
    value: &T,
    representation: Representation,
    out: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    let start = out.len();
    append_payload(value, representation, ByteOrder::Little, Scope::Key, out)?;
    if T::HAS_KEY {
        out.resize(out.len().max(start + SHORTEST_KEY_PAYLOAD), 0);
    }
    Ok(())
}

/// How serialized keys of `T` are sent to Cyclone DDS 0.10, which knows no DHEADERs in them; `None` where they have none.
pub(crate) fn bare_key_of<T: DdsType>(representation: Representation) -> Option<BareKey> {
    let has_headers = representation == Representation::Xcdr2;
    (T::HAS_KEY && has_headers).then_some(bare_key::<T>)
}

fn bare_key<T: DdsType>(payload: &[u8]) -> Option<Vec<u8>> {
    let key: T = read_payload(payload, Scope::Key).ok()?;
    let mut out = Vec::new();
    let (representation, byte_order) = (Representation::Xcdr2, ByteOrder::Little);
    append_payload(&key, representation, byte_order, Scope::KeyHash, &mut out).ok()?;
    Some(out)
}

/// Reads a serialized payload of any representation and byte order.
///
/// # Errors
/// When it is malformed, or not of the type.
pub fn from_payload<T: DdsType>(payload: &[u8]) -> Result<T, DecodeError> {
    read_payload(payload, Scope::Sample)
}

/// Reads a serialized key; members that are not part of the key have their defaults.
///
/// # Errors
/// When it is malformed, or not a key of the type.
pub fn from_key_payload<T: DdsType>(payload: &[u8]) -> Result<T, DecodeError> {
    read_payload(payload, Scope::Key)
}

pub(super) fn append_payload<T: DdsType>(
    value: &T,
    representation: Representation,
    byte_order: ByteOrder,
    scope: Scope,
    out: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    let encapsulation = Encapsulation {
        representation,
        extensibility: T::EXTENSIBILITY,
        byte_order,
    };
    let start = out.len();
    let [high, low] = encapsulation.id().to_be_bytes();
    out.extend_from_slice(&[high, low, 0, 0]);
    if scope == Scope::Sample || T::HAS_KEY {
        let mut encoder = Encoder::new(out, representation, byte_order, scope);
        if let Err(error) = value.encode(&mut encoder) {
            out.truncate(start);
            return Err(error);
        }
    }
    let padding = start.wrapping_sub(out.len()) & usize::from(PADDING_MASK);
    out.extend_from_slice(&[0; PADDING_MASK as usize][..padding]);
    out[start + HEADER_SIZE - 1] = padding as u8;
    Ok(())
}

fn read_payload<T: DdsType>(payload: &[u8], scope: Scope) -> Result<T, DecodeError> {
    let (encapsulation, data) = Encapsulation::split(payload)?;
    let expected = Encapsulation {
        extensibility: T::EXTENSIBILITY,
        ..encapsulation
    };
    if expected.id() != encapsulation.id() {
        return Err(DecodeError::EncapsulationMismatch {
            id: encapsulation.id(),
            extensibility: T::EXTENSIBILITY,
        });
    }
    if scope != Scope::Sample && !T::HAS_KEY {
        return Ok(T::default_value());
    }
    let Encapsulation {
        representation,
        byte_order,
        ..
    } = encapsulation;
    let decode = |scope| T::decode(&mut Decoder::new(data, representation, byte_order, scope));
    match (scope, representation) {
        // Cyclone DDS 0.10 leaves the DHEADERs out of keys. What it sends is none with them: a size that comes first
        // cannot be the first key, too, and fit what follows.
        (Scope::Key, Representation::Xcdr2) => {
            decode(scope).or_else(|error| decode(Scope::KeyHash).map_err(|_| error))
        }
        _ => decode(scope),
    }
}
