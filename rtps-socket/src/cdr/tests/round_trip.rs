//! What is written is read back, whatever the representation and byte order; and whatever is read,
//! nothing panics.

use proptest::collection::{btree_map, hash_map, vec};
use proptest::option;
use proptest::prelude::*;

use super::{
    Color, Everything, Level, Mutable, Node, Optional, REPRESENTATIONS, Shape, ShapeType,
    payload_in,
};
use crate::cdr::{ByteOrder, from_key_payload, from_payload, key_hash, key_payload};

/// A value with something in every collection.
pub(super) fn everything() -> Everything {
    let node = Node {
        value: 1,
        next: None,
        children: vec![],
    };
    Everything {
        flags: vec![true],
        letter: 'x',
        bytes: vec![1, 2, 3],
        shorts: vec![-1],
        words: vec![1, 2],
        doubles: vec![0.5],
        matrix: [[1, 2, 3], [4, 5, 6]],
        strings: vec!["one".to_owned(), String::new()],
        colors: [Color::Red, Color::Blue],
        level: Level::High,
        shapes: vec![Shape::Circle(2.0), Shape::Label("l".to_owned())],
        inner: Mutable {
            a: 1,
            b: Some(2),
            s: "s".to_owned(),
        },
        optionals: vec![Optional {
            f0: 1,
            f1: Some(2),
            f2: 3,
            k: 4,
        }],
        map: [(1, "m".to_owned())].into(),
        plain_map: [(1, 2.0)].into(),
        node: Node {
            value: 2,
            next: Some(Box::new(node.clone())),
            children: vec![node],
        },
        square: Some(super::square()),
    }
}

fn text() -> impl Strategy<Value = String> {
    "[^\0]{0,12}"
}

fn color() -> impl Strategy<Value = Color> {
    prop_oneof![Just(Color::Red), Just(Color::Green), Just(Color::Blue)]
}

fn shape() -> impl Strategy<Value = Shape> {
    prop_oneof![
        any::<i32>().prop_map(|radius| Shape::Circle(radius.into())),
        text().prop_map(Shape::Label),
        Just(Shape::Nothing),
    ]
}

prop_compose! {
    fn shape_type()(
        color in text(),
        x in any::<i32>(),
        shapesize in any::<i32>(),
        additional_payload_size in vec(any::<u8>(), 0..20),
    ) -> ShapeType {
        ShapeType { color, x, y: !x, shapesize, additional_payload_size }
    }
}

prop_compose! {
    fn mutable()(a in any::<u32>(), b in option::of(any::<u64>()), s in text()) -> Mutable {
        Mutable { a, b, s }
    }
}

prop_compose! {
    fn optional()(
        f0 in any::<u32>(),
        f1 in option::of(any::<i32>()),
        f2 in any::<u64>(),
        k in any::<u32>(),
    ) -> Optional {
        Optional { f0, f1, f2, k }
    }
}

fn node() -> impl Strategy<Value = Node> {
    let leaf = any::<u16>().prop_map(|value| Node {
        value,
        next: None,
        children: vec![],
    });
    leaf.prop_recursive(4, 16, 3, |inner| {
        let next = option::of(inner.clone().prop_map(Box::new));
        (any::<u16>(), next, vec(inner, 0..3)).prop_map(|(value, next, children)| Node {
            value,
            next,
            children,
        })
    })
}

prop_compose! {
    fn primitives()(
        flags in vec(any::<bool>(), 0..4),
        letter in (0u8..).prop_map(char::from),
        bytes in vec(any::<u8>(), 0..9),
        shorts in vec(any::<i16>(), 0..9),
        words in vec(any::<u32>(), 0..9),
        doubles in vec(any::<i32>().prop_map(f64::from), 0..9),
        matrix in any::<[[i16; 3]; 2]>(),
    ) -> Everything {
        Everything { flags, letter, bytes, shorts, words, doubles, matrix, ..everything() }
    }
}

prop_compose! {
    fn any_everything()(
        primitives in primitives(),
        strings in vec(text(), 0..4),
        colors in [color(), color()],
        shapes in vec(shape(), 0..4),
        inner in mutable(),
        optionals in vec(optional(), 0..4),
        map in btree_map(any::<u16>(), text(), 0..4),
        plain_map in hash_map(any::<u8>(), any::<i16>().prop_map(f32::from), 0..4),
        node in node(),
        square in option::of(shape_type()),
    ) -> Everything {
        Everything {
            strings,
            colors,
            shapes,
            inner,
            optionals,
            map,
            plain_map,
            node,
            square,
            ..primitives
        }
    }
}

proptest! {
    #[test]
    fn nested_types(value in any_everything()) {
        for representation in REPRESENTATIONS {
            for byte_order in [ByteOrder::Little, ByteOrder::Big] {
                let payload = payload_in(&value, representation, byte_order);
                prop_assert_eq!(payload.len() % 4, 0);
                let read = from_payload(&payload);
                prop_assert_eq!(read.as_ref(), Ok(&value));
            }
        }
    }

    #[test]
    fn keys(value in shape_type()) {
        for representation in REPRESENTATIONS {
            let mut payload = Vec::new();
            key_payload(&value, representation, &mut payload).unwrap();
            let key: ShapeType = from_key_payload(&payload).unwrap();
            prop_assert_eq!(&key.color, &value.color);
            let hash = |value| key_hash(value, representation, &mut Vec::new()).unwrap();
            prop_assert_eq!(hash(&key), hash(&value));
        }
    }

    #[test]
    fn garbage(id in 0u8..12, options in any::<u8>(), body in vec(any::<u8>(), 0..200)) {
        let payload = [vec![0, id, 0, options], body].concat();
        let _ = from_payload::<Everything>(&payload);
        let _ = from_payload::<Node>(&payload);
        let _ = from_payload::<Optional>(&payload);
        let _ = from_key_payload::<ShapeType>(&payload);
    }

    #[test]
    fn damage(at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        for representation in REPRESENTATIONS {
            let mut payload = payload_in(&everything(), representation, ByteOrder::Little);
            let at = at.index(payload.len());
            payload[at] = byte;
            let _ = from_payload::<Everything>(&payload);
        }
    }
}
