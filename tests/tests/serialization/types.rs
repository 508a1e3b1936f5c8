//! The types of `peers/Codec.idl`, and any values of them.

use std::collections::BTreeMap;

use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use proptest::{array, option};
use rtps_socket::DdsType;

#[derive(Clone, Copy, Debug, PartialEq, DdsType)]
pub(crate) enum Color {
    Red,
    Green,
    Blue,
}

#[derive(Clone, Copy, Debug, PartialEq, DdsType)]
#[dds(bit_bound = 8)]
pub(crate) enum Small {
    Low,
    High,
}

#[derive(Clone, Copy, Debug, PartialEq, DdsType)]
#[dds(bitmask, bit_bound = 12)]
pub(crate) struct Flags {
    a: bool,
    #[dds(position = 11)]
    b: bool,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
pub(crate) struct Shorts(#[dds(bound = 5)] Vec<i16>);

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Inner {
    tag: u8,
    b: f64,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
pub(crate) struct Point {
    x: i32,
    y: i16,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final, discriminator = "Color")]
pub(crate) enum Number {
    #[dds(case = Color::Red)]
    Num(i64),
    #[dds(case = Color::Green)]
    Text(String),
    #[dds(default, case = Color::Blue)]
    Inner(Inner),
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(discriminator = "u8")]
pub(crate) enum Choice {
    #[dds(case = 1)]
    F(f32),
    #[dds(case = 2, case = 3)]
    Texts(Vec<String>),
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Base {
    #[dds(key)]
    id: i64,
    name: String,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Plain {
    #[dds(base)]
    base: Base,
    flag: bool,
    letter: char,
    byte: u8,
    s: i16,
    ul: u32,
    ull: u64,
    f: f32,
    d: f64,
    #[dds(bound = 20)]
    short_name: String,
    shorts: Shorts,
    strings: Vec<String>,
    doubles: Vec<f64>,
    nested: Vec<Vec<u8>>,
    matrix: [[i32; 3]; 2],
    inner_array: [Inner; 2],
    inners: Vec<Inner>,
    tint: Color,
    small: Small,
    colors: Vec<Color>,
    number: Number,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
pub(crate) struct Extensible {
    first: u8,
    body: Plain,
    bits: Flags,
    masks: Vec<Flags>,
    #[dds(external)]
    p: Box<Point>,
    points: Vec<Point>,
    maybe: Option<i32>,
    maybe_text: Option<String>,
    maybe_point: Option<Point>,
    picked: Choice,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(mutable)]
pub(crate) struct Changing {
    #[dds(key, id = 7)]
    id_key: i32,
    s: i16,
    ll: i64,
    text: String,
    bytes: Vec<u8>,
    longs: Vec<i32>,
    doubles: Vec<f64>,
    p: Point,
    points: Vec<Point>,
    maybe: Option<i32>,
    maybe_inner: Option<Inner>,
    picked: Choice,
    small_array: [u8; 3],
    tint: Color,
    bits: Flags,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Position {
    #[dds(key)]
    row: u8,
    note: String,
    #[dds(key)]
    column: u16,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Located {
    altitude: f64,
    #[dds(key)]
    serial: u64,
    #[dds(key)]
    place: Position,
}

#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Named {
    value: i32,
    #[dds(key)]
    name: String,
    #[dds(key)]
    tint: Color,
}

/// What Fast-CDR has and Cyclone DDS 0.10 has not.
#[derive(Clone, Debug, PartialEq, DdsType)]
#[dds(final)]
pub(crate) struct Collections {
    names: BTreeMap<u16, String>,
    ratios: BTreeMap<u8, f32>,
    places: BTreeMap<String, Point>,
    points: Vec<Point>,
    picked: Choice,
    bits: Flags,
}

fn text() -> impl Strategy<Value = String> {
    "[a-zA-Z0-9\u{e4}]{0,9}"
}

fn color() -> impl Strategy<Value = Color> + Clone {
    prop_oneof![Just(Color::Red), Just(Color::Green), Just(Color::Blue)]
}

/// Numbers that are equal to themselves.
fn double() -> impl Strategy<Value = f64> {
    any::<i32>().prop_map(|number| f64::from(number) / 8.0)
}

fn float() -> impl Strategy<Value = f32> {
    any::<i16>().prop_map(|number| f32::from(number) / 8.0)
}

fn flags() -> impl Strategy<Value = Flags> {
    (any::<bool>(), any::<bool>()).prop_map(|(a, b)| Flags { a, b })
}

fn inner() -> impl Strategy<Value = Inner> {
    (any::<u8>(), double()).prop_map(|(tag, b)| Inner { tag, b })
}

fn point() -> impl Strategy<Value = Point> {
    (any::<i32>(), any::<i16>()).prop_map(|(x, y)| Point { x, y })
}

fn number() -> impl Strategy<Value = Number> {
    prop_oneof![
        any::<i64>().prop_map(Number::Num),
        text().prop_map(Number::Text),
        inner().prop_map(Number::Inner),
    ]
}

fn choice() -> impl Strategy<Value = Choice> {
    prop_oneof![
        float().prop_map(Choice::F),
        vec(text(), 0..3).prop_map(Choice::Texts),
    ]
}

prop_compose! {
    pub(crate) fn any_plain()(
        (id, name) in (any::<i64>(), text()),
        flag in any::<bool>(),
        letter in (0u8..).prop_map(char::from),
        (byte, s, ul, ull) in any::<(u8, i16, u32, u64)>(),
        (f, d) in (float(), double()),
        short_name in text(),
        shorts in vec(any::<i16>(), 0..5).prop_map(Shorts),
        strings in vec(text(), 0..4),
        doubles in vec(double(), 0..4),
        nested in vec(vec(any::<u8>(), 0..4), 0..4),
        matrix in any::<[[i32; 3]; 2]>(),
    )(
        inner_array in array::uniform2(inner()),
        inners in vec(inner(), 0..4),
        tint in color(),
        small in prop_oneof![Just(Small::Low), Just(Small::High)],
        colors in vec(color(), 0..4),
        number in number(),
        (name, short_name, shorts) in Just((name, short_name, shorts)),
        (strings, doubles, nested) in Just((strings, doubles, nested)),
        id in Just(id),
        (flag, letter, byte, s, ul, ull, f, d, matrix) in
            Just((flag, letter, byte, s, ul, ull, f, d, matrix)),
    ) -> Plain {
        Plain {
            base: Base { id, name },
            flag, letter, byte, s, ul, ull, f, d, short_name, shorts, strings, doubles, nested,
            matrix, inner_array, inners, tint, small, colors, number,
        }
    }
}

prop_compose! {
    pub(crate) fn any_extensible()(
        first in any::<u8>(),
        body in any_plain(),
        bits in flags(),
        masks in vec(flags(), 0..4),
        p in point().prop_map(Box::new),
        points in vec(point(), 0..4),
        maybe in option::of(any::<i32>()),
        maybe_text in option::of(text()),
        maybe_point in option::of(point()),
        picked in choice(),
    ) -> Extensible {
        Extensible {
            first, body, bits, masks, p, points, maybe, maybe_text, maybe_point, picked,
        }
    }
}

prop_compose! {
    pub(crate) fn any_changing()(
        (id_key, s, ll) in any::<(i32, i16, i64)>(),
        text in text(),
        (bytes, longs) in (vec(any::<u8>(), 0..5), vec(any::<i32>(), 0..5)),
        doubles in vec(double(), 0..4),
        (p, points) in (point(), vec(point(), 0..4)),
        maybe in option::of(any::<i32>()),
        maybe_inner in option::of(inner()),
        picked in choice(),
        small_array in any::<[u8; 3]>(),
        tint in color(),
        bits in flags(),
    ) -> Changing {
        Changing {
            id_key, s, ll, text, bytes, longs, doubles, p, points, maybe, maybe_inner, picked,
            small_array, tint, bits,
        }
    }
}

prop_compose! {
    pub(crate) fn any_located()(
        altitude in double(),
        (serial, row, column) in any::<(u64, u8, u16)>(),
        note in text(),
    ) -> Located {
        Located { altitude, serial, place: Position { row, note, column } }
    }
}

prop_compose! {
    pub(crate) fn any_named()(
        value in any::<i32>(),
        name in text(),
        tint in color(),
    ) -> Named {
        Named { value, name, tint }
    }
}

prop_compose! {
    pub(crate) fn any_collections()(
        names in btree_map(any::<u16>(), text(), 0..4),
        ratios in btree_map(any::<u8>(), float(), 0..4),
        places in btree_map(text(), point(), 0..4),
        points in vec(point(), 0..4),
        picked in choice(),
        bits in flags(),
    ) -> Collections {
        Collections { names, ratios, places, points, picked, bits }
    }
}
