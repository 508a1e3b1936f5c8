//! Collecting the TypeObjects of a type and of all types that it uses.

use super::definition::Definition;
use super::identifier::{Equivalence, TypeHash, TypeIdentifier, TypeKind};
use super::information::{Dependencies, TypeInformation};
use super::xcdr::Writer;

/// The two identifiers of a type, which are the same unless it needs a TypeObject.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct TypePair {
    minimal: TypeIdentifier,
    complete: TypeIdentifier,
}

impl TypePair {
    /// A primitive type.
    pub fn primitive(kind: TypeKind) -> Self {
        Self::same(TypeIdentifier::Primitive(kind))
    }

    /// A string; a bound of 0 is none.
    pub fn string(wide: bool, bound: u32) -> Self {
        Self::same(TypeIdentifier::String { wide, bound })
    }

    /// A sequence; a bound of 0 is none.
    pub fn sequence(self, bound: u32) -> Self {
        self.map(|element| TypeIdentifier::Sequence {
            element: Box::new(element),
            bound,
        })
    }

    /// An array; one of arrays has a further dimension.
    pub fn array(self, bound: u32) -> Self {
        self.map(|element| match element {
            TypeIdentifier::Array { element, bounds } => TypeIdentifier::Array {
                element,
                bounds: [vec![bound], bounds].concat(),
            },
            element => TypeIdentifier::Array {
                element: Box::new(element),
                bounds: vec![bound],
            },
        })
    }

    /// A map from `self`; a bound of 0 is none.
    pub fn map_to(self, element: Self, bound: u32) -> Self {
        let map = |key, element| TypeIdentifier::Map {
            key: Box::new(key),
            element: Box::new(element),
            bound,
        };
        Self {
            minimal: map(self.minimal, element.minimal),
            complete: map(self.complete, element.complete),
        }
    }

    /// The same with TK_UINT8 for TK_BYTE: what IDL calls `uint8` and `octet` are two types, and one in Rust.
    #[must_use]
    pub fn uint8(self) -> Self {
        self.map(TypeIdentifier::uint8)
    }

    /// The identifier of one kind.
    pub fn of(&self, equivalence: Equivalence) -> &TypeIdentifier {
        match equivalence {
            Equivalence::Minimal => &self.minimal,
            Equivalence::Complete => &self.complete,
        }
    }

    fn same(identifier: TypeIdentifier) -> Self {
        Self {
            minimal: identifier.clone(),
            complete: identifier,
        }
    }

    fn map(self, each: impl Fn(TypeIdentifier) -> TypeIdentifier) -> Self {
        Self {
            minimal: each(self.minimal),
            complete: each(self.complete),
        }
    }
}

/// Makes TypeObjects.
#[derive(Debug, Default)]
pub struct TypeBuilder {
    /// Types whose definition has begun: one that comes again refers to itself.
    begun: Vec<&'static str>,
    /// How many definitions have begun.
    count: usize,
    objects: Vec<Object>,
}

#[derive(Debug)]
struct Object {
    /// How many definitions had begun before: a type comes before those that it uses.
    place: usize,
    minimal: (TypeHash, Vec<u8>),
    complete: (TypeHash, Vec<u8>),
}

impl Object {
    fn of(&self, equivalence: Equivalence) -> &(TypeHash, Vec<u8>) {
        match equivalence {
            Equivalence::Minimal => &self.minimal,
            Equivalence::Complete => &self.complete,
        }
    }
}

/// The most bytes of TypeObjects that one type comes with, so that its endpoints can be declared to a layer.
const MAX_OBJECTS: usize = 48 * 1024;

/// What a type's endpoints need so that others can look into the type. Empty where it cannot be described.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct TypeSupport {
    /// TypeInformation, serialized.
    pub information: Vec<u8>,
    /// TypeMapping, serialized: the TypeObjects of the type and of those that it uses.
    pub objects: Vec<u8>,
}

impl TypeBuilder {
    /// Describes a type; `describe` gives `None` where it, or one that it uses, cannot be.
    pub fn describe(describe: impl FnOnce(&mut Self) -> Option<TypePair>) -> TypeSupport {
        let mut builder = Self::default();
        match describe(&mut builder) {
            Some(pair) if pair.minimal.hash().is_some() => {
                let support = builder.finish();
                match support.objects.len() <= MAX_OBJECTS {
                    true => support,
                    false => TypeSupport::default(),
                }
            }
            _ => TypeSupport::default(),
        }
    }

    /// Adds a type. `definition` describes the types that it uses before. Types that refer to themselves cannot be
    /// described: that would take strongly connected components (XTypes 7.3.4.9).
    pub fn define(
        &mut self,
        name: &'static str,
        definition: impl FnOnce(&mut Self) -> Option<Definition>,
    ) -> Option<TypePair> {
        if self.begun.contains(&name) {
            return None;
        }
        self.begun.push(name);
        let place = self.count;
        self.count += 1;
        let definition = definition(self);
        self.begun.pop();
        let definition = definition?;
        let named = |equivalence| {
            let object = definition.object(name, equivalence);
            (TypeHash::of(equivalence, &object), object)
        };
        let (minimal, complete) = (named(Equivalence::Minimal), named(Equivalence::Complete));
        let pair = TypePair {
            minimal: TypeIdentifier::Hash(minimal.0),
            complete: TypeIdentifier::Hash(complete.0),
        };
        if self.objects.iter().all(|known| known.complete != complete) {
            self.objects.push(Object {
                place,
                minimal,
                complete,
            });
        }
        Some(pair)
    }

    fn finish(mut self) -> TypeSupport {
        self.objects.sort_by_key(|object| object.place);
        let information = TypeInformation {
            minimal: self.dependencies(Equivalence::Minimal),
            complete: self.dependencies(Equivalence::Complete),
        };
        TypeSupport {
            information: information.encode(),
            objects: self.mapping(),
        }
    }

    fn dependencies(&self, equivalence: Equivalence) -> Dependencies {
        let mut types = self.distinct(equivalence).into_iter().map(|(hash, bytes)| {
            let size = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
            (TypeIdentifier::Hash(*hash), size)
        });
        let none = (TypeIdentifier::Primitive(TypeKind::NONE), 0);
        let (type_id, size) = types.next().unwrap_or(none);
        let dependent: Vec<_> = types.collect();
        Dependencies {
            type_id,
            size,
            count: i32::try_from(dependent.len()).unwrap_or(-1),
            dependent,
        }
    }

    fn mapping(&self) -> Vec<u8> {
        let mut w = Writer::default();
        for equivalence in [Equivalence::Minimal, Equivalence::Complete] {
            let objects = self.distinct(equivalence);
            w.sequence(objects.into_iter(), |w, (hash, bytes)| {
                TypeIdentifier::Hash(*hash).write(w);
                w.object(bytes);
            });
        }
        w.sequence(self.objects.iter(), |w, object| {
            TypeIdentifier::Hash(object.complete.0).write(w);
            TypeIdentifier::Hash(object.minimal.0).write(w);
        });
        w.finish()
    }

    /// Types that differ in names alone may have the same minimal TypeObject.
    fn distinct(&self, equivalence: Equivalence) -> Vec<&(TypeHash, Vec<u8>)> {
        let mut distinct: Vec<&(TypeHash, Vec<u8>)> = Vec::new();
        for named in self.objects.iter().map(|object| object.of(equivalence)) {
            if distinct.iter().all(|known| known.0 != named.0) {
                distinct.push(named);
            }
        }
        distinct
    }
}
