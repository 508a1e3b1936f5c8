//! Byte for byte what XTypes 1.3 section 7.4 prescribes, worked out by hand.

use super::{
    Color, Generic, Level, Mutable, Optional, REPRESENTATIONS, Shape, hex, payload_in, payload_of,
    square,
};
use crate::DdsType;
use crate::cdr::{
    BoundExceeded, ByteOrder, DdsType, DecodeError, EncodeError, Representation, from_payload,
    to_payload,
};

#[track_caller]
fn assert_bytes<T: DdsType + PartialEq + std::fmt::Debug>(
    value: &T,
    representation: Representation,
    byte_order: ByteOrder,
    expected: &str,
) {
    let payload = payload_in(value, representation, byte_order);
    assert_eq!(payload, hex(expected));
    assert_eq!(from_payload::<T>(&payload).as_ref(), Ok(value));
}

#[test]
fn shape_type() {
    assert_bytes(
        &square(),
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010001 04000000 52454400 0a000000 feffffff 1e000000 03000000 01020300",
    );
    assert_bytes(
        &square(),
        Representation::Xcdr1,
        ByteOrder::Big,
        "00000001 00000004 52454400 0000000a fffffffe 0000001e 00000003 01020300",
    );
    assert_bytes(
        &square(),
        Representation::Xcdr2,
        ByteOrder::Little,
        "00090001 1b000000 04000000 52454400 0a000000 feffffff 1e000000 03000000 01020300",
    );
    assert_bytes(
        &square(),
        Representation::Xcdr2,
        ByteOrder::Big,
        "00080001 0000001b 00000004 52454400 0000000a fffffffe 0000001e 00000003 01020300",
    );
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct Aligned {
    byte: u8,
    long: u64,
    short: i16,
    float: f32,
}

#[test]
fn alignment_is_at_most_8_in_version_1_and_4_in_version_2() {
    let value = Aligned {
        byte: 1,
        long: 2,
        short: 3,
        float: 1.0,
    };
    assert_bytes(
        &value,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010000 0100000000000000 0200000000000000 03000000 0000803f",
    );
    assert_bytes(
        &value,
        Representation::Xcdr2,
        ByteOrder::Little,
        "00070000 01000000 0200000000000000 03000000 0000803f",
    );
}

#[test]
fn mutable_members_carry_their_ids() {
    let value = Mutable {
        a: 7,
        b: Some(9),
        s: "hi".to_owned(),
    };
    assert_bytes(
        &value,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00030000 01400400 07000000 02000800 0900000000000000 03000700 03000000 68690000 027f0000",
    );
    assert_bytes(
        &value,
        Representation::Xcdr2,
        ByteOrder::Little,
        "000b0001 1f000000 010000a0 07000000 02000030 0900000000000000 03000050 03000000 68690000",
    );
    let absent = Mutable { b: None, ..value };
    assert_bytes(
        &absent,
        Representation::Xcdr2,
        ByteOrder::Big,
        "000a0001 00000013 a0000001 00000007 50000003 00000003 68690000",
    );
}

#[test]
fn optional_members_of_final_types() {
    let value = Optional {
        f0: 1,
        f1: Some(-1),
        f2: 3,
        k: 2,
    };
    assert_bytes(
        &value,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010000 01000000 01000400 ffffffff 00000000 0300000000000000 02000000",
    );
    assert_bytes(
        &value,
        Representation::Xcdr2,
        ByteOrder::Little,
        "00070000 01000000 01000000 ffffffff 0300000000000000 02000000",
    );
    let extended = hex("00010000 01000000 017f0800 01000000 04000000 ffffffff \
         00000000 0300000000000000 02000000");
    assert_eq!(from_payload(&extended), Ok(value.clone()));
    let absent = Optional { f1: None, ..value };
    assert_bytes(
        &absent,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010000 01000000 01000000 0300000000000000 02000000",
    );
    assert_bytes(
        &absent,
        Representation::Xcdr2,
        ByteOrder::Little,
        "00070000 01000000 00000000 0300000000000000 02000000",
    );
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct Choices {
    color: Color,
    level: Level,
    circle: Shape,
    label: Shape,
    nothing: Shape,
}

#[test]
fn enumerations_and_unions() {
    let value = Choices {
        color: Color::Blue,
        level: Level::Low,
        circle: Shape::Circle(1.0),
        label: Shape::Label("a".to_owned()),
        nothing: Shape::Nothing,
    };
    assert_bytes(
        &value,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010001 06000000 ff010000 000000000000f03f 02000000 02000000 61000000",
    );
    assert_bytes(
        &value,
        Representation::Xcdr2,
        ByteOrder::Little,
        "00070001 06000000 ff010000 000000000000f03f 02000000 02000000 61000000",
    );
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct Collections {
    bytes: Vec<u8>,
    strings: Vec<String>,
    colors: [Color; 1],
    matrix: [[u8; 2]; 2],
}

#[test]
fn collections_of_constructed_elements_are_delimited_in_version_2() {
    let value = Collections {
        bytes: vec![9],
        strings: vec!["a".to_owned()],
        colors: [Color::Green],
        matrix: [[1, 2], [3, 4]],
    };
    assert_bytes(
        &value,
        Representation::Xcdr1,
        ByteOrder::Little,
        "00010000 01000000 09000000 01000000 02000000 61000000 05000000 01020304",
    );
    assert_bytes(
        &value,
        Representation::Xcdr2,
        ByteOrder::Little,
        "00070000 01000000 09000000 0a000000 01000000 02000000 61000000 04000000 05000000 01020304",
    );
}

#[test]
fn every_length_code_is_read() {
    let value = Mutable {
        a: 7,
        b: None,
        s: "hi".to_owned(),
    };
    for member in [
        "010000c0 04000000 07000000 03000040 07000000 03000000 68690000",
        "010000a0 07000000 03000040 07000000 03000000 68690000",
    ] {
        let size = hex(member).len() as u8 - 1;
        let payload = [vec![0, 0xb, 0, 1, size, 0, 0, 0], hex(member)].concat();
        assert_eq!(from_payload(&payload).as_ref(), Ok(&value), "{member}");
    }
}

#[test]
fn a_long_parameter_gets_an_extended_header() {
    let value = Mutable {
        a: 1,
        b: Some(2),
        s: "x".repeat(70_000),
    };
    let payload = payload_of(&value, Representation::Xcdr1);
    assert_eq!(payload[24..36], hex("017f0800 03000000 75110100"));
    assert_eq!(from_payload(&payload), Ok(value));
}

#[test]
fn names_and_generics() {
    assert_eq!(Mutable::TYPE_NAME, "demo::Mutable");
    assert_eq!(Generic::<u8>::TYPE_NAME, "Generic");
    let value = Generic {
        first: 1u8,
        rest: vec![2],
        cached: 3,
    };
    let payload = payload_of(&value, Representation::Xcdr1);
    assert_eq!(payload, hex("00010003 01000000 01000000 02000000"));
    let read: Generic<u8> = from_payload(&payload).unwrap();
    assert_eq!((read.first, read.rest, read.cached), (1, vec![2], 0));
}

#[test]
fn what_cannot_be_encoded_leaves_the_buffer_as_it_was() {
    let mut shape = square();
    shape.color = "x".repeat(129);
    let long = BoundExceeded {
        member: "color",
        len: 129,
        bound: 128,
    };
    let mut out = vec![1, 2];
    for representation in REPRESENTATIONS {
        let result = to_payload(&shape, representation, &mut out);
        assert_eq!(result, Err(EncodeError::BoundExceeded(long.clone())));
        assert_eq!(out, [1, 2]);
    }
    shape.color = "a\0b".to_owned();
    let result = to_payload(&shape, Representation::Xcdr1, &mut out);
    assert_eq!(result, Err(EncodeError::NulInString));
}

#[test]
fn the_encapsulation_must_be_that_of_the_type() {
    let mut payload = payload_of(&square(), Representation::Xcdr2);
    payload[1] = 0x0b;
    let error = from_payload::<super::ShapeType>(&payload).unwrap_err();
    assert!(matches!(
        error,
        DecodeError::EncapsulationMismatch { id: 0x000b, .. }
    ));
    payload[1] = 0x04;
    let error = from_payload::<super::ShapeType>(&payload).unwrap_err();
    assert_eq!(error, DecodeError::UnknownEncapsulation(4));
}

#[test]
fn a_payload_may_start_anywhere_in_the_buffer() {
    let mut out = vec![0xff];
    to_payload(&square(), Representation::Xcdr1, &mut out).unwrap();
    assert_eq!(out[1..], payload_of(&square(), Representation::Xcdr1));
}
