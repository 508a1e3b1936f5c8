//! The messages of the TypeLookup service (XTypes 7.6.3.3): participants ask each other for TypeObjects.
//!
//! As Cyclone DDS has them in XCDR2: the outer structs are final, the unions appendable. Where the unions are final they
//! are read as well.

use std::collections::BTreeSet;

use super::identifier::{TypeHash, TypeIdentifier};
use super::information::{read_with_size, write_with_size};
use super::library::{TypeLibrary, read_hashes, read_pair};
use super::xcdr::{Reader, Writer};
use crate::wire::{Endianness, Guid, SequenceNumber, WireError};

/// The union labels of the two operations: hashes of their names, as are the ids of the members below.
const GET_TYPES: i32 = 0x0182_52d3;
const GET_DEPENDENCIES: i32 = 0x05aa_fb31;
const TYPE_IDS: u32 = 0x0c53_6065;
const TYPES: u32 = 0x0280_4ad1;
const COMPLETE_TO_MINIMAL: u32 = 0x0b8e_6577;
const DEPENDENT_TYPEIDS: u32 = 0x0ba4_dfc9;
const CONTINUATION_POINT: u32 = 0x0508_e3d2;

/// PLAIN_CDR2.
const ENCAPSULATION: [u8; 4] = [0, 7, 0, 0];
const ENCAPSULATION_BIG: [u8; 2] = [0, 6];

/// The most types that are looked up for one request.
const MAX_TYPES: usize = 256;
/// A reply gets no further TypeObjects beyond this many bytes.
const MAX_REPLY: usize = 128 * 1024;

/// TypeLookup_Request.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Request {
    /// The writer of the request, and the number of its sample.
    pub id: (Guid, SequenceNumber),
    /// Which participant's service is meant; others answer as well.
    pub instance: String,
    /// What is wanted.
    pub operation: Operation,
    /// Of these types.
    pub types: Vec<TypeIdentifier>,
}

/// What is wanted of types.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Operation {
    /// Their TypeObjects.
    Types,
    /// Which types they use.
    Dependencies,
}

/// TypeLookup_Reply.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Reply {
    /// The id of the request. Cyclone DDS puts one of its own there.
    pub related: (Guid, SequenceNumber),
    /// The answer.
    pub answer: Answer,
}

/// The answer to a request.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum Answer {
    /// To [`Operation::Types`].
    Types {
        /// The TypeObjects that are known, serialized.
        objects: Vec<(TypeHash, Vec<u8>)>,
        /// Complete and minimal hash of one type.
        pairs: Vec<(TypeHash, TypeHash)>,
    },
    /// To [`Operation::Dependencies`]: types and the sizes of their TypeObjects.
    Dependencies(Vec<(TypeIdentifier, u32)>),
    /// The request was not understood, or could not be fulfilled.
    Failed,
}

impl Request {
    /// The serialized payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut w = Writer::default();
        write_id(&mut w, self.id);
        w.string(&self.instance);
        w.delimited(|w| {
            w.i32(self.operation.label());
            w.delimited(|w| self.write_members(w));
        });
        payload(w)
    }

    fn write_members(&self, w: &mut Writer) {
        w.member(TYPE_IDS, |w| {
            w.sequence(self.types.iter(), |w, type_id| type_id.write(w));
        });
        if self.operation == Operation::Dependencies {
            w.member(CONTINUATION_POINT, |w| w.len(0));
        }
    }

    /// Reads a serialized payload.
    pub fn decode(payload: &[u8]) -> Result<Self, WireError> {
        let mut r = reader(payload)?;
        let id = read_id(&mut r)?;
        let instance = r.string()?.to_owned();
        let (operation, mut types) = read_union(&mut r, |r| {
            let operation = Operation::from_label(r.i32()?).ok_or(WireError::InvalidData)?;
            let mut types = Vec::new();
            r.members(|member, r| {
                if member == TYPE_IDS {
                    types = r.sequence(TypeIdentifier::read)?;
                }
                Ok(())
            })?;
            Ok((operation, types))
        })?;
        types.truncate(MAX_TYPES);
        Ok(Self {
            id,
            instance,
            operation,
            types,
        })
    }

    /// The reply of a participant that knows these types. All participants get it, not only the one that asked: if one
    /// of them may be Cyclone DDS 0.10, TypeObjects that would make it crash are left out.
    pub fn answer(&self, library: &TypeLibrary, has_cyclone_0_10: bool) -> Reply {
        let hashes: BTreeSet<_> = self.types.iter().filter_map(TypeIdentifier::hash).collect();
        let answer = match self.operation {
            Operation::Types => {
                let mut hashes = hashes;
                hashes.retain(|hash| !has_cyclone_0_10 || library.is_known_to_cyclone_0_10(*hash));
                types(hashes, library)
            }
            Operation::Dependencies => Answer::Dependencies(library.dependencies(hashes)),
        };
        Reply {
            related: self.id,
            answer,
        }
    }
}

fn types(hashes: BTreeSet<TypeHash>, library: &TypeLibrary) -> Answer {
    let mut room = MAX_REPLY;
    let mut objects = Vec::new();
    let mut pairs = Vec::new();
    for hash in hashes {
        let Some(object) = library.object(hash) else {
            continue;
        };
        let Some(rest) = room.checked_sub(object.len()) else {
            break;
        };
        room = rest;
        objects.push((hash, object.to_vec()));
        pairs.extend(library.minimal_of(hash).map(|minimal| (hash, minimal)));
    }
    Answer::Types { objects, pairs }
}

impl Operation {
    fn label(self) -> i32 {
        match self {
            Self::Types => GET_TYPES,
            Self::Dependencies => GET_DEPENDENCIES,
        }
    }

    fn from_label(label: i32) -> Option<Self> {
        match label {
            GET_TYPES => Some(Self::Types),
            GET_DEPENDENCIES => Some(Self::Dependencies),
            _ => None,
        }
    }
}

impl Reply {
    /// The serialized payload.
    pub fn encode(&self) -> Vec<u8> {
        const REMOTE_EX_OK: i32 = 0;
        const REMOTE_EX_UNSUPPORTED: i32 = 1;
        const DDS_RETCODE_OK: i32 = 0;
        let mut w = Writer::default();
        write_id(&mut w, self.related);
        let label = match &self.answer {
            Answer::Types { .. } => GET_TYPES,
            Answer::Dependencies(_) => GET_DEPENDENCIES,
            Answer::Failed => {
                w.i32(REMOTE_EX_UNSUPPORTED);
                return payload(w);
            }
        };
        w.i32(REMOTE_EX_OK);
        w.delimited(|w| {
            w.i32(label);
            w.delimited(|w| {
                w.i32(DDS_RETCODE_OK);
                w.delimited(|w| self.answer.write(w));
            });
        });
        payload(w)
    }

    /// Reads a serialized payload.
    pub fn decode(payload: &[u8]) -> Result<Self, WireError> {
        let mut r = reader(payload)?;
        let related = read_id(&mut r)?;
        let is_ok = r.i32()? == 0;
        if !is_ok {
            let answer = Answer::Failed;
            return Ok(Self { related, answer });
        }
        let answer = read_union(&mut r, |r| {
            let operation = Operation::from_label(r.i32()?).ok_or(WireError::InvalidData)?;
            read_union(r, |r| match r.i32()? {
                0 => Answer::read(operation, r),
                _ => Ok(Answer::Failed),
            })
        })?;
        Ok(Self { related, answer })
    }
}

impl Answer {
    /// The members of TypeLookup_getTypes_Out or TypeLookup_getTypeDependencies_Out.
    fn write(&self, w: &mut Writer) {
        match self {
            Self::Types { objects, pairs } => {
                w.member(TYPES, |w| {
                    w.sequence(objects.iter(), |w, (hash, object)| {
                        TypeIdentifier::Hash(*hash).write(w);
                        w.object(object);
                    });
                });
                w.member(COMPLETE_TO_MINIMAL, |w| {
                    w.sequence(pairs.iter(), |w, (complete, minimal)| {
                        TypeIdentifier::Hash(*complete).write(w);
                        TypeIdentifier::Hash(*minimal).write(w);
                    });
                });
            }
            Self::Dependencies(types) => {
                w.member(DEPENDENT_TYPEIDS, |w| {
                    w.sequence(types.iter(), |w, (type_id, size)| {
                        write_with_size(w, type_id, *size);
                    });
                });
                // Nothing more is to come.
                w.member(CONTINUATION_POINT, |w| w.len(0));
            }
            Self::Failed => {}
        }
    }

    fn read(operation: Operation, r: &mut Reader<'_>) -> Result<Self, WireError> {
        match operation {
            Operation::Types => {
                let (mut objects, mut pairs) = (Vec::new(), Vec::new());
                r.members(|member, r| {
                    match member {
                        TYPES => objects = r.sequence(read_pair)?,
                        COMPLETE_TO_MINIMAL => pairs = r.sequence(read_hashes)?,
                        _ => {}
                    }
                    Ok(())
                })?;
                Ok(Self::Types { objects, pairs })
            }
            Operation::Dependencies => {
                let mut types = Vec::new();
                r.members(|member, r| {
                    if member == DEPENDENT_TYPEIDS {
                        types = r.sequence(read_with_size)?;
                    }
                    Ok(())
                })?;
                Ok(Self::Dependencies(types))
            }
        }
    }
}

/// A union, whose size comes first unless it is final: sizes are never 0, and never as large as the other labels.
fn read_union<T>(
    r: &mut Reader<'_>,
    body: impl FnOnce(&mut Reader<'_>) -> Result<T, WireError>,
) -> Result<T, WireError> {
    match r.clone().i32()? {
        0 | GET_TYPES | GET_DEPENDENCIES => body(r),
        _ => r.delimited(body),
    }
}

fn payload(w: Writer) -> Vec<u8> {
    [&ENCAPSULATION[..], &w.finish()].concat()
}

fn reader(payload: &[u8]) -> Result<Reader<'_>, WireError> {
    let (header, body) = payload
        .split_first_chunk::<4>()
        .ok_or(WireError::UnexpectedEnd)?;
    if header[..2] == ENCAPSULATION[..2] {
        Ok(Reader::new(body, Endianness::Little))
    } else if header[..2] == ENCAPSULATION_BIG {
        Ok(Reader::new(body, Endianness::Big))
    } else {
        Err(WireError::InvalidData)
    }
}

/// SampleIdentity.
fn write_id(w: &mut Writer, (writer, number): (Guid, SequenceNumber)) {
    w.bytes(&writer.to_bytes());
    w.i32((number.0 >> 32) as i32);
    w.u32(number.0 as u32);
}

fn read_id(r: &mut Reader<'_>) -> Result<(Guid, SequenceNumber), WireError> {
    let writer = Guid::from_bytes(r.array()?);
    let (high, low) = (r.i32()?, r.u32()?);
    Ok((
        writer,
        SequenceNumber(i64::from(high) << 32 | i64::from(low)),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xtypes::Equivalence;
    use proptest::collection::vec;
    use proptest::prelude::*;

    fn library() -> (TypeLibrary, TypeHash) {
        let mut library = TypeLibrary::default();
        let object = [4, 0, 0, 0, 0xf1, 0x30, 0, 0];
        let hash = TypeHash::of(Equivalence::Minimal, &object);
        assert!(library.add(hash, &object));
        (library, hash)
    }

    fn request(operation: Operation, hash: TypeHash) -> Request {
        let unknown = TypeHash {
            equivalence: Equivalence::Complete,
            hash: [7; 14],
        };
        Request {
            id: (Guid::from_bytes([3; 16]), SequenceNumber(1 << 33 | 9)),
            instance: "dds.builtin.TOS".to_owned(),
            operation,
            types: vec![TypeIdentifier::Hash(unknown), TypeIdentifier::Hash(hash)],
        }
    }

    #[test]
    fn a_request_is_answered_with_what_is_known() {
        let (library, hash) = library();
        let request = request(Operation::Types, hash);
        assert_eq!(Request::decode(&request.encode()), Ok(request.clone()));
        let reply = request.answer(&library, false);
        assert_eq!(Reply::decode(&reply.encode()), Ok(reply.clone()));
        let object = library.object(hash).unwrap().to_vec();
        assert_eq!(reply.related, request.id);
        assert_eq!(
            reply.answer,
            Answer::Types {
                objects: vec![(hash, object)],
                pairs: Vec::new()
            }
        );
    }

    #[test]
    fn dependencies_and_failures_are_read_again() {
        let (library, hash) = library();
        let request = request(Operation::Dependencies, hash);
        assert_eq!(Request::decode(&request.encode()), Ok(request.clone()));
        let size = (TypeIdentifier::Hash(hash), 8);
        for answer in [Answer::Dependencies(vec![size]), Answer::Failed] {
            let related = request.id;
            let reply = Reply { related, answer };
            assert_eq!(Reply::decode(&reply.encode()), Ok(reply));
        }
        assert_eq!(
            request.answer(&library, false).answer,
            Answer::Dependencies(Vec::new())
        );
    }

    #[test]
    fn a_false_object_is_not_believed() {
        let (mut library, hash) = library();
        let other = TypeHash {
            hash: [1; 14],
            ..hash
        };
        assert!(!library.add(other, &[4, 0, 0, 0, 0xf1, 0x30, 0, 0]));
    }

    proptest! {
        #[test]
        fn damage_is_survived(flips in vec((any::<usize>(), any::<u8>()), 1..8), end in any::<usize>()) {
            let (library, hash) = library();
            let request = request(Operation::Types, hash);
            for mut bytes in [request.encode(), request.answer(&library, false).encode()] {
                for (at, value) in &flips {
                    let at = at % bytes.len();
                    bytes[at] = *value;
                }
                bytes.truncate(end % (bytes.len() + 1));
                let _ = Request::decode(&bytes);
                let _ = Reply::decode(&bytes);
                let _ = TypeLibrary::default().add_mapping(&bytes);
            }
        }
    }
}
