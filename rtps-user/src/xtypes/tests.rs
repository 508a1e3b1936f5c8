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

/// The type of the interoperability demonstrations, with these bounds; 0 is none.
fn shape_type(color: u32, payload: u32) -> Vec<StructMember> {
    let payload_type = TypePair::primitive(TypeKind::BYTE).sequence(payload);
    vec![
        member(0, "color", TypePair::string(false, color)),
        member(1, "x", long()),
        member(2, "y", long()),
        member(3, "shapesize", long()),
        member(4, "additional_payload_size", payload_type),
    ]
}

/// The default with a change.
fn with(change: fn(&mut TypeConsistency)) -> TypeConsistency {
    let mut policy = TypeConsistency::default();
    change(&mut policy);
    policy
}

/// The base and one more member.
fn and(name: &'static str, member_type: TypePair) -> Vec<StructMember> {
    [base(), vec![member(3, name, member_type)]].concat()
}

type Row<'a> = (
    &'a [StructMember],
    &'a [StructMember],
    TypeConsistency,
    bool,
);

/// Rows have the reader's members, the writer's, the policy, and whether they match.
#[track_caller]
fn assert_rows(rows: &[Row<'_>]) {
    for (number, (reader, writer, policy, fits)) in rows.iter().enumerate() {
        let appendable =
            |members: &[StructMember]| structure(Extensibility::Appendable, members.to_vec());
        let result = assignable(&appendable(reader), &appendable(writer), *policy);
        let expected = if *fits {
            Assignable::Yes
        } else {
            Assignable::No
        };
        assert_eq!(result, expected, "row {number}");
    }
}

#[test]
fn bounds_of_sequences() {
    let strict = with(|policy| policy.ignore_sequence_bounds = false);
    let of_strings = with(|policy| policy.ignore_string_bounds = false);
    let validated = with(|policy| policy.force_type_validation = true);
    let same_type = with(|policy| policy.allow_coercion = false);
    let default = TypeConsistency::default();
    let (bounded, unbounded) = (&shape_type(128, 100_000), &shape_type(128, 0));
    let map = |bound| and("map", long().map_to(long(), bound));
    let array = |bound| and("array", long().array(bound));
    assert_rows(&[
        (bounded, unbounded, default, true),
        (unbounded, bounded, default, true),
        (bounded, unbounded, strict, false),
        (unbounded, bounded, strict, true),
        (bounded, unbounded, of_strings, true),
        (bounded, unbounded, validated, true),
        (bounded, unbounded, same_type, false),
        (bounded, bounded, same_type, true),
        (&map(4), &map(5), default, true),
        (&map(4), &map(5), strict, false),
        (&map(5), &map(4), strict, true),
        (&array(4), &array(5), default, false),
    ]);
}

#[test]
fn bounds_of_strings() {
    let strict = with(|policy| policy.ignore_string_bounds = false);
    let of_sequences = with(|policy| policy.ignore_sequence_bounds = false);
    let default = TypeConsistency::default();
    let text = |bound| and("text", TypePair::string(false, bound));
    let wide = and("text", TypePair::string(true, 0));
    assert_rows(&[
        (&text(4), &text(5), default, true),
        (&text(4), &text(5), strict, false),
        (&text(4), &text(0), strict, false),
        (&text(5), &text(4), strict, true),
        (&text(0), &text(4), strict, true),
        (&text(4), &text(5), of_sequences, true),
        (&wide, &text(0), default, false),
        // Those of keys count whatever is ignored.
        (&shape_type(128, 0), &shape_type(0, 0), default, false),
        (&shape_type(128, 0), &shape_type(129, 0), default, false),
        (&shape_type(128, 0), &shape_type(127, 0), default, true),
        (&shape_type(0, 0), &shape_type(128, 0), default, true),
    ]);
}

#[test]
fn names_and_annotations_of_members() {
    let no_names = with(|policy| policy.ignore_member_names = true);
    let no_widening = with(|policy| policy.prevent_type_widening = true);
    let default = TypeConsistency::default();
    let (a, b) = (and("a", long()), and("b", long()));
    let (mut optional, mut vital) = (a.clone(), a.clone());
    optional[3].optional = true;
    vital[3].must_understand = true;
    assert_rows(&[
        (&a, &b, default, false),
        (&a, &b, no_names, true),
        (&a, &base(), default, true),
        (&a, &base(), no_widening, false),
        (&base(), &a, no_widening, true),
        (&optional, &a, default, false),
        (&base(), &vital, default, false),
        (&vital, &base(), default, true),
    ]);
}

#[test]
fn enumerated_keys_have_all_literals_of_the_writer() {
    let keyed = |values: &[i32], key| {
        let literal = |value: &i32| Literal {
            name: ["A", "B", "C"][*value as usize],
            value: *value,
            default: false,
        };
        let literals: Vec<_> = values.iter().map(literal).collect();
        TypeBuilder::describe(|types| {
            types.define("T", |types| {
                let color = types.define("E", |_| {
                    Some(Definition::Enum {
                        extensibility: Extensibility::Appendable,
                        bit_bound: 32,
                        literals,
                    })
                })?;
                let color = StructMember {
                    key,
                    ..StructMember::new("color", 0, color)
                };
                Some(Definition::Struct {
                    extensibility: Extensibility::Appendable,
                    autoid_hash: false,
                    base: None,
                    members: vec![color],
                })
            })
        })
    };
    let policy = TypeConsistency::default();
    for (key, expected) in [(true, Assignable::No), (false, Assignable::Yes)] {
        let (two, three) = (keyed(&[0, 1], key), keyed(&[0, 1, 2], key));
        assert_eq!(assignable(&two, &three, policy), expected);
        assert_eq!(assignable(&three, &two, policy), Assignable::Yes);
    }
}

/// A struct is what it inherits and what it has, however that is divided.
#[test]
fn inherited_members_are_members() {
    let inheriting = |inherited: Vec<StructMember>, own: Vec<StructMember>| {
        TypeBuilder::describe(|types| {
            types.define("Child", |types| {
                let definition = |base, members| Definition::Struct {
                    extensibility: Extensibility::Appendable,
                    autoid_hash: false,
                    base,
                    members,
                };
                let base = types.define("Parent", |_| Some(definition(None, inherited)))?;
                Some(definition(Some(base), own))
            })
        })
    };
    let policy = TypeConsistency::default();
    let flat = structure(Extensibility::Appendable, longer());
    for at in 0..=longer().len() {
        let (inherited, own) = (longer()[..at].to_vec(), longer()[at..].to_vec());
        let child = inheriting(inherited, own);
        assert_eq!(assignable(&child, &flat, policy), Assignable::Yes, "{at}");
        assert_eq!(assignable(&flat, &child, policy), Assignable::Yes, "{at}");
    }
    let other = inheriting(vec![member(0, "key", long())], longer()[1..].to_vec());
    assert_eq!(assignable(&other, &flat, policy), Assignable::No);
}

/// Types from the wire may nest deeper than what is looked into: names decide then.
#[test]
fn depth_is_bounded() {
    let mut library = TypeLibrary::default();
    let mut chain = |end: TypePair| {
        let mut first = end.clone();
        let support = TypeBuilder::describe(|types| {
            for _ in 0..100 {
                first = types.define("T", |_| Some(Definition::Alias(first.clone())))?;
            }
            Some(first.clone())
        });
        library.add_mapping(&support.objects).unwrap();
        first.of(Equivalence::Minimal).clone()
    };
    let (reader, writer) = (chain(long()), chain(TypePair::primitive(TypeKind::INT64)));
    let result = library.is_assignable(&reader, &writer, &TypeConsistency::default());
    let Assignable::Unknown(missing) = result else {
        panic!("{result:?}");
    };
    assert!(missing.is_empty());
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
