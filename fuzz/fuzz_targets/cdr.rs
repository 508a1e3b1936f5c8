//! Any bytes as a serialized sample of types of every kind; what is a value is the same value once it has been
//! written and read again, in either representation.

#![no_main]

use std::collections::BTreeMap;

use libfuzzer_sys::fuzz_target;
use rtps_socket::DdsType;
use rtps_socket::cdr::{
    DdsType, LongDouble, Representation, WChar, WString, from_key_payload, from_payload, key_hash,
    key_payload, to_payload,
};

#[derive(DdsType)]
struct Appendable {
    #[dds(key)]
    name: String,
    #[dds(bound = 5)]
    numbers: Vec<u16>,
    inner: Final,
    mutable: Mutable,
    shape: Shape,
    grid: [[i16; 3]; 2],
    table: BTreeMap<String, i64>,
    parts: Vec<Final>,
}

#[derive(DdsType)]
#[dds(final)]
struct Final {
    #[dds(key)]
    id: u8,
    ratio: f64,
    level: Level,
    is_new: bool,
    letter: char,
}

#[derive(DdsType)]
#[dds(mutable)]
struct Mutable {
    #[dds(key, id = 7)]
    id: i32,
    note: Option<String>,
    ratio: Option<f32>,
    #[dds(id = 0x0fff_fff0)]
    next: Option<Box<Mutable>>,
}

#[derive(DdsType, Clone, Copy)]
#[dds(bit_bound = 8)]
enum Level {
    Low = -1,
    High = 4,
}

#[derive(DdsType)]
enum Shape {
    Round(f32),
    #[dds(case = 4)]
    Named(String),
    #[dds(default)]
    Nothing,
}

#[derive(DdsType)]
#[dds(mutable)]
struct Heir {
    #[dds(base)]
    base: Mutable,
    wide: Vec<WString>,
    unit: WChar,
    #[dds(bound = 3, try_construct = "trim")]
    cut: String,
    #[dds(bound = 3, try_construct = "use_default")]
    list: Vec<u16>,
    #[dds(try_construct = "use_default", default = Level::High)]
    level: Level,
    flags: Flags,
    fields: Fields,
    number: LongDouble,
    #[dds(must_understand)]
    alias: Option<Alias>,
}

#[derive(DdsType)]
#[dds(bitmask, bit_bound = 16)]
struct Flags {
    low: bool,
    #[dds(position = 15)]
    high: bool,
}

#[derive(DdsType)]
#[dds(bitset)]
struct Fields {
    #[dds(bits = 5)]
    signed: i16,
    #[dds(bits = 33, position = 9)]
    large: u64,
}

#[derive(DdsType)]
struct Alias(#[dds(bound = 2)] Vec<u8>);

fuzz_target!(|data: &[u8]| {
    check::<Appendable>(data);
    check::<Final>(data);
    check::<Mutable>(data);
    check::<Shape>(data);
    check::<Heir>(data);
});

fn check<T: DdsType>(data: &[u8]) {
    for value in [from_payload::<T>(data), from_key_payload::<T>(data)] {
        let Ok(value) = value else {
            continue;
        };
        for representation in [Representation::Xcdr1, Representation::Xcdr2] {
            round_trip(&value, representation);
            let mut scratch = Vec::new();
            key_hash(&value, representation, &mut scratch).expect("the hash of what was read");
            let mut key = Vec::new();
            key_payload(&value, representation, &mut key).expect("the key of what was read");
            from_key_payload::<T>(&key).expect("the key that we wrote");
        }
    }
}

/// By their bytes, for not every number equals itself.
fn round_trip<T: DdsType>(value: &T, representation: Representation) {
    let (mut written, mut rewritten) = (Vec::new(), Vec::new());
    to_payload(value, representation, &mut written).expect("what was read can be written");
    let again = from_payload::<T>(&written).expect("what we wrote can be read");
    to_payload(&again, representation, &mut rewritten).expect("the same again");
    assert_eq!(written, rewritten);
}
