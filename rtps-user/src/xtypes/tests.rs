//! Which types can take each other's values.

use super::*;
use crate::qos::TypeConsistency;
use crate::wire::{Guid, SequenceNumber};

fn member(id: u32, name: &'static str, member_type: TypePair) -> StructMember {
    StructMember {
        key: id == 0,
        ..StructMember::new(name, id, member_type)
    }
}

fn long() -> TypePair {
    TypePair::primitive(TypeKind::INT32)
}

fn structure(extensibility: Extensibility, members: Vec<StructMember>) -> TypeSupport {
    TypeBuilder::describe(|types| {
        types.define("T", |_| {
            Some(Definition::Struct {
                extensibility,
                autoid_hash: false,
                base: None,
                members,
            })
        })
    })
}

/// The library knows both types.
fn assignable(reader: &TypeSupport, writer: &TypeSupport, policy: TypeConsistency) -> Assignable {
    let mut library = TypeLibrary::default();
    library.add_mapping(&reader.objects).unwrap();
    library.add_mapping(&writer.objects).unwrap();
    judge(&library, reader, writer, policy)
}

fn judge(
    library: &TypeLibrary,
    reader: &TypeSupport,
    writer: &TypeSupport,
    policy: TypeConsistency,
) -> Assignable {
    let id = |support: &TypeSupport| {
        let information = TypeInformation::decode(&support.information).unwrap();
        information.minimal.type_id
    };
    library.is_assignable(&id(reader), &id(writer), &policy)
}

fn base() -> Vec<StructMember> {
    vec![
        member(0, "key", TypePair::string(false, 128)),
        member(1, "x", long()),
        member(2, "bytes", TypePair::primitive(TypeKind::BYTE).sequence(0)),
    ]
}

fn longer() -> Vec<StructMember> {
    [base(), vec![member(3, "more", long())]].concat()
}

#[test]
fn a_member_at_the_end_is_for_appendable_types() {
    use Extensibility::{Appendable, Final, Mutable};
    let policy = TypeConsistency::default();
    for (extensibility, expected) in [
        (Final, Assignable::No),
        (Appendable, Assignable::Yes),
        (Mutable, Assignable::Yes),
    ] {
        let (short, long) = (
            structure(extensibility, base()),
            structure(extensibility, longer()),
        );
        assert_eq!(assignable(&short, &long, policy), expected);
        assert_eq!(assignable(&long, &short, policy), expected);
    }
    let mixed = assignable(
        &structure(Final, base()),
        &structure(Appendable, base()),
        policy,
    );
    assert_eq!(mixed, Assignable::No);
}

#[test]
fn the_policy_says_what_does_not_count() {
    let short = structure(Extensibility::Appendable, base());
    let longer = structure(Extensibility::Appendable, longer());
    let mut policy = TypeConsistency {
        prevent_type_widening: true,
        ..TypeConsistency::default()
    };
    assert_eq!(assignable(&longer, &short, policy), Assignable::No);
    assert_eq!(assignable(&short, &longer, policy), Assignable::Yes);
    policy.allow_coercion = false;
    assert_eq!(assignable(&short, &longer, policy), Assignable::No);
    assert_eq!(assignable(&short, &short, policy), Assignable::Yes);

    let mut members = base();
    members[2].member_type = TypePair::primitive(TypeKind::BYTE).sequence(10);
    let bounded = structure(Extensibility::Appendable, members.clone());
    let mut policy = TypeConsistency::default();
    assert_eq!(assignable(&bounded, &short, policy), Assignable::Yes);
    policy.ignore_sequence_bounds = false;
    assert_eq!(assignable(&bounded, &short, policy), Assignable::No);
    assert_eq!(assignable(&short, &bounded, policy), Assignable::Yes);

    members[1].name = "y";
    let renamed = structure(Extensibility::Appendable, members);
    assert_eq!(assignable(&short, &renamed, policy), Assignable::No);
    policy.ignore_member_names = true;
    assert_eq!(assignable(&short, &renamed, policy), Assignable::Yes);
}

#[test]
fn members_of_other_types_and_keys_do_not_fit() {
    let policy = TypeConsistency::default();
    let reader = structure(Extensibility::Mutable, base());
    let mut members = base();
    members[1].member_type = TypePair::primitive(TypeKind::FLOAT64);
    let other = structure(Extensibility::Mutable, members);
    assert_eq!(assignable(&reader, &other, policy), Assignable::No);
    let mut members = base();
    members[1].key = true;
    let keyed = structure(Extensibility::Mutable, members);
    assert_eq!(assignable(&reader, &keyed, policy), Assignable::No);
    let uint8 = TypePair::primitive(TypeKind::BYTE).sequence(0).uint8();
    let mut members = base();
    members[2].member_type = uint8;
    let uint8 = structure(Extensibility::Mutable, members);
    assert_eq!(assignable(&reader, &uint8, policy), Assignable::Yes);
}

/// What would crash Cyclone DDS 0.10 is told to nobody while it may listen.
#[test]
fn not_all_types_are_for_cyclone_0_10() {
    let told = |member_type: TypePair, has_cyclone| {
        let support = structure(Extensibility::Final, vec![member(0, "m", member_type)]);
        let information = TypeInformation::decode(&support.information).unwrap();
        let types = [Equivalence::Minimal, Equivalence::Complete];
        let request = lookup::Request {
            id: (Guid::UNKNOWN, SequenceNumber(1)),
            instance: String::new(),
            operation: lookup::Operation::Types,
            types: types
                .map(|kind| information.of(kind).type_id.clone())
                .into(),
        };
        let mut library = TypeLibrary::default();
        library.add_mapping(&support.objects).unwrap();
        match request.answer(&library, has_cyclone).answer {
            lookup::Answer::Types { objects, .. } => objects.len(),
            other => panic!("{other:?}"),
        }
    };
    let byte = || TypePair::primitive(TypeKind::BYTE);
    for harmless in [
        byte(),
        byte().sequence(0).array(3),
        byte().map_to(TypePair::string(false, 0), 9),
        TypePair::primitive(TypeKind::CHAR16),
    ] {
        assert_eq!(told(harmless, true), 2);
    }
    for new in [
        byte().uint8(),
        byte().sequence(0).array(3).uint8(),
        byte().map_to(long(), 9).uint8(),
        long().map_to(byte(), 9).uint8(),
        TypePair::primitive(TypeKind::INT8),
        TypePair::primitive(TypeKind::NONE),
        TypePair::string(true, 0),
    ] {
        assert_eq!(told(new.clone(), true), 0);
        assert_eq!(told(new, false), 2);
    }
}

#[test]
fn what_is_not_known_is_named() {
    let policy = TypeConsistency::default();
    let (reader, writer) = (
        structure(Extensibility::Appendable, base()),
        structure(Extensibility::Appendable, longer()),
    );
    let mut library = TypeLibrary::default();
    library.add_mapping(&reader.objects).unwrap();
    let Assignable::Unknown(missing) = judge(&library, &reader, &writer, policy) else {
        panic!("the writer's type is not known");
    };
    let mut known = TypeLibrary::default();
    known.add_mapping(&writer.objects).unwrap();
    for hash in missing {
        assert!(library.add(hash, known.object(hash).unwrap()));
    }
    assert_eq!(judge(&library, &reader, &writer, policy), Assignable::Yes);
}

#[test]
fn a_case_of_the_reader_takes_what_the_default_of_the_writer_is() {
    let union = |special: Option<TypePair>| {
        let case = |id, name, default, labels: &[i32], member_type| UnionMember {
            name,
            id,
            default,
            labels: labels.to_vec(),
            member_type,
        };
        let mut members = vec![
            case(0, "a", false, &[0], long()),
            case(1, "b", true, &[], long()),
        ];
        members.extend(special.map(|of| case(2, "c", false, &[9], of)));
        TypeBuilder::describe(|types| {
            types.define("U", |_| {
                Some(Definition::Union {
                    extensibility: Extensibility::Appendable,
                    discriminator: long(),
                    members,
                })
            })
        })
    };
    let policy = TypeConsistency::default();
    for (special, expected) in [
        (long(), Assignable::Yes),
        (TypePair::string(false, 0), Assignable::No),
    ] {
        let (with, without) = (union(Some(special)), union(None));
        assert_eq!(assignable(&with, &without, policy), expected);
        assert_eq!(assignable(&without, &with, policy), expected);
    }
}

#[test]
fn unions_and_enumerations() {
    let support = |name, values: &[i32], extensibility| {
        let literal = |value: &i32| Literal {
            name: ["A", "B", "C"][*value as usize],
            value: *value,
            default: false,
        };
        let literals: Vec<_> = values.iter().map(literal).collect();
        TypeBuilder::describe(|types| {
            types.define(name, |types| {
                let color = types.define("E", |_| {
                    Some(Definition::Enum {
                        extensibility,
                        bit_bound: 32,
                        literals,
                    })
                })?;
                Some(Definition::Union {
                    extensibility: Extensibility::Appendable,
                    discriminator: color,
                    members: vec![UnionMember {
                        name: "m",
                        id: 0,
                        default: false,
                        labels: vec![0],
                        member_type: long(),
                    }],
                })
            })
        })
    };
    let policy = TypeConsistency::default();
    for (extensibility, expected) in [
        (Extensibility::Final, Assignable::No),
        (Extensibility::Appendable, Assignable::Yes),
    ] {
        let two = support("U", &[0, 1], extensibility);
        let three = support("U", &[0, 1, 2], extensibility);
        assert_eq!(assignable(&two, &three, policy), expected);
        assert_eq!(assignable(&two, &two, policy), Assignable::Yes);
    }
}
