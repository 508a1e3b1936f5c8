//! TypeInformation: what an endpoint's announcement says of its type (XTypes 7.6.3.2.1).

use super::identifier::{Equivalence, TypeIdentifier};
use super::xcdr::{Reader, Writer};
use crate::wire::{Endianness, WireError};

const MINIMAL: u32 = 0x1001;
const COMPLETE: u32 = 0x1002;

/// The type of an endpoint in both of its descriptions.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct TypeInformation {
    /// The minimal one.
    pub minimal: Dependencies,
    /// The complete one.
    pub complete: Dependencies,
}

/// TypeIdentifierWithDependencies: a type and those that it uses, directly or not.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Dependencies {
    /// The type.
    pub type_id: TypeIdentifier,
    /// The size of its TypeObject, serialized.
    pub size: u32,
    /// How many types it uses; -1 where that is not known.
    pub count: i32,
    /// Those of them that are told here, with the sizes of their TypeObjects.
    pub dependent: Vec<(TypeIdentifier, u32)>,
}

impl TypeInformation {
    /// The value of PID_TYPE_INFORMATION in a little-endian list.
    pub fn encode(&self) -> Vec<u8> {
        let mut w = Writer::default();
        w.delimited(|w| {
            for (id, part) in [(MINIMAL, &self.minimal), (COMPLETE, &self.complete)] {
                w.member(id, |w| w.delimited(|w| part.write(w)));
            }
        });
        w.finish()
    }

    /// Reads the value of PID_TYPE_INFORMATION in a little-endian list. A part that is missing names no type.
    pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let mut information = Self {
            minimal: Dependencies::unknown(),
            complete: Dependencies::unknown(),
        };
        Reader::new(bytes, Endianness::Little).members(|id, r| {
            match id {
                MINIMAL => information.minimal = Dependencies::read(r)?,
                COMPLETE => information.complete = Dependencies::read(r)?,
                _ => {}
            }
            Ok(())
        })?;
        Ok(information)
    }

    /// The description of one kind.
    pub fn of(&self, equivalence: Equivalence) -> &Dependencies {
        match equivalence {
            Equivalence::Minimal => &self.minimal,
            Equivalence::Complete => &self.complete,
        }
    }
}

impl Dependencies {
    fn unknown() -> Self {
        Self {
            type_id: TypeIdentifier::Primitive(super::TypeKind::NONE),
            size: 0,
            count: -1,
            dependent: Vec::new(),
        }
    }

    fn write(&self, w: &mut Writer) {
        write_with_size(w, &self.type_id, self.size);
        w.i32(self.count);
        w.sequence(self.dependent.iter(), |w, (type_id, size)| {
            write_with_size(w, type_id, *size);
        });
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, WireError> {
        r.delimited(|r| {
            let (type_id, size) = read_with_size(r)?;
            Ok(Self {
                type_id,
                size,
                count: r.i32()?,
                dependent: r.sequence(read_with_size)?,
            })
        })
    }
}

pub(super) fn write_with_size(w: &mut Writer, type_id: &TypeIdentifier, size: u32) {
    w.delimited(|w| {
        type_id.write(w);
        w.u32(size);
    });
}

pub(super) fn read_with_size(r: &mut Reader<'_>) -> Result<(TypeIdentifier, u32), WireError> {
    r.delimited(|r| Ok((TypeIdentifier::read(r)?, r.u32()?)))
}
