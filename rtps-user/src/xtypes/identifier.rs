//! TypeIdentifier: a type spelled out where that is short, or the hash of its TypeObject (XTypes 7.3.4.2).

use md5::{Digest, Md5};

use super::xcdr::{Reader, Writer};
use crate::wire::WireError;

/// Plain collections may hold each other this deep; deeper ones from the wire are refused.
const MAX_DEPTH: u8 = 16;
/// TryConstructKind DISCARD, the default of all members and elements.
pub(super) const TRY_CONSTRUCT_DISCARD: u16 = 1;

/// Which of its two descriptions names a type: one with names and annotations or one with only what decides about
/// assignability.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub enum Equivalence {
    /// EK_MINIMAL.
    Minimal,
    /// EK_COMPLETE.
    Complete,
}

impl Equivalence {
    pub(super) const fn octet(self) -> u8 {
        match self {
            Self::Minimal => 0xf1,
            Self::Complete => 0xf2,
        }
    }

    pub(super) const fn from_octet(octet: u8) -> Option<Self> {
        match octet {
            0xf1 => Some(Self::Minimal),
            0xf2 => Some(Self::Complete),
            _ => None,
        }
    }
}

/// EK_BOTH: the identifier is the same in both.
const BOTH: u8 = 0xf3;

/// The name of a TypeObject: its equivalence kind and the first 14 bytes of the MD5 of it in little-endian XCDR2.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct TypeHash {
    /// The kind of the TypeObject.
    pub equivalence: Equivalence,
    /// EquivalenceHash.
    pub hash: [u8; 14],
}

impl TypeHash {
    /// The name of a serialized TypeObject.
    pub fn of(equivalence: Equivalence, object: &[u8]) -> Self {
        let digest: [u8; 16] = Md5::digest(object).into();
        let mut hash = [0; 14];
        hash.copy_from_slice(&digest[..14]);
        Self { equivalence, hash }
    }
}

/// NameHash: what stands for a member's name in a minimal TypeObject.
pub(super) fn name_hash(name: &str) -> [u8; 4] {
    let [a, b, c, d, ..]: [u8; 16] = Md5::digest(name).into();
    [a, b, c, d]
}

/// TypeKind of a primitive type, as an octet.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct TypeKind(pub u8);

impl TypeKind {
    /// TK_NONE: no type.
    pub const NONE: Self = Self(0x00);
    /// TK_BOOLEAN.
    pub const BOOLEAN: Self = Self(0x01);
    /// TK_BYTE: an IDL `octet`.
    pub const BYTE: Self = Self(0x02);
    /// TK_INT16.
    pub const INT16: Self = Self(0x03);
    /// TK_INT32.
    pub const INT32: Self = Self(0x04);
    /// TK_INT64.
    pub const INT64: Self = Self(0x05);
    /// TK_UINT16.
    pub const UINT16: Self = Self(0x06);
    /// TK_UINT32.
    pub const UINT32: Self = Self(0x07);
    /// TK_UINT64.
    pub const UINT64: Self = Self(0x08);
    /// TK_FLOAT32.
    pub const FLOAT32: Self = Self(0x09);
    /// TK_FLOAT64.
    pub const FLOAT64: Self = Self(0x0a);
    /// TK_FLOAT128.
    pub const FLOAT128: Self = Self(0x0b);
    /// TK_INT8.
    pub const INT8: Self = Self(0x0c);
    /// TK_UINT8.
    pub const UINT8: Self = Self(0x0d);
    /// TK_CHAR8.
    pub const CHAR8: Self = Self(0x10);
    /// TK_CHAR16.
    pub const CHAR16: Self = Self(0x11);
    /// The last of the octets that stand for primitive types.
    const LAST: u8 = 0x11;

    /// XTypes 1.3 added kinds to those of 1.2.
    const fn is_known_to_cyclone_0_10(self) -> bool {
        matches!(self.0, 0x01..=0x0b | 0x10 | 0x11)
    }
}

/// Names or describes a type.
#[derive(Clone, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub enum TypeIdentifier {
    /// A primitive type, or none.
    Primitive(TypeKind),
    /// A string.
    String {
        /// Of 16-bit characters.
        wide: bool,
        /// The most characters; 0 without bound.
        bound: u32,
    },
    /// A sequence.
    Sequence {
        /// Of what.
        element: Box<Self>,
        /// The most elements; 0 without bound.
        bound: u32,
    },
    /// An array.
    Array {
        /// Of what.
        element: Box<Self>,
        /// The size of each dimension.
        bounds: Vec<u32>,
    },
    /// A map.
    Map {
        /// From what.
        key: Box<Self>,
        /// To what.
        element: Box<Self>,
        /// The most entries; 0 without bound.
        bound: u32,
    },
    /// A type that needs a TypeObject.
    Hash(TypeHash),
    /// One of several types that refer to each other; this implementation does not look into those.
    Component {
        /// The hash of all of them together.
        hash: TypeHash,
        /// How many they are.
        len: i32,
        /// Which one it is.
        index: i32,
    },
}

const STRING8_SMALL: u8 = 0x70;
const STRING8_LARGE: u8 = 0x71;
const STRING16_SMALL: u8 = 0x72;
const STRING16_LARGE: u8 = 0x73;
const SEQUENCE_SMALL: u8 = 0x80;
const SEQUENCE_LARGE: u8 = 0x81;
const ARRAY_SMALL: u8 = 0x90;
const ARRAY_LARGE: u8 = 0x91;
const MAP_SMALL: u8 = 0xa0;
const MAP_LARGE: u8 = 0xa1;
const COMPONENT: u8 = 0xb0;

impl TypeIdentifier {
    /// The hash, where it is one.
    pub fn hash(&self) -> Option<TypeHash> {
        match self {
            Self::Hash(hash) => Some(*hash),
            _ => None,
        }
    }

    /// The same with TK_UINT8 for TK_BYTE.
    pub(super) fn uint8(self) -> Self {
        match self {
            Self::Primitive(TypeKind::BYTE) => Self::Primitive(TypeKind::UINT8),
            Self::Sequence { element, bound } => Self::Sequence {
                element: Box::new(element.uint8()),
                bound,
            },
            Self::Array { element, bounds } => Self::Array {
                element: Box::new(element.uint8()),
                bounds,
            },
            Self::Map {
                key,
                element,
                bound,
            } => Self::Map {
                key: Box::new(key.uint8()),
                element: Box::new(element.uint8()),
                bound,
            },
            other => other,
        }
    }

    /// Whether Cyclone DDS 0.10 can take it: of others in a TypeObject it makes null pointers, which it follows.
    pub(super) fn is_known_to_cyclone_0_10(&self) -> bool {
        match self {
            Self::Primitive(kind) => kind.is_known_to_cyclone_0_10(),
            Self::String { wide, .. } => !wide,
            Self::Sequence { element, .. } | Self::Array { element, .. } => {
                element.is_known_to_cyclone_0_10()
            }
            Self::Map { key, element, .. } => {
                key.is_known_to_cyclone_0_10() && element.is_known_to_cyclone_0_10()
            }
            Self::Hash(_) => true,
            Self::Component { .. } => false,
        }
    }

    /// Adds the hashes that are in it.
    pub(super) fn add_hashes(&self, hashes: &mut Vec<TypeHash>) {
        match self {
            Self::Hash(hash) => hashes.push(*hash),
            Self::Sequence { element, .. } | Self::Array { element, .. } => {
                element.add_hashes(hashes);
            }
            Self::Map { key, element, .. } => {
                key.add_hashes(hashes);
                element.add_hashes(hashes);
            }
            Self::Primitive(_) | Self::String { .. } | Self::Component { .. } => {}
        }
    }

    /// The equivalence kind of a plain collection's header.
    fn equivalence(&self) -> u8 {
        match self {
            Self::Primitive(_) | Self::String { .. } => BOTH,
            Self::Sequence { element, .. } | Self::Array { element, .. } => element.equivalence(),
            Self::Map { key, element, .. } => key.equivalence().min(element.equivalence()),
            Self::Hash(hash) | Self::Component { hash, .. } => hash.equivalence.octet(),
        }
    }

    pub(super) fn write(&self, w: &mut Writer) {
        match self {
            Self::Primitive(kind) => w.u8(kind.0),
            Self::String { wide, bound } => {
                let kinds = match wide {
                    false => [STRING8_SMALL, STRING8_LARGE],
                    true => [STRING16_SMALL, STRING16_LARGE],
                };
                write_bound(w, kinds, *bound, |_| ());
            }
            Self::Sequence { element, bound } => {
                let header = |w: &mut Writer| write_header(w, element.equivalence());
                write_bound(w, [SEQUENCE_SMALL, SEQUENCE_LARGE], *bound, header);
                element.write(w);
            }
            Self::Array { element, bounds } => {
                write_array_bounds(w, element.equivalence(), bounds);
                element.write(w);
            }
            Self::Map {
                key,
                element,
                bound,
            } => {
                let header = |w: &mut Writer| write_header(w, self.equivalence());
                write_bound(w, [MAP_SMALL, MAP_LARGE], *bound, header);
                element.write(w);
                w.u16(TRY_CONSTRUCT_DISCARD);
                key.write(w);
            }
            Self::Hash(hash) => write_hash(w, hash),
            Self::Component { hash, len, index } => {
                w.u8(COMPONENT);
                w.delimited(|w| {
                    write_hash(w, hash);
                    w.i32(*len);
                    w.i32(*index);
                });
            }
        }
    }

    pub(super) fn read(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Self::read_at(r, MAX_DEPTH)
    }

    fn read_at(r: &mut Reader<'_>, depth: u8) -> Result<Self, WireError> {
        let depth = depth.checked_sub(1).ok_or(WireError::InvalidData)?;
        let kind = r.u8()?;
        Ok(match kind {
            0..=TypeKind::LAST => Self::Primitive(TypeKind(kind)),
            STRING8_SMALL | STRING16_SMALL | STRING8_LARGE | STRING16_LARGE => Self::String {
                wide: kind >= STRING16_SMALL,
                bound: read_bound(r, kind)?,
            },
            SEQUENCE_SMALL | SEQUENCE_LARGE => {
                read_header(r)?;
                let bound = read_bound(r, kind)?;
                let element = Box::new(Self::read_at(r, depth)?);
                Self::Sequence { element, bound }
            }
            ARRAY_SMALL | ARRAY_LARGE => {
                read_header(r)?;
                let bounds = read_array_bounds(r, kind)?;
                let element = Box::new(Self::read_at(r, depth)?);
                Self::Array { element, bounds }
            }
            MAP_SMALL | MAP_LARGE => {
                read_header(r)?;
                let bound = read_bound(r, kind)?;
                let element = Box::new(Self::read_at(r, depth)?);
                r.u16()?;
                let key = Box::new(Self::read_at(r, depth)?);
                Self::Map {
                    key,
                    element,
                    bound,
                }
            }
            COMPONENT => r.delimited(|r| {
                let kind = r.u8()?;
                Ok(Self::Component {
                    hash: read_hash(r, kind)?,
                    len: r.i32()?,
                    index: r.i32()?,
                })
            })?,
            _ => Self::Hash(read_hash(r, kind)?),
        })
    }
}

/// A large kind, with a bound of 32 bits, is the small one plus 1.
fn write_bound(w: &mut Writer, kinds: [u8; 2], bound: u32, header: impl FnOnce(&mut Writer)) {
    let [small, large] = kinds;
    if let Ok(bound) = u8::try_from(bound) {
        w.u8(small);
        header(w);
        w.u8(bound);
    } else {
        w.u8(large);
        header(w);
        w.u32(bound);
    }
}

fn read_bound(r: &mut Reader<'_>, kind: u8) -> Result<u32, WireError> {
    match is_large(kind) {
        true => r.u32(),
        false => Ok(r.u8()?.into()),
    }
}

fn is_large(kind: u8) -> bool {
    kind & 1 == 1
}

fn write_array_bounds(w: &mut Writer, equivalence: u8, bounds: &[u32]) {
    let small: Result<Vec<u8>, _> = bounds.iter().map(|bound| u8::try_from(*bound)).collect();
    w.u8(if small.is_ok() {
        ARRAY_SMALL
    } else {
        ARRAY_LARGE
    });
    write_header(w, equivalence);
    w.len(bounds.len());
    match small {
        Ok(small) => w.bytes(&small),
        Err(_) => bounds.iter().for_each(|bound| w.u32(*bound)),
    }
}

fn read_array_bounds(r: &mut Reader<'_>, kind: u8) -> Result<Vec<u32>, WireError> {
    if !is_large(kind) {
        return Ok(r.octets()?.iter().map(|bound| u32::from(*bound)).collect());
    }
    read_u32_sequence(r)
}

/// A sequence of 32-bit numbers.
pub(super) fn read_u32_sequence(r: &mut Reader<'_>) -> Result<Vec<u32>, WireError> {
    let mut numbers = Vec::new();
    for _ in 0..r.u32()? {
        numbers.push(r.u32()?);
    }
    Ok(numbers)
}

fn write_header(w: &mut Writer, equivalence: u8) {
    w.u8(equivalence);
    w.u16(TRY_CONSTRUCT_DISCARD);
}

fn read_header(r: &mut Reader<'_>) -> Result<(), WireError> {
    r.u8()?;
    r.u16().map(drop)
}

fn write_hash(w: &mut Writer, hash: &TypeHash) {
    w.u8(hash.equivalence.octet());
    w.bytes(&hash.hash);
}

fn read_hash(r: &mut Reader<'_>, kind: u8) -> Result<TypeHash, WireError> {
    Ok(TypeHash {
        equivalence: Equivalence::from_octet(kind).ok_or(WireError::InvalidData)?,
        hash: r.array()?,
    })
}
