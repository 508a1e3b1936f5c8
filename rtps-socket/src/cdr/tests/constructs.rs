//! What IDL has besides plain members: inheritance, wide strings, bitmasks and bitsets, typedefs, and what becomes of
//! values that a type does not have.

use std::collections::BTreeMap;

use super::{Color, REPRESENTATIONS, hex, payload_in, payload_of};
use crate::DdsType;
use crate::cdr::{
    ByteOrder, CdrType, DdsType, DecodeError, EncodeError, Fields, LongDouble, Representation,
    Struct, TypeSupport, Value, WChar, WString, from_key_payload, from_payload, key_hash,
    key_payload, to_payload,
};

#[track_caller]
fn assert_round_trip<T: DdsType + PartialEq + std::fmt::Debug>(value: &T) {
    for representation in REPRESENTATIONS {
        for byte_order in [ByteOrder::Little, ByteOrder::Big] {
            let payload = payload_in(value, representation, byte_order);
            assert_eq!(from_payload(&payload).as_ref(), Ok(value));
        }
    }
}

fn hash<T: DdsType>(value: &T) -> [u8; 16] {
    key_hash(value, Representation::Xcdr1, &mut Vec::new()).unwrap()
}

macro_rules! family {
    ($extensibility:ident, $module:ident) => {
        mod $module {
            use crate::DdsType;

            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Grandparent {
                #[dds(key)]
                pub(super) id: u16,
                pub(super) name: String,
            }

            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Parent {
                #[dds(base)]
                pub(super) base: Grandparent,
            }

            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Child {
                #[dds(base)]
                pub(super) base: Parent,
                pub(super) age: Option<u32>,
                pub(super) ratio: f64,
            }

            /// The same members, declared by itself.
            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Flat {
                #[dds(key)]
                pub(super) id: u16,
                pub(super) name: String,
                pub(super) age: Option<u32>,
                pub(super) ratio: f64,
            }
        }

        #[test]
        fn $module() {
            use $module::{Child, Flat, Grandparent, Parent};
            let base = Parent {
                base: Grandparent {
                    id: 7,
                    name: "seven".to_owned(),
                },
            };
            let child = Child {
                base,
                age: Some(8),
                ratio: 0.5,
            };
            let flat = Flat {
                id: 7,
                name: "seven".to_owned(),
                age: Some(8),
                ratio: 0.5,
            };
            assert_round_trip(&child);
            for representation in REPRESENTATIONS {
                let payload = payload_of(&child, representation);
                assert_eq!(payload, payload_of(&flat, representation));
                let (mut key, mut expected) = (Vec::new(), Vec::new());
                key_payload(&child, representation, &mut key).unwrap();
                key_payload(&flat, representation, &mut expected).unwrap();
                assert_eq!(key, expected);
                let read: Child = from_key_payload(&key).unwrap();
                assert_eq!(read.base.base.id, 7);
            }
            assert_eq!(hash(&child), hash(&flat));
            assert!(Child::HAS_KEY);
            assert_eq!(child.field(&["id"]), Some(Value::UInt(7)));
            assert_eq!(child.field(&["base"]), None);
            assert!(Child::type_at(&["id"]).unwrap().is_key);
            assert!(!Child::type_at(&["name"]).unwrap().is_key);
            assert!(!Child::type_at(&["age"]).unwrap().is_key);
            assert_eq!(Child::MEMBER_IDS.next(), 4);
        }
    };
}

family!(final, inherited_members_of_final_types);
family!(appendable, inherited_members_of_appendable_types);
family!(mutable, inherited_members_of_mutable_types);

#[derive(Debug, PartialEq, DdsType)]
struct Unkeyed {
    x: i16,
}

#[derive(Debug, PartialEq, DdsType)]
struct KeyedChild {
    #[dds(base)]
    base: Unkeyed,
    #[dds(key)]
    id: u32,
}

#[test]
fn a_key_of_the_child_alone() {
    let value = KeyedChild {
        base: Unkeyed { x: 1 },
        id: 5,
    };
    assert_round_trip(&value);
    assert_eq!(hash(&value), *hex("00000005 000000000000000000000000"));
    let mut key = Vec::new();
    key_payload(&value, Representation::Xcdr2, &mut key).unwrap();
    let read: KeyedChild = from_key_payload(&key).unwrap();
    assert_eq!((read.base.x, read.id), (0, 5));
    assert!(!KeyedChild::type_at(&["x"]).unwrap().is_key);
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct Wide {
    first: WChar,
    #[dds(bound = 4)]
    text: WString,
    texts: Vec<WString>,
    units: [WChar; 2],
    number: LongDouble,
}

#[test]
fn wide_characters_and_long_double() {
    let value = Wide {
        first: WChar::try_from('\u{e4}').unwrap(),
        text: "a\u{1f600}".into(),
        texts: vec!["".into(), "b".into()],
        units: [WChar(1), WChar(2)],
        number: LongDouble(0x0f0e_0d0c_0b0a_0908_0706_0504_0302_0100),
    };
    assert_round_trip(&value);
    let payload = payload_of(&value, Representation::Xcdr1);
    let expected = "00010000 e4000000 06000000 61003dd8 00de0000 02000000 00000000 02000000 6200 \
                    0100 0200 0000 00000000 00010203 04050607 08090a0b 0c0d0e0f";
    assert_eq!(payload, hex(expected));
    let big = payload_in(&value, Representation::Xcdr1, ByteOrder::Big);
    assert_eq!(big[8..18], hex("00000006 0061d83dde00"));
    let long = Wide {
        text: "abcde".into(),
        ..value
    };
    let result = to_payload(&long, Representation::Xcdr1, &mut Vec::new());
    assert!(matches!(result, Err(EncodeError::BoundExceeded(_))));
    assert_eq!(
        WChar::try_from('\u{1f600}'),
        Err(EncodeError::WCharOutOfRange('\u{1f600}'))
    );
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct WideText {
    text: WString,
}

#[test]
fn what_is_no_wide_string() {
    for (payload, expected) in [
        ("00010000 03000000 610062", DecodeError::InvalidWString),
        ("00010000 02000000 0000", DecodeError::InvalidWString),
        ("00010000 02000000 3dd8", DecodeError::InvalidWString),
        (
            "00010000 04000000 6100",
            DecodeError::CountTooLarge {
                count: 4,
                remaining: 2,
            },
        ),
    ] {
        assert_eq!(from_payload::<WideText>(&hex(payload)), Err(expected));
    }
}

#[derive(Debug, Clone, Copy, PartialEq, DdsType)]
#[dds(bitmask, bit_bound = 12)]
struct Mask {
    low: bool,
    #[dds(position = 11)]
    high: bool,
    #[dds(position = 4)]
    middle: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, DdsType)]
#[dds(bitset)]
struct Set {
    #[dds(bits = 3)]
    small: u8,
    flag: bool,
    #[dds(bits = 4, position = 6)]
    signed: i8,
    #[dds(bits = 20)]
    large: u32,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
struct Bits {
    #[dds(key)]
    mask: Mask,
    set: Set,
    masks: Vec<Mask>,
}

#[test]
fn bitmasks_and_bitsets() {
    let mask = Mask {
        low: true,
        high: true,
        middle: false,
    };
    let value = Bits {
        mask,
        set: Set {
            small: 5,
            flag: true,
            signed: -2,
            large: 0xf_0001,
        },
        masks: vec![mask],
    };
    assert_round_trip(&value);
    // 0x801; 5 | 1 << 3 | 0b1110 << 6 | 0xf0001 << 10.
    let expected = "00070002 01080000 8d07003c 06000000 01000000 01080000";
    assert_eq!(payload_of(&value, Representation::Xcdr2), hex(expected));
    assert_eq!(hash(&value)[..2], [8, 1]);
    let mut beyond = value;
    beyond.set.signed = 8;
    let result = to_payload(&beyond, Representation::Xcdr1, &mut Vec::new());
    let expected = EncodeError::BitsExceeded {
        member: "signed",
        bits: 4,
    };
    assert_eq!(result, Err(expected));
    assert_ne!(Bits::type_support(), TypeSupport::default());
}

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Meters(f64);

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Name(#[dds(bound = 3)] String);

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Typedefs {
    #[dds(key)]
    name: Name,
    far: Vec<Meters>,
    near: [Meters; 2],
    maybe: Option<Name>,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Plain {
    #[dds(key, bound = 3)]
    name: String,
    far: Vec<f64>,
    near: [f64; 2],
    #[dds(bound = 3)]
    maybe: Option<String>,
}

#[test]
fn typedefs_are_nothing_on_the_wire() {
    let name = Name("abc".to_owned());
    let value = Typedefs {
        name: name.clone(),
        far: vec![Meters(1.0)],
        near: [Meters(2.0), Meters(3.0)],
        maybe: Some(name),
    };
    let plain = Plain {
        name: "abc".to_owned(),
        far: vec![1.0],
        near: [2.0, 3.0],
        maybe: Some("abc".to_owned()),
    };
    assert_round_trip(&value);
    for representation in REPRESENTATIONS {
        let payload = payload_of(&value, representation);
        assert_eq!(payload, payload_of(&plain, representation));
    }
    assert_eq!(hash(&value), hash(&plain));
    assert_eq!(value.field(&["name"]), Some(Value::Str("abc")));
    let long = Typedefs {
        name: Name("abcd".to_owned()),
        ..value
    };
    assert!(to_payload(&long, Representation::Xcdr1, &mut Vec::new()).is_err());
}

macro_rules! strict_and_lenient {
    ($extensibility:ident, $module:ident) => {
        mod $module {
            use std::collections::BTreeMap;

            use super::{Color, WString};
            use crate::DdsType;

            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Sent {
                pub(super) text: String,
                pub(super) wide: WString,
                pub(super) list: Vec<u16>,
                pub(super) map: BTreeMap<u8, u8>,
                pub(super) number: u32,
                pub(super) color: i32,
                pub(super) maybe: Option<i32>,
                pub(super) last: u8,
            }

            #[derive(Debug, Clone, PartialEq, DdsType)]
            #[dds($extensibility)]
            pub(super) struct Lenient {
                #[dds(bound = 2, try_construct = "trim")]
                pub(super) text: String,
                #[dds(bound = 2, try_construct = "trim")]
                pub(super) wide: WString,
                #[dds(bound = 2, try_construct = "use_default", default = vec![9])]
                pub(super) list: Vec<u16>,
                #[dds(bound = 1, try_construct = "trim")]
                pub(super) map: BTreeMap<u8, u8>,
                pub(super) number: u32,
                #[dds(try_construct = "use_default", default = Color::Blue)]
                pub(super) color: Color,
                #[dds(try_construct = "use_default")]
                pub(super) maybe: Option<Color>,
                pub(super) last: u8,
            }
        }

        #[test]
        fn $module() {
            use $module::{Lenient, Sent};
            let sent = Sent {
                text: "a\u{e4}".to_owned(),
                wide: "a\u{1f600}".into(),
                list: vec![1, 2, 3],
                map: BTreeMap::from([(1, 2), (3, 4)]),
                number: 5,
                color: 77,
                maybe: Some(78),
                last: 6,
            };
            let expected = Lenient {
                text: "a".to_owned(),
                wide: "a".into(),
                list: vec![9],
                map: BTreeMap::from([(1, 2)]),
                number: 5,
                color: Color::Blue,
                maybe: None,
                last: 6,
            };
            for representation in REPRESENTATIONS {
                let payload = payload_of(&sent, representation);
                assert_eq!(from_payload(&payload), Ok(expected.clone()));
            }
        }
    };
}

strict_and_lenient!(final, what_does_not_fit_final_types);
strict_and_lenient!(appendable, what_does_not_fit_appendable_types);
strict_and_lenient!(mutable, what_does_not_fit_mutable_types);

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct Demanding {
    #[dds(id = 1, must_understand)]
    vital: Option<u8>,
    #[dds(id = 2)]
    other: u8,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct Other {
    #[dds(id = 2)]
    other: u8,
}

#[test]
fn a_member_that_must_be_understood_may_be_absent() {
    for representation in REPRESENTATIONS {
        let (mut vital, other) = (Some(1), 2);
        let payload = payload_of(&Demanding { vital, other }, representation);
        let refused = from_payload::<Other>(&payload);
        assert_eq!(refused, Err(DecodeError::NotUnderstood { id: 1 }));
        vital = None;
        let payload = payload_of(&Demanding { vital, other }, representation);
        assert_eq!(from_payload(&payload), Ok(Other { other }));
        assert_eq!(from_payload(&payload), Ok(Demanding { vital, other }));
    }
}

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Tree {
    value: u8,
    branches: Branches,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
enum Branches {
    Two(Box<[Tree; 2]>),
    Many(Vec<Tree>),
    Named(BTreeMap<String, Tree>),
    #[dds(default)]
    None,
}

#[test]
fn types_that_contain_each_other() {
    let leaf = |value| Tree {
        value,
        branches: Branches::None,
    };
    let two = Tree {
        value: 1,
        branches: Branches::Two(Box::new([leaf(2), leaf(3)])),
    };
    let named = Tree {
        value: 4,
        branches: Branches::Named(BTreeMap::from([("two".to_owned(), two)])),
    };
    assert_round_trip(&Tree {
        value: 5,
        branches: Branches::Many(vec![named, leaf(6)]),
    });
    assert_eq!(Tree::type_support(), TypeSupport::default());
}
