//! Type assignability: whether a reader's type can take what was written of a writer's (XTypes 7.2.4).

use std::collections::{BTreeMap, BTreeSet};

use super::definition::{Extensibility, IS_DEFAULT, IS_KEY, IS_MUST_UNDERSTAND, IS_OPTIONAL};
use super::identifier::{TypeHash, TypeIdentifier, TypeKind};
use super::library::TypeLibrary;
use super::object::{EnumType, Member, MinimalType, StructType};
use crate::qos::TypeConsistency;

/// More comparisons of types than this are not made: types from the wire may be made to need many.
const MAX_STEPS: u32 = 10_000;
/// Types nest no deeper than this, as far as they are compared.
const MAX_DEPTH: u8 = 32;

/// Whether one type can take the values of another.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum Assignable {
    /// It can.
    Yes,
    /// It cannot.
    No,
    /// These TypeObjects would be needed to tell; none where even they would not help.
    Unknown(BTreeSet<TypeHash>),
}

impl TypeLibrary {
    /// Whether a reader's type can take the values of a writer's, by what the reader's policy ignores. Both are
    /// identifiers of the minimal kind.
    pub fn is_assignable(
        &self,
        reader: &TypeIdentifier,
        writer: &TypeIdentifier,
        policy: &TypeConsistency,
    ) -> Assignable {
        if reader == writer {
            return Assignable::Yes;
        }
        if !policy.allow_coercion {
            return Assignable::No;
        }
        let mut comparison = Comparison {
            library: self,
            policy,
            known: BTreeMap::new(),
            missing: BTreeSet::new(),
            is_opaque: false,
            steps: 0,
            depth: 0,
        };
        match comparison.compare(reader, writer) {
            false => Assignable::No,
            true if comparison.missing.is_empty() && !comparison.is_opaque => Assignable::Yes,
            true => Assignable::Unknown(comparison.missing),
        }
    }
}

/// One run. What is not known counts as assignable and is noted.
struct Comparison<'a> {
    library: &'a TypeLibrary,
    policy: &'a TypeConsistency,
    known: BTreeMap<(TypeHash, TypeHash), bool>,
    missing: BTreeSet<TypeHash>,
    is_opaque: bool,
    steps: u32,
    depth: u8,
}

impl Comparison<'_> {
    fn compare(&mut self, reader: &TypeIdentifier, writer: &TypeIdentifier) -> bool {
        self.steps += 1;
        if reader == writer {
            return true;
        }
        if self.steps > MAX_STEPS || self.depth > MAX_DEPTH {
            self.is_opaque = true;
            return true;
        }
        self.depth += 1;
        let result = self.compare_unequal(reader, writer);
        self.depth -= 1;
        result
    }

    fn compare_unequal(&mut self, reader: &TypeIdentifier, writer: &TypeIdentifier) -> bool {
        use TypeIdentifier::{Component, Hash};
        match (reader, writer) {
            (Component { .. }, _) | (_, Component { .. }) => {
                self.is_opaque = true;
                true
            }
            (Hash(reader), Hash(writer)) => self.compare_hashes(*reader, *writer),
            (Hash(hash), plain) | (plain, Hash(hash)) => match self.resolve(*hash) {
                Some(MinimalType::Alias(alias)) if reader == plain => self.compare(reader, &alias),
                Some(MinimalType::Alias(alias)) => self.compare(&alias, writer),
                Some(MinimalType::Bitmask { bit_bound }) => holds(bit_bound, plain),
                Some(MinimalType::Opaque) => {
                    self.is_opaque = true;
                    true
                }
                Some(_) => false,
                None => true,
            },
            _ => self.compare_plain(reader, writer),
        }
    }

    fn compare_plain(&mut self, reader: &TypeIdentifier, writer: &TypeIdentifier) -> bool {
        use TypeIdentifier::{Array, Map, Primitive, Sequence, String};
        let TypeConsistency {
            ignore_sequence_bounds,
            ignore_string_bounds,
            ..
        } = *self.policy;
        match (reader, writer) {
            (Primitive(reader), Primitive(writer)) => same_primitive(*reader, *writer),
            (String { wide, bound: r }, String { wide: other, bound }) => {
                wide == other && fits(*bound, *r, ignore_string_bounds)
            }
            (Sequence { element: r, bound }, Sequence { element, bound: w }) => {
                fits(*w, *bound, ignore_sequence_bounds) && self.compare(r, element)
            }
            (Array { element: r, bounds }, Array { element, bounds: w }) => {
                bounds == w && self.compare(r, element)
            }
            (
                Map {
                    key,
                    element,
                    bound,
                },
                Map {
                    key: writer_key,
                    element: writer_element,
                    bound: writer_bound,
                },
            ) => {
                fits(*writer_bound, *bound, ignore_sequence_bounds)
                    && self.compare(key, writer_key)
                    && self.compare(element, writer_element)
            }
            _ => false,
        }
    }

    fn compare_hashes(&mut self, reader: TypeHash, writer: TypeHash) -> bool {
        if let Some(known) = self.known.get(&(reader, writer)) {
            return *known;
        }
        let result = match (self.resolve(reader), self.resolve(writer)) {
            (Some(reader), Some(writer)) => self.compare_objects(&reader, &writer),
            _ => true,
        };
        self.known.insert((reader, writer), result);
        result
    }

    fn resolve(&mut self, hash: TypeHash) -> Option<MinimalType> {
        let found = self.library.minimal_type(hash);
        if found.is_none() {
            self.missing.insert(hash);
        }
        found
    }

    fn compare_objects(&mut self, reader: &MinimalType, writer: &MinimalType) -> bool {
        use MinimalType::{Alias, Bitmask, Enum, Opaque, Struct, Union};
        match (reader, writer) {
            (Opaque, _) | (_, Opaque) => {
                self.is_opaque = true;
                true
            }
            (Alias(reader), Alias(writer)) => self.compare(reader, writer),
            (Alias(TypeIdentifier::Hash(hash)), _) => {
                let reader = self.resolve(*hash);
                reader.is_none_or(|reader| self.compare_nested(&reader, writer))
            }
            (_, Alias(TypeIdentifier::Hash(hash))) => {
                let writer = self.resolve(*hash);
                writer.is_none_or(|writer| self.compare_nested(reader, &writer))
            }
            (Bitmask { bit_bound }, Bitmask { bit_bound: other }) => bit_bound == other,
            (Enum(reader), Enum(writer)) => self.compare_enums(reader, writer),
            (Struct(reader), Struct(writer)) => {
                same_extensibility(reader.flags, writer.flags) && {
                    let of_reader = self.with_base(reader);
                    let of_writer = self.with_base(writer);
                    self.compare_members(reader.flags, &of_reader, &of_writer)
                }
            }
            (Union(reader), Union(writer)) => {
                same_extensibility(reader.flags, writer.flags)
                    && self.compare(&reader.discriminator, &writer.discriminator)
                    && self.compare_cases(is_final(reader.flags), &reader.members, &writer.members)
            }
            _ => false,
        }
    }

    fn compare_nested(&mut self, reader: &MinimalType, writer: &MinimalType) -> bool {
        self.steps += 1;
        if self.steps > MAX_STEPS || self.depth > MAX_DEPTH {
            self.is_opaque = true;
            return true;
        }
        self.depth += 1;
        let result = self.compare_objects(reader, writer);
        self.depth -= 1;
        result
    }

    /// The members of a struct, those that it inherits first.
    fn with_base(&mut self, of: &StructType) -> Vec<Member> {
        let mut all = of.members.clone();
        let mut base = of.base.clone();
        for _ in 0..MAX_DEPTH {
            let TypeIdentifier::Hash(hash) = base else {
                break;
            };
            let Some(MinimalType::Struct(inherited)) = self.resolve(hash) else {
                self.is_opaque = true;
                break;
            };
            all.splice(0..0, inherited.members);
            base = inherited.base;
        }
        all
    }

    fn compare_members(&mut self, flags: u16, reader: &[Member], writer: &[Member]) -> bool {
        if !self.may_differ(flags, reader, writer) {
            return false;
        }
        let of_reader: BTreeMap<_, _> = reader.iter().map(|member| (member.id, member)).collect();
        let names: BTreeMap<_, _> = reader.iter().map(|member| (member.name, member)).collect();
        let mut common = 0;
        for writer in writer {
            let Some(reader) = of_reader.get(&writer.id) else {
                let has_other_id = names.contains_key(&writer.name);
                if writer.flags & (IS_MUST_UNDERSTAND | IS_KEY) != 0
                    || has_other_id && !self.policy.ignore_member_names
                {
                    return false;
                }
                continue;
            };
            common += 1;
            let is_mutable = flags & Extensibility::Mutable as u16 != 0;
            let differing = reader.flags ^ writer.flags;
            if reader.name != writer.name && !self.policy.ignore_member_names
                || differing & IS_KEY != 0
                || differing & IS_OPTIONAL != 0 && !is_mutable
                || !self.compare(&reader.type_id, &writer.type_id)
                || reader.flags & IS_KEY != 0 && !self.holds_keys(&reader.type_id, &writer.type_id)
            {
                return false;
            }
        }
        common > 0 || writer.is_empty() && reader.is_empty()
    }

    /// Whether a key of the reader can have all values of the writer's, whatever the policy ignores: two instances would
    /// be one otherwise.
    fn holds_keys(&mut self, reader: &TypeIdentifier, writer: &TypeIdentifier) -> bool {
        use TypeIdentifier::{Hash, Map, Sequence, String};
        match (reader, writer) {
            (
                String { bound, .. },
                String {
                    bound: of_writer, ..
                },
            )
            | (
                Sequence { bound, .. },
                Sequence {
                    bound: of_writer, ..
                },
            )
            | (
                Map { bound, .. },
                Map {
                    bound: of_writer, ..
                },
            ) => fits(*of_writer, *bound, false),
            (Hash(reader), Hash(writer)) => match (self.resolve(*reader), self.resolve(*writer)) {
                (Some(MinimalType::Enum(reader)), Some(MinimalType::Enum(writer))) => {
                    let has = |value| reader.literals.iter().any(|(known, _)| *known == value);
                    writer.literals.iter().all(|(value, _)| has(*value))
                }
                _ => true,
            },
            _ => true,
        }
    }

    /// Whether the writer's type may lack or have members that the reader's does not, where it does.
    fn may_differ(&self, flags: u16, reader: &[Member], writer: &[Member]) -> bool {
        let ids: BTreeSet<_> = writer.iter().map(|member| member.id).collect();
        let mut lacking = reader.iter().filter(|member| !ids.contains(&member.id));
        let lacks_key = lacking.clone().any(|member| member.flags & IS_KEY != 0);
        let lacks_any = lacking.next().is_some();
        if lacks_key || lacks_any && self.policy.prevent_type_widening {
            return false;
        }
        if is_final(flags) {
            return !lacks_any && reader.len() == writer.len();
        }
        let in_order = || reader.iter().zip(writer).all(|(a, b)| a.id == b.id);
        flags & Extensibility::Mutable as u16 != 0 || in_order()
    }

    fn compare_cases(&mut self, is_final: bool, reader: &[Member], writer: &[Member]) -> bool {
        let by_label = |members: &[Member]| -> BTreeMap<i32, Member> {
            let labels = members.iter().flat_map(|member| {
                let each = member.labels.iter();
                each.map(|label| (*label, member.clone()))
            });
            labels.collect()
        };
        let default = |members: &[Member]| {
            let mut members = members.iter();
            members
                .find(|member| member.flags & IS_DEFAULT != 0)
                .cloned()
        };
        let (of_reader, of_writer) = (by_label(reader), by_label(writer));
        let (reader_default, writer_default) = (default(reader), default(writer));
        if is_final
            && (!of_reader.keys().eq(of_writer.keys())
                || reader_default.is_some() != writer_default.is_some())
        {
            return false;
        }
        let selected = of_writer.iter().filter_map(|(label, writer)| {
            let reader = of_reader.get(label).or(reader_default.as_ref())?;
            Some((reader, writer))
        });
        let lacking = of_reader
            .iter()
            .filter(|(label, _)| !of_writer.contains_key(label));
        let selecting_default =
            lacking.filter_map(|(_, reader)| Some((reader, writer_default.as_ref()?)));
        let defaults = reader_default.iter().zip(writer_default.iter());
        selected
            .chain(selecting_default)
            .chain(defaults)
            .all(|(reader, writer)| self.compare(&reader.type_id, &writer.type_id))
    }

    fn compare_enums(&self, reader: &EnumType, writer: &EnumType) -> bool {
        if !same_extensibility(reader.flags, writer.flags)
            || holder(reader.bit_bound) != holder(writer.bit_bound)
        {
            return false;
        }
        let literals = reader.literals.iter();
        let values: BTreeMap<_, _> = literals.clone().copied().collect();
        let names: BTreeMap<_, _> = literals.map(|(value, name)| (*name, *value)).collect();
        let is_final = is_final(reader.flags);
        if is_final && reader.literals.len() != writer.literals.len() {
            return false;
        }
        writer.literals.iter().all(|(value, name)| {
            let is_named_so = values.get(value).is_none_or(|known| known == name);
            let is_valued_so = names.get(name).is_none_or(|known| known == value);
            (values.contains_key(value) || !is_final)
                && (self.policy.ignore_member_names || is_named_so && is_valued_so)
        })
    }
}

/// What is announced as BYTE, UINT8, INT8 or CHAR8 for the same IDL differs between implementations: Cyclone DDS 0.10
/// takes uint8 for octet and int8 for char.
fn same_primitive(reader: TypeKind, writer: TypeKind) -> bool {
    let normal = |kind| match kind {
        TypeKind::UINT8 => TypeKind::BYTE,
        TypeKind::INT8 => TypeKind::CHAR8,
        other => other,
    };
    normal(reader) == normal(writer)
}

/// Whether a primitive type is the one that holds a bitmask.
fn holds(bit_bound: u16, identifier: &TypeIdentifier) -> bool {
    let unsigned = match bit_bound {
        0..=8 => TypeKind::UINT8,
        9..=16 => TypeKind::UINT16,
        17..=32 => TypeKind::UINT32,
        _ => TypeKind::UINT64,
    };
    matches!(identifier, TypeIdentifier::Primitive(kind) if same_primitive(*kind, unsigned))
}

/// The size in bytes of an enumeration's values.
fn holder(bit_bound: u16) -> u8 {
    match bit_bound {
        0..=8 => 1,
        9..=16 => 2,
        _ => 4,
    }
}

/// Whether collections of one bound are taken by one of another, 0 being none.
fn fits(writer: u32, reader: u32, ignored: bool) -> bool {
    ignored || reader == 0 || writer != 0 && writer <= reader
}

fn is_final(flags: u16) -> bool {
    flags & Extensibility::Final as u16 != 0
}

/// Enumerations may leave the flags out.
fn same_extensibility(reader: u16, writer: u16) -> bool {
    let (reader, writer) = (reader & 7, writer & 7);
    reader == writer || reader == 0 || writer == 0
}
