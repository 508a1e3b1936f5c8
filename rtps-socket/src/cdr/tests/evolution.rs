//! Types that gained or lost members since the sender was built, XTypes 7.2.4.

use super::{REPRESENTATIONS, payload_of};
use crate::DdsType;
use crate::cdr::{DecodeError, Representation, from_payload};

#[derive(Debug, PartialEq, DdsType)]
struct Old {
    a: u32,
}

#[derive(Debug, PartialEq, DdsType)]
struct New {
    a: u32,
    #[dds(default = 6)]
    b: u16,
    c: Option<String>,
    d: Vec<u64>,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final)]
struct Pair<T> {
    left: T,
    right: T,
}

fn new(a: u32) -> New {
    New {
        a,
        b: 1,
        c: Some("more".to_owned()),
        d: vec![1],
    }
}

#[test]
fn an_appendable_value_may_be_shorter() {
    for representation in REPRESENTATIONS {
        let payload = payload_of(&Old { a: 5 }, representation);
        let expected = New {
            a: 5,
            b: 6,
            c: None,
            d: vec![],
        };
        assert_eq!(from_payload(&payload), Ok(expected));
    }
}

#[test]
fn an_appendable_value_may_be_longer() {
    for representation in REPRESENTATIONS {
        let payload = payload_of(&new(5), representation);
        assert_eq!(from_payload(&payload), Ok(Old { a: 5 }));
    }
}

#[test]
fn a_delimited_value_may_change_inside_others() {
    let pair = Pair {
        left: new(1),
        right: new(2),
    };
    let payload = payload_of(&pair, Representation::Xcdr2);
    let expected = Pair {
        left: Old { a: 1 },
        right: Old { a: 2 },
    };
    assert_eq!(from_payload(&payload), Ok(expected));
}

#[test]
fn unannounced_padding_is_no_member() {
    #[derive(Debug, PartialEq, DdsType)]
    struct Longer {
        a: u8,
        b: u32,
    }
    let payload = [0, 1, 0, 0, 7, 0, 0, 0];
    assert_eq!(from_payload(&payload), Ok(Longer { a: 7, b: 0 }));
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct MutableOld {
    #[dds(id = 1)]
    a: u8,
    #[dds(id = 2)]
    b: String,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct MutableNew {
    #[dds(id = 3)]
    c: Vec<u64>,
    #[dds(id = 2)]
    b: String,
    #[dds(id = 4, default = vec![4])]
    d: Vec<u16>,
}

#[test]
fn mutable_members_may_come_go_and_move() {
    for representation in REPRESENTATIONS {
        let old = MutableOld {
            a: 1,
            b: "b".to_owned(),
        };
        let read: MutableNew = from_payload(&payload_of(&old, representation)).unwrap();
        let new = MutableNew {
            c: vec![],
            b: "b".to_owned(),
            d: vec![4],
        };
        assert_eq!(read, new);
        let read: MutableOld = from_payload(&payload_of(&new, representation)).unwrap();
        assert_eq!(read, MutableOld { a: 0, ..old });
    }
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(mutable)]
struct Keyed {
    #[dds(key, id = 9)]
    key: u32,
}

#[test]
fn a_member_that_must_be_understood_is_not_skipped() {
    for representation in REPRESENTATIONS {
        let payload = payload_of(&Keyed { key: 1 }, representation);
        let error = from_payload::<MutableOld>(&payload).unwrap_err();
        assert_eq!(error, DecodeError::NotUnderstood { id: 9 });
    }
}
