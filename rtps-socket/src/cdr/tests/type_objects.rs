//! TypeObjects are those that Cyclone DDS makes of the same types: `cyclone/types.idl` says how.

use super::hex;
use crate::DdsType;
use crate::cdr::{DdsType, TypeSupport};

#[derive(DdsType)]
#[dds(final, type_name = "demo::Color")]
enum Color {
    #[dds(name = "RED")]
    Red,
    #[dds(name = "GREEN")]
    Green,
    #[dds(name = "BLUE")]
    Blue,
}

#[derive(DdsType)]
#[dds(final, bit_bound = 8, type_name = "demo::Small")]
enum Small {
    A,
    B,
    C,
}

#[derive(DdsType)]
#[dds(final, type_name = "demo::Inner")]
struct Inner {
    a: i32,
    b: f64,
}

#[derive(DdsType)]
#[dds(type_name = "demo::Choice")]
enum Choice {
    #[dds(name = "num")]
    Num(i32),
    #[dds(name = "text", case = 1, case = 2)]
    Text(String),
    #[dds(name = "inner_value", default)]
    Inner(Inner),
}

#[derive(DdsType)]
#[dds(final, type_name = "demo::Tinted", discriminator = "Color")]
enum Tinted {
    #[dds(name = "strength", case = Color::Red)]
    Strength(u8),
    #[dds(name = "remark", case = Color::Blue)]
    Remark(String),
}

#[derive(DdsType)]
#[dds(mutable, type_name = "demo::All")]
struct All {
    #[dds(key, id = 5)]
    id_key: u32,
    flag: bool,
    letter: char,
    byte: u8,
    s: i16,
    us: u16,
    #[dds(id = 3)]
    l: i32,
    ul: u32,
    #[dds(id = 20)]
    ll: i64,
    ull: u64,
    f: f32,
    d: f64,
    name: String,
    #[dds(bound = 20)]
    short_name: String,
    #[dds(bound = 300)]
    long_name: String,
    bytes: Vec<u8>,
    #[dds(bound = 5)]
    few: Vec<i32>,
    #[dds(bound = 300)]
    many: Vec<String>,
    matrix: [[i32; 3]; 2],
    inner_array: [Inner; 4],
    the_color: Color,
    the_small: Small,
    the_inner: Inner,
    the_choice: Choice,
    the_tinted: Tinted,
    inners: Vec<Inner>,
    maybe: Option<i32>,
    maybe_inner: Option<Inner>,
    colors: Vec<Color>,
    nested: Vec<Vec<i32>>,
    large: [f32; 300],
}

#[derive(DdsType)]
#[dds(type_name = "demo::ShapeType")]
struct ShapeType {
    #[dds(key, bound = 128)]
    color: String,
    x: i32,
    y: i32,
    shapesize: i32,
    additional_payload_size: Vec<u8>,
}

/// `int8 a; uint8 b; octet c; sequence<uint8> d; sequence<octet> e; int8 f[3];`, of which Cyclone DDS 11.0.1 says what
/// `eight.*.hex` have: `__idl__._xt_bytedata` of the final type in its Python API, after `get_type_info()`.
#[derive(DdsType)]
#[dds(final, type_name = "demo::Eight")]
struct Eight {
    a: i8,
    #[dds(uint8)]
    b: u8,
    c: u8,
    #[dds(uint8)]
    d: Vec<u8>,
    e: Vec<u8>,
    f: [i8; 3],
}

#[derive(DdsType)]
#[dds(final, type_name = "demo::Base")]
struct Base {
    #[dds(key)]
    a: i32,
    #[dds(bound = 8)]
    b: String,
}

#[derive(DdsType)]
#[dds(final, type_name = "demo::Derived")]
struct Derived {
    #[dds(base)]
    base: Base,
    c: u8,
}

#[derive(DdsType)]
#[dds(bitmask, bit_bound = 8, type_name = "demo::Flags")]
struct Flags {
    #[dds(name = "READY")]
    ready: bool,
    #[dds(name = "BUSY", position = 3)]
    busy: bool,
}

#[derive(DdsType)]
#[dds(type_name = "demo::Celsius")]
struct Celsius(f64);

#[derive(DdsType)]
#[dds(type_name = "demo::Few")]
struct Few(#[dds(bound = 4)] Vec<i32>);

#[derive(DdsType)]
#[dds(type_name = "demo::Room")]
struct Room([Celsius; 2]);

#[derive(DdsType)]
#[dds(mutable, autoid = "hash", type_name = "demo::Hashed")]
struct Hashed {
    color: i32,
    #[dds(hashid = "shapesize")]
    size: i32,
    #[dds(hashid)]
    x: i32,
    #[dds(id = 5, must_understand)]
    y: i32,
}

#[derive(DdsType)]
#[dds(type_name = "demo::Annotated")]
struct Annotated {
    m: i32,
    #[dds(external)]
    e: Box<f64>,
    #[dds(bound = 4)]
    u: String,
    #[dds(bound = 4)]
    t: String,
    #[dds(bound = 4)]
    s: Vec<i32>,
    d: Derived,
    f: Flags,
    warm: Celsius,
    few: Few,
    room: Room,
    h: Hashed,
}

#[test]
fn inheritance_bitmasks_typedefs_and_annotations() {
    let TypeSupport {
        information,
        objects,
    } = Annotated::type_support();
    assert_eq!(objects, hex(include_str!("cyclone/annotated.objects.hex")));
    assert_eq!(
        information,
        hex(include_str!("cyclone/annotated.information.hex"))
    );
}

#[test]
fn types_of_8_bits() {
    let TypeSupport {
        information,
        objects,
    } = Eight::type_support();
    assert_eq!(objects, hex(include_str!("cyclone/eight.objects.hex")));
    assert_eq!(
        information,
        hex(include_str!("cyclone/eight.information.hex"))
    );
}

#[test]
fn a_struct() {
    let TypeSupport {
        information,
        objects,
    } = ShapeType::type_support();
    assert_eq!(objects, hex(include_str!("cyclone/shape.objects.hex")));
    assert_eq!(
        information,
        hex(include_str!("cyclone/shape.information.hex"))
    );
}

#[test]
fn every_kind_of_type() {
    let TypeSupport {
        information,
        objects,
    } = All::type_support();
    assert_eq!(objects, hex(include_str!("cyclone/all.objects.hex")));
    assert_eq!(
        information,
        hex(include_str!("cyclone/all.information.hex"))
    );
}

#[test]
fn a_type_that_refers_to_itself_is_not_described() {
    assert_eq!(super::Node::type_support(), TypeSupport::default());
}
