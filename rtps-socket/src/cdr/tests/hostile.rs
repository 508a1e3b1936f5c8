//! Payloads that lie: each is refused, none makes the decoder panic or reserve memory.

use super::{Color, Everything, Level, Node, REPRESENTATIONS, Shape, hex, payload_of, square};
use crate::DdsType;
use crate::cdr::{
    DecodeError, EncodeError, MAX_DEPTH, Representation, from_key_payload, from_payload, to_payload,
};

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
struct One<T> {
    value: T,
}

#[track_caller]
fn assert_refused<T: crate::cdr::CdrType + std::fmt::Debug>(payload: &str, expected: DecodeError) {
    let result = from_payload::<One<T>>(&hex(payload));
    assert_eq!(result.unwrap_err(), expected);
}

#[test]
fn huge_counts() {
    let refused = |remaining| DecodeError::CountTooLarge {
        count: u32::MAX,
        remaining,
    };
    assert_refused::<Vec<u8>>("00010000 ffffffff 00000000", refused(4));
    assert_refused::<Vec<u64>>("00010000 ffffffff 0000000000000000", refused(8));
    assert_refused::<String>("00010000 ffffffff 61000000", refused(4));
    assert_refused::<Vec<One<Empty>>>("00010000 ffffffff", refused(0));
    assert_refused::<std::collections::BTreeMap<u8, u8>>("00010000 ffffffff 00", refused(1));
    assert_refused::<Vec<String>>("00070000 04000000 ffffffff", refused(0));
}

#[derive(Debug, Clone, PartialEq, DdsType)]
#[dds(final)]
struct Empty {}

#[test]
fn a_count_is_compared_with_the_smallest_elements_that_could_be_there() {
    assert_refused::<Vec<u32>>(
        "00010000 03000000 0000000000000000",
        DecodeError::CountTooLarge {
            count: 3,
            remaining: 8,
        },
    );
}

#[test]
fn delimiters_beyond_the_end() {
    let expected = DecodeError::UnexpectedEnd {
        needed: 0x7fff_ffff,
        remaining: 4,
    };
    assert_refused::<super::ShapeType>("00070000 ffffff7f 00000000", expected);
}

#[test]
fn strings() {
    assert_refused::<String>("00010000 00000000", DecodeError::InvalidString);
    assert_refused::<String>("00010000 02000000 6161", DecodeError::InvalidString);
    assert_refused::<String>("00010000 03000000 610000", DecodeError::InvalidString);
    assert_refused::<String>("00010000 03000000 ff6100", DecodeError::InvalidUtf8);
}

#[test]
fn values_outside_their_type() {
    assert_refused::<bool>("00010000 02", DecodeError::InvalidBool(2));
    assert_refused::<Color>(
        "00010000 01000000",
        DecodeError::InvalidEnum {
            type_name: "Color",
            value: 1,
        },
    );
    assert_refused::<Vec<bool>>("00010000 02000000 0103", DecodeError::InvalidBool(3));
}

#[test]
fn defaults_take_what_is_unknown() {
    let level: One<Level> = from_payload(&hex("00010000 63")).unwrap();
    assert_eq!(level.value, Level::Unknown);
    let shape: One<Shape> = from_payload(&hex("00010000 63")).unwrap();
    assert_eq!(shape.value, Shape::Nothing);
}

#[test]
fn a_bound_is_checked_when_reading() {
    let mut shape = payload_of(&square(), Representation::Xcdr1);
    let long = [hex("00010000 c8000000"), vec![b'x'; 199], vec![0]].concat();
    shape.splice(0..12, long);
    let error = from_payload::<super::ShapeType>(&shape).unwrap_err();
    assert!(matches!(error, DecodeError::BoundExceeded(_)), "{error}");
}

#[test]
fn padding_that_is_not_there() {
    let error = from_payload::<One<u8>>(&hex("00010003 0102")).unwrap_err();
    let expected = DecodeError::UnexpectedEnd {
        needed: 3,
        remaining: 2,
    };
    assert_eq!(error, expected);
}

#[test]
fn nesting_is_limited_both_ways() {
    let nest = |levels| {
        (0..levels).fold(Node::leaf(), |node, _| Node {
            next: Some(Box::new(node)),
            ..Node::leaf()
        })
    };
    for representation in REPRESENTATIONS {
        let deepest = nest(MAX_DEPTH - 1);
        let payload = payload_of(&deepest, representation);
        assert_eq!(from_payload(&payload), Ok(deepest));
        let result = to_payload(&nest(MAX_DEPTH), representation, &mut Vec::new());
        assert_eq!(result, Err(EncodeError::TooDeep));
    }
    // One level more around the deepest: DHEADER, value, "present", it, and no children.
    let deepest = payload_of(&nest(MAX_DEPTH - 1), Representation::Xcdr2);
    let body = [
        hex("00000100"),
        deepest[4..].to_vec(),
        hex("0400000000000000"),
    ]
    .concat();
    let size = u32::try_from(body.len()).unwrap().to_le_bytes().to_vec();
    let deeper = [hex("00090000"), size, body].concat();
    assert_eq!(from_payload::<Node>(&deeper), Err(DecodeError::TooDeep));
}

impl Node {
    fn leaf() -> Self {
        Self {
            value: 0,
            next: None,
            children: vec![],
        }
    }
}

#[test]
fn truncation_anywhere_is_no_panic() {
    let everything = super::round_trip::everything();
    for representation in REPRESENTATIONS {
        let payload = payload_of(&everything, representation);
        for end in 0..payload.len() {
            // A mutable type ends with a sentinel or is delimited: no cut goes unnoticed.
            let cut = &payload[..end];
            assert!(from_payload::<Everything>(cut).is_err(), "cut at {end}");
            let _ = from_key_payload::<Everything>(cut);
        }
    }
}
