//! Samples are those that Cyclone DDS sends of the same values: `cyclone/values.idl` says how.
//!
//! Those of Fast DDS were written with Fast-CDR 2.3.3 (it is in PyPI's ros-fastcdr), each type by the calls that
//! Fast DDS-Gen makes of its IDL. Where final types, and appendable ones in XCDR2, have but one, both write the same.

use super::{hex, payload_of};
use crate::DdsType;
use crate::cdr::{DdsType, Representation, from_payload};

#[derive(Debug, Clone, PartialEq, DdsType)]
enum Color {
    Red,
    Green,
    Blue,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
struct Inner {
    tag: u8,
    b: f64,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
struct Point {
    x: i32,
    y: i16,
}

#[derive(Debug, Clone, PartialEq, DdsType)]
enum Choice {
    Num(i64),
    Text(String),
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
struct Plain {
    flag: bool,
    letter: char,
    byte: u8,
    s: i16,
    ull: u64,
    f: f32,
    d: f64,
    name: String,
    #[dds(bound = 20)]
    short_name: String,
    shorts: Vec<i16>,
    strings: Vec<String>,
    matrix: [[i32; 3]; 2],
    inner_array: [Inner; 2],
    tint: Color,
    inners: Vec<Inner>,
}

#[derive(Debug, PartialEq, DdsType)]
struct Appendable {
    byte: u8,
    body: Plain,
    p: Point,
    points: Vec<Point>,
    maybe: Option<i32>,
    absent: Option<i32>,
    picked: Choice,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct Mutable {
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
    absent: Option<i32>,
    there: Option<f64>,
    picked: Choice,
    small_array: [u8; 3],
    tint: Color,
}

fn inners() -> [Inner; 2] {
    [Inner { tag: 1, b: 0.5 }, Inner { tag: 2, b: -1.5 }]
}

fn points() -> Vec<Point> {
    vec![Point { x: 3, y: 4 }, Point { x: -5, y: -6 }]
}

fn plain() -> Plain {
    Plain {
        flag: true,
        letter: 'x',
        byte: 7,
        s: -2,
        ull: 0x0102_0304_0506_0708,
        f: 1.5,
        d: -2.25,
        name: "name".to_owned(),
        short_name: "short".to_owned(),
        shorts: vec![-1, 2, 3],
        strings: vec!["one".to_owned(), String::new()],
        matrix: [[1, 2, 3], [4, 5, 6]],
        inner_array: inners(),
        tint: Color::Blue,
        inners: inners().to_vec(),
    }
}

#[track_caller]
fn assert_sample<T: DdsType + PartialEq + std::fmt::Debug>(
    value: &T,
    representation: Representation,
    sample: &str,
) {
    let mut sample = hex(sample);
    assert_eq!(from_payload::<T>(&sample).as_ref(), Ok(value));
    let payload = payload_of(value, representation);
    // The padding at the end, and its count in the options, are left out by one or the other.
    sample[3] = payload[3];
    sample.resize(payload.len(), 0);
    assert_eq!(payload, sample);
}

#[test]
fn final_types() {
    assert_sample(&plain(), Representation::Xcdr1, PLAIN_XCDR1);
    assert_sample(&plain(), Representation::Xcdr2, PLAIN_XCDR2);
}

#[test]
fn appendable_types() {
    let value = appendable();
    assert_sample(&value, Representation::Xcdr2, APPENDABLE_XCDR2);
    assert_sample(&value, Representation::Xcdr1, APPENDABLE_XCDR1_FAST_DDS);
}

fn appendable() -> Appendable {
    Appendable {
        byte: 1,
        body: plain(),
        p: points().remove(0),
        points: points(),
        maybe: Some(9),
        absent: None,
        picked: Choice::Text("picked".to_owned()),
    }
}

#[test]
fn mutable_types() {
    let value = mutable();
    assert_sample(&value, Representation::Xcdr2, MUTABLE_XCDR2);
    // The size of a nested type's DHEADER may serve as the member's as well.
    assert_eq!(
        from_payload(&hex(MUTABLE_XCDR2_FAST_DDS)).as_ref(),
        Ok(&value)
    );
    // Keys and the end of the list must be understood, which Fast DDS does not say.
    let mut sample = hex(MUTABLE_XCDR1_FAST_DDS);
    assert_eq!(from_payload(&sample).as_ref(), Ok(&value));
    let end = sample.len() - 3;
    sample[5] |= 0x40;
    sample[end] |= 0x40;
    assert_eq!(payload_of(&value, Representation::Xcdr1), sample);
}

fn mutable() -> Mutable {
    Mutable {
        id_key: -8,
        s: 5,
        ll: -6,
        text: "text".to_owned(),
        bytes: vec![1, 2, 3],
        longs: vec![4, 5],
        doubles: vec![0.125],
        p: points().remove(1),
        points: points(),
        absent: None,
        there: Some(3.5),
        picked: Choice::Text("picked".to_owned()),
        small_array: [1, 2, 3],
        tint: Color::Green,
    }
}

const PLAIN_XCDR1: &str = "\
    0001000001780700feff000008070605040302010000c03f0000000000000000000002c005000000 \
    6e616d65000000000600000073686f727400000003000000ffff0200030000000200000004000000 \
    6f6e6500010000000000000001000000020000000300000004000000050000000600000001000000 \
    00000000000000000000e03f0200000000000000000000000000f8bf020000000200000001000000 \
    00000000000000000000e03f0200000000000000000000000000f8bf";

const PLAIN_XCDR2: &str = "\
    0007000001780700feff000008070605040302010000c03f00000000000002c0050000006e616d65 \
    000000000600000073686f727400000003000000ffff020003000000110000000200000004000000 \
    6f6e6500010000000000000001000000020000000300000004000000050000000600000018000000 \
    01000000000000000000e03f02000000000000000000f8bf020000001c0000000200000001000000 \
    000000000000e03f02000000000000000000f8bf";

const APPENDABLE_XCDR2: &str = "\
    00090001f700000001017807feff000008070605040302010000c03f00000000000002c005000000 \
    6e616d65000000000600000073686f727400000003000000ffff0200030000001100000002000000 \
    040000006f6e65000100000000000000010000000200000003000000040000000500000006000000 \
    1800000001000000000000000000e03f02000000000000000000f8bf020000001c00000002000000 \
    01000000000000000000e03f02000000000000000000f8bf0600000003000000040000001a000000 \
    0200000006000000030000000400000006000000fbfffffffaff010009000000000000000f000000 \
    01000000070000007069636b65640000";

const MUTABLE_XCDR2: &str = "\
    000b0000cc000000070000a0f8ffffff080000100500000009000030faffffffffffffff0a000050 \
    0500000074657874000000000b00005003000000010203000c000060020000000400000005000000 \
    0d00007001000000000000000000c03f0e0000400a00000006000000fbfffffffaff00000f000050 \
    1a0000000200000006000000030000000400000006000000fbfffffffaff00001100003000000000 \
    00000c4012000040130000000f00000001000000070000007069636b656400001300004003000000 \
    010203001400002001000000";

const APPENDABLE_XCDR1_FAST_DDS: &str = "\
    0001000001017807feff000008070605040302010000c03f0000000000000000000002c005000000 \
    6e616d65000000000600000073686f727400000003000000ffff0200030000000200000004000000 \
    6f6e6500010000000000000001000000020000000300000004000000050000000600000001000000 \
    00000000000000000000e03f0200000000000000000000000000f8bf020000000200000001000000 \
    00000000000000000000e03f0200000000000000000000000000f8bf030000000400000002000000 \
    0300000004000000fbfffffffaff000004000400090000000500000001000000070000007069636b \
    656400";

const MUTABLE_XCDR1_FAST_DDS: &str = "\
    0003000007000400f8ffffff080002000500000009000800faffffffffffffff0a00090005000000 \
    74657874000000000b00070003000000010203000c000c000200000004000000050000000d001000 \
    0100000000000000000000000000c03f0e000600fbfffffffaff00000f0012000200000003000000 \
    04000000fbfffffffaff0000110008000000000000000c4012000f0001000000070000007069636b \
    6564000013000300010203001400040001000000023f0000";

const MUTABLE_XCDR2_FAST_DDS: &str = "\
    000b0000c400000007000020f8ffffff080000100500000009000030faffffffffffffff0a000050 \
    0500000074657874000000000b00005003000000010203000c000060020000000400000005000000 \
    0d00007001000000000000000000c03f0e00005006000000fbfffffffaff00000f0000501a000000 \
    0200000006000000030000000400000006000000fbfffffffaff0000110000300000000000000c40 \
    120000500f00000001000000070000007069636b6564000013000040030000000102030014000020 \
    01000000";
