//! What a constructed type consists of, and the TypeObjects that say so (XTypes 7.3.4.4 and 7.3.4.5).

use super::builder::TypePair;
use super::identifier::{Equivalence, TypeIdentifier, TypeKind, name_hash};
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

/// What becomes of a member whose value cannot be one of the reader's type, XTypes 7.2.2.7; the value is the MemberFlag.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum TryConstruct {
    /// What holds it cannot be constructed either: in the end, the sample is lost.
    #[default]
    Discard = 1,
    /// It has its default.
    UseDefault = 2,
    /// A string or collection is cut to its bound.
    Trim = 3,
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
    /// Who does not know it discards the sample.
    pub must_understand: bool,
    /// It may be absent.
    pub optional: bool,
    /// It is stored apart from what holds it.
    pub external: bool,
    /// What a value that does not fit becomes.
    pub try_construct: TryConstruct,
    /// The name that its id was made of, empty for its own.
    pub hash_id: Option<&'static str>,
    /// Its type.
    pub member_type: TypePair,
}

impl StructMember {
    /// A member without annotations.
    #[must_use]
    pub fn new(name: &'static str, id: u32, member_type: TypePair) -> Self {
        Self {
            name,
            id,
            key: false,
            must_understand: false,
            optional: false,
            external: false,
            try_construct: TryConstruct::Discard,
            hash_id: None,
            member_type,
        }
    }
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

/// A flag of a bitmask.
#[derive(Clone, Copy, Debug)]
pub struct Bitflag {
    /// Its name.
    pub name: &'static str,
    /// Its bit, 0 being the least significant.
    pub position: u16,
}

/// A field of a bitset.
#[derive(Clone, Copy, Debug)]
pub struct Bitfield {
    /// Its name.
    pub name: &'static str,
    /// Its least significant bit.
    pub position: u16,
    /// How many bits it has.
    pub bits: u8,
    /// The type of its values.
    pub holder: TypeKind,
}

/// A constructed type.
#[derive(Clone, Debug)]
pub enum Definition {
    /// A struct, its members in the order of their declaration.
    Struct {
        /// How it may evolve.
        extensibility: Extensibility,
        /// Ids without annotation are hashes of the names.
        autoid_hash: bool,
        /// The struct whose members come first.
        base: Option<TypePair>,
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
    /// Another name of a type.
    Alias(TypePair),
    /// Flags in an unsigned integer.
    Bitmask {
        /// Bits of the integer.
        bit_bound: u16,
        /// The flags.
        flags: Vec<Bitflag>,
    },
    /// Small numbers in an unsigned integer.
    Bitset(Vec<Bitfield>),
}

pub(super) const TK_ALIAS: u8 = 0x30;
pub(super) const TK_ENUM: u8 = 0x40;
pub(super) const TK_BITMASK: u8 = 0x41;
pub(super) const TK_STRUCTURE: u8 = 0x51;
pub(super) const TK_UNION: u8 = 0x52;
const TK_BITSET: u8 = 0x53;

const IS_AUTOID_HASH: u16 = 1 << 4;
const IS_EXTERNAL: u16 = 1 << 2;
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
                    autoid_hash,
                    base,
                    members,
                } => {
                    let flags = *extensibility as u16 | flag(*autoid_hash, IS_AUTOID_HASH);
                    form.structure(flags, base.as_ref(), members);
                }
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
                Self::Alias(aliased) => form.alias(aliased),
                Self::Bitmask { bit_bound, flags } => form.bitmask(*bit_bound, flags),
                Self::Bitset(fields) => form.bitset(fields),
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
    fn structure(&mut self, flags: u16, base: Option<&TypePair>, members: &[StructMember]) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_STRUCTURE);
        w.u16(flags);
        w.delimited(|w| {
            match base {
                Some(base) => base.of(*equivalence).write(w),
                None => TypeIdentifier::Primitive(TypeKind::NONE).write(w),
            }
            write_type_detail(w, name, *equivalence);
        });
        // In the order of declaration, as other implementations have it, also where the standard says by id.
        w.sequence(members.iter(), |w, member| {
            w.delimited(|w| {
                w.u32(member.id);
                w.u16(flags_of(member));
                member.member_type.of(*equivalence).write(w);
                write_struct_member_detail(w, member, *equivalence);
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
            w.u16(TryConstruct::Discard as u16 | IS_MUST_UNDERSTAND);
            discriminator.of(*equivalence).write(w);
            if *equivalence == Equivalence::Complete {
                write_no_annotations(w);
            }
        });
        w.sequence(members.iter(), |w, member| {
            w.delimited(|w| {
                w.u32(member.id);
                w.u16(TryConstruct::Discard as u16 | flag(member.default, IS_DEFAULT));
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

    fn alias(&mut self, aliased: &TypePair) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_ALIAS);
        w.u16(0);
        w.delimited(|w| write_type_detail(w, name, *equivalence));
        w.delimited(|w| {
            w.u16(0);
            aliased.of(*equivalence).write(w);
            if *equivalence == Equivalence::Complete {
                write_no_annotations(w);
            }
        });
    }

    fn bitmask(&mut self, bit_bound: u16, flags: &[Bitflag]) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_BITMASK);
        w.delimited(|w| {
            // As for enumerations, Cyclone DDS compares flags that the standard leaves unused.
            w.u16(Extensibility::Final as u16);
            w.delimited(|w| {
                w.u16(bit_bound);
                write_type_detail(w, name, *equivalence);
            });
            w.sequence(flags.iter(), |w, bit| {
                w.delimited(|w| {
                    w.u16(bit.position);
                    w.u16(0);
                    write_member_detail(w, bit.name, *equivalence);
                });
            });
        });
    }

    fn bitset(&mut self, fields: &[Bitfield]) {
        let Self {
            w,
            name,
            equivalence,
        } = self;
        w.u8(TK_BITSET);
        w.delimited(|w| {
            w.u16(Extensibility::Final as u16);
            w.delimited(|w| write_type_detail(w, name, *equivalence));
            w.sequence(fields.iter(), |w, field| {
                w.delimited(|w| {
                    w.u16(field.position);
                    w.u16(0);
                    w.u8(field.bits);
                    w.u8(field.holder.0);
                    write_member_detail(w, field.name, *equivalence);
                });
            });
        });
    }
}

fn flags_of(member: &StructMember) -> u16 {
    member.try_construct as u16
        | flag(member.external, IS_EXTERNAL)
        | flag(member.optional, IS_OPTIONAL)
        | flag(member.must_understand, IS_MUST_UNDERSTAND)
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

/// The only built-in annotation that is told: what a hashed id was made of.
fn write_struct_member_detail(w: &mut Writer, member: &StructMember, equivalence: Equivalence) {
    let (Equivalence::Complete, Some(hash_id)) = (equivalence, member.hash_id) else {
        return write_member_detail(w, member.name, equivalence);
    };
    w.string(member.name);
    w.u8(1);
    w.delimited(|w| {
        // No unit, minimum and maximum; the name.
        w.bytes(&[0, 0, 0, 1]);
        w.string(hash_id);
    });
    w.u8(0);
}

/// Neither built-in nor other annotations are there.
fn write_no_annotations(w: &mut Writer) {
    w.bytes(&[0, 0]);
}
