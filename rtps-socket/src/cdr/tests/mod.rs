//! Types that the tests share: every kind of type, nested in one another.

mod constructs;
mod evolution;
mod fields;
mod hostile;
mod keys;
mod ros;
mod round_trip;
mod samples;
mod type_objects;
mod vectors;

use std::collections::{BTreeMap, HashMap};

use crate::DdsType;
use crate::cdr::{ByteOrder, DdsType, Representation, Scope, payload};

/// The type of the interoperability demonstrations.
#[derive(Debug, Clone, PartialEq, DdsType)]
pub(super) struct ShapeType {
    #[dds(key, bound = 128)]
    pub(super) color: String,
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) shapesize: i32,
    pub(super) additional_payload_size: Vec<u8>,
}

#[derive(Debug, Clone, Copy, PartialEq, DdsType)]
pub(super) enum Color {
    Red,
    Green = 5,
    Blue,
}

#[derive(Debug, Clone, Copy, PartialEq, DdsType)]
#[dds(bit_bound = 8)]
pub(super) enum Level {
    Low = -1,
    High = 1,
    #[dds(default)]
    Unknown = 7,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(discriminator = "u8", final)]
pub(super) enum Shape {
    #[dds(case = 1)]
    Circle(f64),
    #[dds(case = 2, case = 3)]
    Label(String),
    #[dds(default)]
    Nothing,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(mutable, type_name = "demo::Mutable")]
pub(super) struct Mutable {
    #[dds(key, id = 1)]
    pub(super) a: u32,
    pub(super) b: Option<u64>,
    pub(super) s: String,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
pub(super) struct Optional {
    pub(super) f0: u32,
    pub(super) f1: Option<i32>,
    pub(super) f2: u64,
    #[dds(key)]
    pub(super) k: u32,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
pub(super) struct Node {
    pub(super) value: u16,
    pub(super) next: Option<Box<Self>>,
    pub(super) children: Vec<Self>,
}

/// A member of each kind.
#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(mutable)]
pub(super) struct Everything {
    pub(super) flags: Vec<bool>,
    pub(super) letter: char,
    pub(super) bytes: Vec<u8>,
    pub(super) shorts: Vec<i16>,
    pub(super) words: Vec<u32>,
    pub(super) doubles: Vec<f64>,
    pub(super) matrix: [[i16; 3]; 2],
    pub(super) strings: Vec<String>,
    pub(super) colors: [Color; 2],
    #[dds(id = 100)]
    pub(super) level: Level,
    pub(super) shapes: Vec<Shape>,
    #[dds(id = 70_000)]
    pub(super) inner: Mutable,
    pub(super) optionals: Vec<Optional>,
    pub(super) map: BTreeMap<u16, String>,
    pub(super) plain_map: HashMap<u8, f32>,
    pub(super) node: Node,
    pub(super) square: Option<ShapeType>,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
pub(super) struct Generic<T> {
    pub(super) first: T,
    pub(super) rest: Vec<T>,
    #[dds(non_serialized)]
    pub(super) cached: usize,
}

pub(super) const REPRESENTATIONS: [Representation; 2] =
    [Representation::Xcdr1, Representation::Xcdr2];

pub(super) fn square() -> ShapeType {
    ShapeType {
        color: "RED".to_owned(),
        x: 10,
        y: -2,
        shapesize: 30,
        additional_payload_size: vec![1, 2, 3],
    }
}

pub(super) fn payload_in<T: DdsType>(
    value: &T,
    representation: Representation,
    byte_order: ByteOrder,
) -> Vec<u8> {
    let mut out = Vec::new();
    payload::append_payload(value, representation, byte_order, Scope::Sample, &mut out)
        .expect("the value can be encoded");
    out
}

/// The little endian payload.
pub(super) fn payload_of<T: DdsType>(value: &T, representation: Representation) -> Vec<u8> {
    payload_in(value, representation, ByteOrder::Little)
}

pub(super) fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    digits
        .chunks(2)
        .map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}
