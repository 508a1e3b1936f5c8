//! Serialized keys and key hashes.

use super::{Mutable, REPRESENTATIONS, ShapeType, hex, square};
use crate::DdsType;
use crate::cdr::{
    DdsType, DecodeError, Representation, bare_key_of, from_key_payload, key_hash, key_payload,
};
use rtps_user::writer::BareKey;

fn hash<T: DdsType>(value: &T, representation: Representation) -> [u8; 16] {
    key_hash(value, representation, &mut Vec::new()).unwrap()
}

fn key<T: DdsType>(value: &T, representation: Representation) -> Vec<u8> {
    let mut out = Vec::new();
    key_payload(value, representation, &mut out).unwrap();
    out
}

#[test]
fn a_key_that_may_be_long_is_hashed_even_when_it_is_short() {
    for representation in REPRESENTATIONS {
        // MD5 of 00 00 00 04 "RED" 00.
        let expected = hex("d36de865fac295155f18df7157b217e6");
        assert_eq!(hash(&square(), representation)[..], expected);
    }
}

#[derive(Debug, PartialEq, DdsType)]
struct Position {
    #[dds(key, id = 9)]
    row: u8,
    note: String,
    #[dds(key, id = 2)]
    column: u16,
}

#[derive(Debug, PartialEq, DdsType)]
struct Located {
    altitude: f64,
    #[dds(key)]
    serial: u64,
    #[dds(key)]
    position: Position,
}

fn located() -> Located {
    Located {
        altitude: 1.5,
        serial: 1,
        position: Position {
            row: 3,
            note: "not part of the key".to_owned(),
            column: 4,
        },
    }
}

#[test]
fn a_short_key_is_its_own_hash_ordered_by_member_id() {
    for representation in REPRESENTATIONS {
        let expected = hex("0000000000000001 0004 03 0000000000");
        assert_eq!(hash(&located(), representation)[..], expected);
    }
}

#[test]
fn a_key_payload_has_the_encoding_of_the_type_and_its_key_members() {
    let payload = key(&located(), Representation::Xcdr1);
    assert_eq!(payload, hex("00010000 0100000000000000 03000400 00000000"));
    let payload = key(&located(), Representation::Xcdr2);
    assert_eq!(
        payload,
        hex("00090000 10000000 0100000000000000 04000000 03000400")
    );
    let payload = key(&square(), Representation::Xcdr1);
    assert_eq!(payload, hex("00010000 04000000 52454400 0000000000000000"));
    let mutable = Mutable {
        a: 7,
        b: Some(1),
        s: "x".to_owned(),
    };
    let payload = key(&mutable, Representation::Xcdr2);
    assert_eq!(payload, hex("000b0000 08000000 010000a0 07000000 00000000"));
}

/// Fast DDS would take 16 bytes for the key hash.
#[test]
fn no_key_payload_is_as_short_as_a_key_hash() {
    for representation in REPRESENTATIONS {
        assert!(key(&square(), representation).len() > 16);
        assert!(key(&located(), representation).len() > 16);
    }
}

#[test]
fn a_key_payload_gives_the_key_back_and_defaults_for_the_rest() {
    for representation in REPRESENTATIONS {
        let read: Located = from_key_payload(&key(&located(), representation)).unwrap();
        assert_eq!(read.serial, 1);
        assert_eq!(read.altitude, 0.0);
        assert_eq!((read.position.row, read.position.column), (3, 4));
        assert_eq!(read.position.note, "");
        assert_eq!(
            hash(&read, representation),
            hash(&located(), representation)
        );
        let read: ShapeType = from_key_payload(&key(&square(), representation)).unwrap();
        assert_eq!(read.color, "RED");
        assert_eq!(read.additional_payload_size, []);
    }
}

/// What Debian's Cyclone DDS 0.10.2 sends to dispose of a BLUE shape of the appendable type of `cyclone/types.idl`, in
/// XCDR2: its keys have no DHEADER.
#[test]
fn a_dispose_of_cyclone_is_read() {
    let payload = hex("00090003 05000000 424c5545 00000000");
    let read: ShapeType = from_key_payload(&payload).unwrap();
    assert_eq!(read.color, "BLUE");
    let cut = from_key_payload::<ShapeType>(&payload[..12]);
    assert!(cut.is_err());
    // Numbers, of which the first may look like a size.
    for serial in [0, 4, 8, 12, 16] {
        let mut payload = hex("00090000 0000000000000000 03000400");
        payload[4] = serial;
        let read: Located = from_key_payload(&payload).unwrap();
        assert_eq!(read.serial, serial.into());
        assert_eq!((read.position.row, read.position.column), (3, 4));
    }
}

/// The other way round, and without DHEADERs of what is nested.
#[test]
fn cyclone_is_sent_keys_as_it_sends_them() {
    let bare = |payload: &[u8], make: Option<BareKey>| make.unwrap()(payload).unwrap();
    let make = bare_key_of::<ShapeType>(Representation::Xcdr2);
    let blue = ShapeType {
        color: "BLUE".to_owned(),
        ..square()
    };
    let key_of_blue = key(&blue, Representation::Xcdr2);
    let expected = hex("00090003 05000000 424c5545 00000000");
    assert_eq!(bare(&key_of_blue, make), expected);
    let make = bare_key_of::<Located>(Representation::Xcdr2);
    let key_of_located = key(&located(), Representation::Xcdr2);
    let expected = hex("00090001 0100000000000000 04000300");
    assert_eq!(bare(&key_of_located, make), expected);
    assert_eq!(make.unwrap()(&key_of_located[..8]), None);
    assert!(bare_key_of::<ShapeType>(Representation::Xcdr1).is_none());
    assert!(bare_key_of::<Keyless>(Representation::Xcdr2).is_none());
}

#[test]
fn a_missing_key_is_an_error() {
    let error = from_key_payload::<Mutable>(&hex("000b0000 00000000")).unwrap_err();
    assert_eq!(error, DecodeError::MissingMember { member: "a" });
}

#[derive(Debug, PartialEq, DdsType)]
struct Boundary {
    #[dds(key, bound = 3)]
    name: String,
    #[dds(key)]
    number: u64,
}

#[derive(Debug, PartialEq, DdsType)]
struct Beyond {
    #[dds(key, bound = 4)]
    name: String,
    #[dds(key)]
    number: u64,
}

#[test]
fn the_largest_key_decides_whether_it_is_hashed() {
    let boundary = Boundary {
        name: "a".to_owned(),
        number: 1,
    };
    let plain = hex("00000002 6100 0000 0000000000000001");
    assert_eq!(hash(&boundary, Representation::Xcdr2)[..], plain);
    let beyond = Beyond {
        name: "a".to_owned(),
        number: 1,
    };
    assert_ne!(hash(&beyond, Representation::Xcdr2)[..], plain);
}

#[derive(Debug, PartialEq, DdsType)]
struct Keyless {
    value: u32,
}

#[test]
fn a_type_without_key_has_an_empty_key() {
    let value = Keyless { value: 5 };
    assert_eq!(hash(&value, Representation::Xcdr1), [0; 16]);
    let payload = key(&value, Representation::Xcdr1);
    assert_eq!(payload, hex("00010000"));
    assert_eq!(from_key_payload(&payload), Ok(Keyless { value: 0 }));
}
