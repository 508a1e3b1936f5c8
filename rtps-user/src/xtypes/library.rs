//! The TypeObjects that are known: those of our own types, and remote ones that were asked for.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::identifier::{Equivalence, TypeHash, TypeIdentifier};
use super::object::MinimalType;
use super::xcdr::Reader;
use crate::wire::{Endianness, WireError};

/// The most bytes of TypeObjects that are kept; the oldest are forgotten.
const MAX_BYTES: usize = 8 * 1024 * 1024;
/// The most bytes of one TypeObject.
const MAX_OBJECT: usize = 64 * 1024;

/// Known TypeObjects by their hashes.
#[derive(Debug, Default)]
pub struct TypeLibrary {
    objects: BTreeMap<TypeHash, Vec<u8>>,
    /// The same, the oldest first.
    order: VecDeque<TypeHash>,
    bytes: usize,
    /// Minimal by complete.
    pairs: BTreeMap<TypeHash, TypeHash>,
}

impl TypeLibrary {
    /// Adds what an app says of its types: a serialized TypeMapping, as [`TypeSupport`](super::TypeSupport) has it.
    pub fn add_mapping(&mut self, mapping: &[u8]) -> Result<(), WireError> {
        let mut r = Reader::new(mapping, Endianness::Little);
        for _ in [Equivalence::Minimal, Equivalence::Complete] {
            for (hash, object) in r.sequence(read_pair)? {
                self.add(hash, &object);
            }
        }
        for (complete, minimal) in r.sequence(read_hashes)? {
            if self.objects.contains_key(&complete) && self.objects.contains_key(&minimal) {
                self.pairs.insert(complete, minimal);
            }
        }
        Ok(())
    }

    /// Adds a TypeObject. False where it is known, too large, or not what the hash names.
    pub fn add(&mut self, hash: TypeHash, object: &[u8]) -> bool {
        if object.len() > MAX_OBJECT
            || self.objects.contains_key(&hash)
            || TypeHash::of(hash.equivalence, object) != hash
        {
            return false;
        }
        self.bytes += object.len();
        self.objects.insert(hash, object.to_vec());
        self.order.push_back(hash);
        while self.bytes > MAX_BYTES {
            self.forget_oldest();
        }
        true
    }

    fn forget_oldest(&mut self) {
        let Some(oldest) = self.order.pop_front() else {
            return;
        };
        let object = self.objects.remove(&oldest);
        self.bytes -= object.map_or(0, |object| object.len());
        self.pairs
            .retain(|complete, minimal| *complete != oldest && *minimal != oldest);
    }

    /// A TypeObject, serialized.
    pub fn object(&self, hash: TypeHash) -> Option<&[u8]> {
        self.objects.get(&hash).map(Vec::as_slice)
    }

    /// Whether Cyclone DDS 0.10 survives this TypeObject; no where that cannot be told.
    pub(super) fn is_known_to_cyclone_0(&self, hash: TypeHash) -> bool {
        let minimal = match hash.equivalence {
            Equivalence::Minimal => Some(hash),
            Equivalence::Complete => self.minimal_of(hash),
        };
        let object = minimal.and_then(|minimal| self.minimal_type(minimal));
        object.is_some_and(|object| object.is_known_to_cyclone_0())
    }

    /// The minimal hash of the type with this complete one.
    pub fn minimal_of(&self, complete: TypeHash) -> Option<TypeHash> {
        self.pairs.get(&complete).copied()
    }

    /// The types that these use, directly or not, as far as they are known; with the sizes of their TypeObjects.
    pub(super) fn dependencies(&self, of: BTreeSet<TypeHash>) -> Vec<(TypeIdentifier, u32)> {
        let mut found = of.clone();
        let mut open: Vec<_> = of.iter().copied().collect();
        while let Some(hash) = open.pop() {
            let members = self.minimal_type(hash).map(|object| object.uses());
            for used in members.into_iter().flatten() {
                if found.insert(used) {
                    open.push(used);
                }
            }
        }
        let used = found.difference(&of).filter_map(|hash| {
            let size = u32::try_from(self.object(*hash)?.len()).ok()?;
            Some((TypeIdentifier::Hash(*hash), size))
        });
        used.collect()
    }

    /// The minimal TypeObject; `None` where it is not known.
    pub(super) fn minimal_type(&self, hash: TypeHash) -> Option<MinimalType> {
        let object = self.object(hash)?;
        Some(MinimalType::decode(object).unwrap_or(MinimalType::Opaque))
    }
}

/// TypeIdentifierTypeObjectPair; the object stays serialized.
pub(super) fn read_pair(r: &mut Reader<'_>) -> Result<(TypeHash, Vec<u8>), WireError> {
    let identifier = TypeIdentifier::read(r)?;
    let hash = identifier.hash().ok_or(WireError::InvalidData)?;
    let object = r.object()?;
    Ok((hash, object.to_vec()))
}

/// TypeIdentifierPair.
pub(super) fn read_hashes(r: &mut Reader<'_>) -> Result<(TypeHash, TypeHash), WireError> {
    let mut hash = || {
        TypeIdentifier::read(r)?
            .hash()
            .ok_or(WireError::InvalidData)
    };
    Ok((hash()?, hash()?))
}
