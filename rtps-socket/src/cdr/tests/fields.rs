//! What content filters see of a value, and of a type.

use std::collections::BTreeMap;

use super::*;
use crate::cdr::{CdrType, FieldType, Fields, Kind, Value};

#[derive(DdsType, Clone, Debug, PartialEq)]
struct Everything {
    #[dds(key)]
    name: String,
    #[dds(key)]
    place: Place,
    fill: Fill,
    r#type: u8,
    #[dds(name = "little")]
    small: i16,
    large: u64,
    ratio: f32,
    letter: char,
    is_new: bool,
    note: Option<String>,
    legs: Vec<Place>,
    grid: [[i32; 2]; 2],
    next: Option<Box<Self>>,
    shape: Shape,
    #[dds(non_serialized)]
    local: i32,
    table: BTreeMap<u8, u8>,
}

#[derive(DdsType, Clone, Debug, PartialEq)]
struct Place {
    #[dds(key)]
    x: i32,
    y: f64,
}

#[derive(DdsType, Clone, Copy, Debug, PartialEq)]
#[dds(bit_bound = 8)]
enum Fill {
    #[dds(name = "EMPTY")]
    Empty = -1,
    Solid = 3,
}

#[derive(DdsType, Clone, Debug, PartialEq)]
enum Shape {
    Round(f64),
    #[dds(case = 7, case = 8, name = "named")]
    Named(Place),
    #[dds(default)]
    Other,
}

fn everything() -> Everything {
    let place = |x| Place { x, y: 0.5 };
    Everything {
        name: "one".into(),
        place: place(1),
        fill: Fill::Empty,
        r#type: 200,
        small: -2,
        large: u64::MAX,
        ratio: 0.25,
        letter: 'x',
        is_new: true,
        note: None,
        legs: vec![place(2), place(3)],
        grid: [[1, 2], [3, 4]],
        next: None,
        shape: Shape::Named(place(4)),
        local: 5,
        table: BTreeMap::from([(1, 1)]),
    }
}

#[derive(DdsType, Clone, Debug, PartialEq)]
#[dds(discriminator = "Fill")]
enum Filled {
    #[dds(case = Fill::Empty)]
    Nothing,
    #[dds(case = Fill::Solid)]
    Color(String),
}

#[derive(DdsType, Clone, Debug, PartialEq)]
#[dds(discriminator = "char")]
enum Lettered {
    #[dds(case = 'x')]
    X(i32),
}

#[test]
fn discriminators_have_the_values_of_their_type() {
    let color = Filled::Color("BLUE".into());
    assert_eq!(color.field(&["discriminator"]), Some(Value::Int(3)));
    assert_eq!(color.field(&["Color"]), Some(Value::Str("BLUE")));
    assert_eq!(Filled::Nothing.field(&["_d"]), Some(Value::Int(-1)));
    assert_eq!(Filled::Nothing.field(&["Color"]), None);
    assert_eq!(Filled::type_at(&["_d"]), Fill::type_at(&[]));
    assert_eq!(Lettered::X(1).field(&["_d"]), Some(Value::Char('x')));
    assert_eq!(Lettered::X(1).field(&["X"]), Some(Value::Int(1)));
}

#[test]
fn members_have_their_values() {
    let mut outer = everything();
    outer.next = Some(Box::new(everything()));
    outer.note = Some("here".into());
    let values: [(&[&str], _); 15] = [
        (&["name"], Value::Str("one")),
        (&["place", "x"], Value::Int(1)),
        (&["fill"], Value::Int(-1)),
        (&["type"], Value::UInt(200)),
        (&["little"], Value::Int(-2)),
        (&["large"], Value::UInt(u64::MAX)),
        (&["ratio"], Value::Float(0.25)),
        (&["letter"], Value::Char('x')),
        (&["is_new"], Value::Bool(true)),
        (&["note"], Value::Str("here")),
        (&["legs", "1", "x"], Value::Int(3)),
        (&["grid", "1", "0"], Value::Int(3)),
        (&["next", "name"], Value::Str("one")),
        (&["shape", "_d"], Value::Int(7)),
        (&["shape", "named", "y"], Value::Float(0.5)),
    ];
    for (path, value) in values {
        assert_eq!(outer.field(path), Some(value), "{path:?}");
    }
}

#[test]
fn what_is_not_there_has_no_value() {
    let value = everything();
    let paths: [&[&str]; 12] = [
        &[],
        &["nothing"],
        &["name", "x"],
        &["place"],
        &["note"],
        &["legs"],
        &["legs", "2", "x"],
        &["legs", "-1", "x"],
        &["next", "name"],
        &["shape", "Round"],
        &["local"],
        &["table", "1"],
    ];
    for path in paths {
        assert_eq!(value.field(path), None, "{path:?}");
    }
}

#[test]
fn types_tell_of_members_that_are_absent_and_of_keys() {
    let literals: &[(&str, i64)] = &[("EMPTY", -1), ("Solid", 3)];
    let types: [(&[&str], _, _); 9] = [
        (&["name"], Kind::String, true),
        (&["place", "x"], Kind::Integer, true),
        (&["place", "y"], Kind::Float, false),
        (&["ratio"], Kind::Float32, false),
        (&["fill"], Kind::Enum(literals), false),
        (&["note"], Kind::String, false),
        (&["legs", "99", "x"], Kind::Integer, false),
        (&["next", "next", "name"], Kind::String, false),
        (&["shape", "discriminator"], Kind::Integer, false),
    ];
    for (path, kind, is_key) in types {
        let found = Everything::type_at(path);
        assert_eq!(found, Some(FieldType { kind, is_key }), "{path:?}");
    }
    for path in [
        &["nothing"][..],
        &["place"],
        &["legs", "x"],
        &["local"],
        &[],
    ] {
        assert_eq!(Everything::type_at(path), None, "{path:?}");
    }
}

mod filters {
    use rtps_user::qos::ContentFilter;
    use rtps_user::wire::PayloadKind;

    use super::*;
    use crate::cdr::{Representation, key_payload, to_payload};
    use crate::filter::{BindError, Expression, announced_filter, bind, payload_filter};

    fn passes(text: &str, kind: PayloadKind, payload: &[u8]) -> bool {
        let expression = Expression::parse(text, &[]).unwrap();
        payload_filter::<Everything>(bind::<Everything>(expression).unwrap())(kind, payload)
    }

    #[test]
    fn data_and_keys_are_judged_by_what_they_hold() {
        let (mut data, mut key) = (Vec::new(), Vec::new());
        let sample = Everything {
            ratio: 0.1,
            ..everything()
        };
        to_payload(&sample, Representation::Xcdr2, &mut data).unwrap();
        key_payload(&everything(), Representation::Xcdr1, &mut key).unwrap();
        for (text, of_data, of_key) in [
            ("name = 'one'", true, true),
            ("ratio = 0.1 AND letter <= 'xy'", true, true),
            ("name = 'two'", false, false),
            ("place.x > 1", false, false),
            // Not in the key, or not alone.
            ("place.y > 1", false, true),
            ("name = 'two' AND little = 0", false, true),
            ("fill = EMPTY AND shape.named.x = 4", true, true),
        ] {
            assert_eq!(passes(text, PayloadKind::Data, &data), of_data, "{text}");
            assert_eq!(passes(text, PayloadKind::Key, &key), of_key, "{text}");
            assert!(passes(text, PayloadKind::None, &[]));
            assert!(passes(text, PayloadKind::Data, &data[..data.len() / 2]));
        }
    }

    #[test]
    fn what_a_remote_reader_wants_is_understood_or_left_to_it() {
        let filter = |class: &str, expression: &str| ContentFilter {
            name: "filtered".into(),
            related_topic: "topic".into(),
            class: class.into(),
            expression: expression.into(),
            parameters: vec!["'one'".into()],
        };
        let is_understood =
            |class, text| announced_filter::<Everything>(&filter(class, text)).is_some();
        assert!(is_understood("DDSSQL", "name = %0"));
        assert!(!is_understood("DDSSQL", "name MATCH %0"));
        assert!(is_understood("DDSSQL+FNMATCH", "name MATCH %0"));
        assert!(!is_understood("DDSSTRINGMATCH", "name = %0"));
        assert!(!is_understood("DDSSQL", "name = %1"));
        assert!(!is_understood("DDSSQL", "colour = %0"));
        assert!(!is_understood("DDSSQL", "name resembles %0"));
    }

    #[test]
    fn members_of_other_types_are_unknown() {
        let expression = Expression::parse("place.z = 1", &[]).unwrap();
        assert_eq!(
            bind::<Everything>(expression),
            Err(BindError::UnknownMember("place.z".into()))
        );
    }
}
