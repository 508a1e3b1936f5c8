//! Any bytes as a parameter list: as such, and as what discovery says of participants and endpoints. What is
//! understood is understood again once it has been written.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rtps_fuzz::remote_guid;
use rtps_user::discovery::{EndpointData, ParticipantData};
use rtps_user::wire::{Endianness, EntityKind, ParameterList};

fuzz_target!(|data: &[u8]| {
    for endianness in [Endianness::Little, Endianness::Big] {
        if let Ok((list, len)) = ParameterList::parse(data, endianness) {
            assert!(len <= data.len());
            assert!(list.iter().count() <= len / 4);
        }
    }
    let little = [&[0, 3, 0, 0], data].concat();
    let big = [&[0, 2, 0, 0], data].concat();
    for payload in [data, &little, &big] {
        for kind in [EntityKind::WriterWithKey, EntityKind::ReaderNoKey] {
            endpoint(remote_guid(2, kind), payload);
        }
        participant(payload);
    }
});

fn endpoint(guid: rtps_user::wire::Guid, payload: &[u8]) {
    if let Ok(data) = EndpointData::decode(guid, payload) {
        let mut written = Vec::new();
        data.encode(&mut written);
        let again = EndpointData::decode(guid, &written).expect("what we wrote");
        let mut rewritten = Vec::new();
        again.encode(&mut rewritten);
        assert_eq!(written, rewritten);
    }
}

fn participant(payload: &[u8]) {
    if let Ok(data) = ParticipantData::decode(payload) {
        let mut written = Vec::new();
        data.encode(&mut written);
        ParticipantData::decode(&written).expect("what we wrote");
    }
}
