//! What a constructed type consists of, and the TypeObjects that say so (XTypes 7.3.4.4 and 7.3.4.5).

use super::builder::TypePair;
use super::identifier::{Equivalence, TRY_CONSTRUCT_DISCARD, TypeIdentifier, TypeKind, name_hash};
use super::xcdr::Writer;

/// How a type may evolve, XTypes 7.2.3; the value is the TypeFlag.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Extensibility {
    /// IS_FINAL.
    Final = 1,
    /// IS_APPENDABLE.
    Appendable = 2,
    /// IS_MUTABLE.
    Mutable = 4,
}

/// A member of a struct.
#[derive(Clone, Debug)]
pub struct StructMember {
    /// Its name.
    pub name: &'static str,
    /// Its id.
    pub id: u32,
    /// It is part of the key, and so must be understood.
    pub key: bool,
    /// It may be absent.
    pub optional: bool,
    /// Its type.
    pub member_type: TypePair,
}

/// A member of a union.
#[derive(Clone, Debug)]
pub struct UnionMember {
    /// Its name.
    pub name: &'static str,
    /// Its id.
    pub id: u32,
    /// It stands also for the values that no other member has.
    pub default: bool,
    /// The discriminator's values that select it.
    pub labels: Vec<i32>,
    /// Its type.
    pub member_type: TypePair,
}

/// A value of an enumeration.
#[derive(Clone, Copy, Debug)]
pub struct Literal {
    /// Its name.
    pub name: &'static str,
    /// Its number.
    pub value: i32,
    /// It stands for numbers without a name.
    pub default: bool,
}

/// A constructed type.
#[derive(Clone, Debug)]
pub enum Definition {
    /// A struct, its members in the order of their declaration.
    Struct {
        /// How it may evolve.
        extensibility: Extensibility,
        /// Its members.
        members: Vec<StructMember>,
    },
    /// A union.
    Union {
        /// How it may evolve.
        extensibility: Extensibility,
        /// The type of its discriminator.
        discriminator: TypePair,
        /// Its members.
        members: Vec<UnionMember>,
    },
    /// An enumeration.
    Enum {
        /// How it may evolve.
        extensibility: Extensibility,
        /// Bits of its values.
        bit_bound: u16,
        /// Its values.
        literals: Vec<Literal>,
    },
}

pub(super) const TK_ENUM: u8 = 0x40;
pub(super) const TK_BITMASK: u8 = 0x41;
pub(super) const TK_STRUCTURE: u8 = 0x51;
pub(super) const TK_UNION: u8 = 0x52;

pub(super) const IS_OPTIONAL: u16 = 1 << 3;
pub(super) const IS_MUST_UNDERSTAND: u16 = 1 << 4;
pub(super) const IS_KEY: u16 = 1 << 5;
pub(super) const IS_DEFAULT: u16 = 1 << 6;

impl Definition {
    /// The TypeObject of a type of that name, serialized.
    pub(super) fn object(&self, name: &str, equivalence: Equivalence) -> Vec<u8> {
        let mut w = Writer::default();
        w.delimited(|w| {
            w.u8(equivalence.octet());
            let mut form = Form {
                w,
                name,
                equivalence,
            };
            match self {
                Self::Struct {
                    extensibility,
                    members,
                } => form.structure(*extensibility, members),
                Self::Union {
                    extensibility,
                    discriminator,
                    members,
                } => form.union(*extensibility, discriminator, members),
                Self::Enum {
                    extensibility,
                    bit_bound,
                    literals,
                } => form.enumeration(*extensibility, *bit_bound, literals),
            }
        });
        w.finish()
    }
}

/// One of the two forms of a TypeObject on its way into bytes.
struct Form<'a> {
    w: &'a mut Writer,
    name: &'a str,
    equivalence: Equivalence,
}

impl Form<'_> {
    fn structure(&mut self, extensibility: Extensibility, members: &[StructMember]) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_STRUCTURE);
        w.u16(extensibility as u16);
        w.delimited(|w| {
            TypeIdentifier::Primitive(TypeKind::NONE).write(w);
            write_type_detail(w, name, *equivalence);
        });
        // In the order of declaration, as other implementations have it, also where the standard says by id.
        w.sequence(members.iter(), |w, member| {
            w.delimited(|w| {
                w.u32(member.id);
                w.u16(flags_of(member));
                member.member_type.of(*equivalence).write(w);
                write_member_detail(w, member.name, *equivalence);
            });
        });
    }

    fn union(
        &mut self,
        extensibility: Extensibility,
        discriminator: &TypePair,
        members: &[UnionMember],
    ) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_UNION);
        w.u16(extensibility as u16);
        w.delimited(|w| write_type_detail(w, name, *equivalence));
        w.delimited(|w| {
            w.u16(TRY_CONSTRUCT_DISCARD | IS_MUST_UNDERSTAND);
            discriminator.of(*equivalence).write(w);
            if *equivalence == Equivalence::Complete {
                write_no_annotations(w);
            }
        });
        w.sequence(members.iter(), |w, member| {
            w.delimited(|w| {
                w.u32(member.id);
                w.u16(TRY_CONSTRUCT_DISCARD | flag(member.default, IS_DEFAULT));
                member.member_type.of(*equivalence).write(w);
                w.len(member.labels.len());
                member.labels.iter().for_each(|label| w.i32(*label));
                write_member_detail(w, member.name, *equivalence);
            });
        });
    }

    fn enumeration(&mut self, extensibility: Extensibility, bit_bound: u16, literals: &[Literal]) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_ENUM);
        // The standard leaves the flags unused; Cyclone DDS compares them.
        w.u16(extensibility as u16);
        w.delimited(|w| {
            w.u16(bit_bound);
            write_type_detail(w, name, *equivalence);
        });
        let mut ordered = literals.to_vec();
        ordered.sort_by_key(|literal| literal.value);
        w.sequence(ordered.into_iter(), |w, literal| {
            w.delimited(|w| {
                w.delimited(|w| {
                    w.i32(literal.value);
                    w.u16(flag(literal.default, IS_DEFAULT));
                });
                write_member_detail(w, literal.name, *equivalence);
            });
        });
    }
}

fn flags_of(member: &StructMember) -> u16 {
    TRY_CONSTRUCT_DISCARD
        | flag(member.optional, IS_OPTIONAL)
        | flag(member.key, IS_KEY | IS_MUST_UNDERSTAND)
}

fn flag(is_set: bool, bits: u16) -> u16 {
    if is_set { bits } else { 0 }
}

fn write_type_detail(w: &mut Writer, name: &str, equivalence: Equivalence) {
    if equivalence == Equivalence::Complete {
        write_no_annotations(w);
        w.string(name);
    }
}

fn write_member_detail(w: &mut Writer, name: &str, equivalence: Equivalence) {
    match equivalence {
        Equivalence::Minimal => w.bytes(&name_hash(name)),
        Equivalence::Complete => {
            w.string(name);
            write_no_annotations(w);
        }
    }
}

/// Neither built-in nor other annotations are there.
fn write_no_annotations(w: &mut Writer) {
    w.bytes(&[0, 0]);
}
