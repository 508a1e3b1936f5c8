//! Reading minimal TypeObjects: all that assignability depends on.

use super::definition::{TK_ALIAS, TK_BITMASK, TK_ENUM, TK_STRUCTURE, TK_UNION};
use super::identifier::{Equivalence, TypeHash, TypeIdentifier, TypeKind, read_u32_sequence};
use super::xcdr::Reader;
use crate::wire::{Endianness, WireError};

/// A constructed type without names.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) enum MinimalType {
    Struct(StructType),
    Union(UnionType),
    Enum(EnumType),
    /// A set of so many flags.
    Bitmask {
        bit_bound: u16,
    },
    /// Another name of a type; a collection with a TypeObject of its own is one of the plain collection.
    Alias(TypeIdentifier),
    /// What is not looked into.
    Opaque,
}

#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct StructType {
    pub(super) flags: u16,
    pub(super) base: TypeIdentifier,
    pub(super) members: Vec<Member>,
}

#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct UnionType {
    pub(super) flags: u16,
    pub(super) discriminator: TypeIdentifier,
    pub(super) members: Vec<Member>,
}

#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct EnumType {
    pub(super) flags: u16,
    pub(super) bit_bound: u16,
    /// Value and name.
    pub(super) literals: Vec<(i32, [u8; 4])>,
}

/// A member of a struct or union.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct Member {
    pub(super) id: u32,
    pub(super) flags: u16,
    pub(super) type_id: TypeIdentifier,
    /// The values that select it, in a union.
    pub(super) labels: Vec<i32>,
    pub(super) name: [u8; 4],
}

const TK_SEQUENCE: u8 = 0x60;
const TK_ARRAY: u8 = 0x61;
const TK_MAP: u8 = 0x62;

impl MinimalType {
    /// Reads a serialized TypeObject in little-endian XCDR2.
    pub(super) fn decode(object: &[u8]) -> Result<Self, WireError> {
        Reader::new(object, Endianness::Little).delimited(|r| {
            if r.u8()? != Equivalence::Minimal.octet() {
                return Err(WireError::InvalidData);
            }
            match r.u8()? {
                TK_STRUCTURE => read_struct(r),
                TK_UNION => read_union(r),
                TK_ENUM => read_enum(r),
                TK_BITMASK => r.delimited(|r| {
                    r.u16()?;
                    let bit_bound = r.delimited(Reader::u16)?;
                    Ok(Self::Bitmask { bit_bound })
                }),
                TK_ALIAS => {
                    r.u16()?;
                    r.delimited(|_| Ok(()))?;
                    r.delimited(read_element).map(Self::Alias)
                }
                TK_SEQUENCE => {
                    let bound = read_bound(r)?;
                    let element = Box::new(r.delimited(read_element)?);
                    Ok(Self::Alias(TypeIdentifier::Sequence { element, bound }))
                }
                TK_ARRAY => {
                    r.u16()?;
                    let bounds = r.delimited(read_u32_sequence)?;
                    let element = Box::new(r.delimited(read_element)?);
                    Ok(Self::Alias(TypeIdentifier::Array { element, bounds }))
                }
                TK_MAP => read_map(r),
                _ => Ok(Self::Opaque),
            }
        })
    }
}

impl MinimalType {
    /// Whether Cyclone DDS 0.10 survives it.
    pub(super) fn is_known_to_cyclone_0_10(&self) -> bool {
        let known = TypeIdentifier::is_known_to_cyclone_0_10;
        let all = |members: &[Member]| members.iter().all(|member| known(&member.type_id));
        match self {
            Self::Struct(of) => {
                let has_base = of.base != TypeIdentifier::Primitive(TypeKind::NONE);
                (!has_base || known(&of.base)) && all(&of.members)
            }
            Self::Union(of) => known(&of.discriminator) && all(&of.members),
            Self::Alias(identifier) => known(identifier),
            // It takes the last but one of the literals without a look at how many there are.
            Self::Enum(of) => !of.literals.is_empty(),
            Self::Bitmask { .. } | Self::Opaque => false,
        }
    }

    /// The types with TypeObjects that it refers to.
    pub(super) fn uses(&self) -> Vec<TypeHash> {
        let mut used = Vec::new();
        let (first, members) = match self {
            Self::Struct(of) => (&of.base, of.members.as_slice()),
            Self::Union(of) => (&of.discriminator, of.members.as_slice()),
            Self::Alias(identifier) => (identifier, [].as_slice()),
            Self::Enum(_) | Self::Bitmask { .. } | Self::Opaque => return used,
        };
        first.add_hashes(&mut used);
        for member in members {
            member.type_id.add_hashes(&mut used);
        }
        used
    }
}

fn read_struct(r: &mut Reader<'_>) -> Result<MinimalType, WireError> {
    Ok(MinimalType::Struct(StructType {
        flags: r.u16()?,
        base: r.delimited(TypeIdentifier::read)?,
        members: r.sequence(|r| read_member(r, |_| Ok(Vec::new())))?,
    }))
}

fn read_union(r: &mut Reader<'_>) -> Result<MinimalType, WireError> {
    let flags = r.u16()?;
    r.delimited(|_| Ok(()))?;
    Ok(MinimalType::Union(UnionType {
        flags,
        discriminator: r.delimited(read_element)?,
        members: r.sequence(|r| {
            read_member(r, |r| {
                let labels = read_u32_sequence(r)?;
                Ok(labels.into_iter().map(u32::cast_signed).collect())
            })
        })?,
    }))
}

fn read_enum(r: &mut Reader<'_>) -> Result<MinimalType, WireError> {
    Ok(MinimalType::Enum(EnumType {
        flags: r.u16()?,
        bit_bound: r.delimited(Reader::u16)?,
        literals: r.sequence(|r| {
            r.delimited(|r| {
                let value = r.delimited(Reader::i32)?;
                Ok((value, r.array()?))
            })
        })?,
    }))
}

fn read_map(r: &mut Reader<'_>) -> Result<MinimalType, WireError> {
    let bound = read_bound(r)?;
    let key = Box::new(r.delimited(read_element)?);
    let element = Box::new(r.delimited(read_element)?);
    Ok(MinimalType::Alias(TypeIdentifier::Map {
        key,
        element,
        bound,
    }))
}

fn read_member(
    r: &mut Reader<'_>,
    labels: impl FnOnce(&mut Reader<'_>) -> Result<Vec<i32>, WireError>,
) -> Result<Member, WireError> {
    r.delimited(|r| {
        Ok(Member {
            id: r.u32()?,
            flags: r.u16()?,
            type_id: TypeIdentifier::read(r)?,
            labels: labels(r)?,
            name: r.array()?,
        })
    })
}

/// Flags, and the type that they are about.
fn read_element(r: &mut Reader<'_>) -> Result<TypeIdentifier, WireError> {
    r.u16()?;
    TypeIdentifier::read(r)
}

/// Unused flags, and the header with the bound.
fn read_bound(r: &mut Reader<'_>) -> Result<u32, WireError> {
    r.u16()?;
    r.delimited(Reader::u32)
}
