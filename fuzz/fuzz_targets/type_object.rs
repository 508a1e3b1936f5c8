//! Any bytes as what others say of types: TypeInformation, requests and replies of the TypeLookup service, and
//! TypeObjects, which are compared with one of ours and with each other.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use rtps_socket::DdsType;
use rtps_socket::cdr::{CdrType, TypeBuilder, TypeSupport};
use rtps_user::qos::TypeConsistency;
use rtps_user::xtypes::lookup::{Reply, Request};
use rtps_user::xtypes::{Equivalence, TypeHash, TypeIdentifier, TypeInformation, TypeLibrary};

#[derive(DdsType)]
struct Outer {
    #[dds(key)]
    name: String,
    inner: Vec<Inner>,
    level: Level,
}

#[derive(DdsType)]
struct Inner {
    x: i32,
    y: Option<f64>,
}

#[derive(DdsType)]
enum Level {
    Low,
    High,
}

static OURS: LazyLock<TypeSupport> = LazyLock::new(|| TypeBuilder::describe(Outer::describe));

fuzz_target!(|data: &[u8]| {
    let mut library = TypeLibrary::default();
    library.add_mapping(&OURS.objects).expect("our own types");
    if let Ok(information) = TypeInformation::decode(data) {
        let written = information.encode();
        assert_eq!(TypeInformation::decode(&written), Ok(information));
    }
    if let Ok(request) = Request::decode(data) {
        assert_eq!(Request::decode(&request.encode()).as_ref(), Ok(&request));
        let reply = request.answer(&library, data.len().is_multiple_of(2));
        assert_eq!(Reply::decode(&reply.encode()), Ok(reply));
    }
    let _ = Reply::decode(data);
    objects(data, &mut library);
    let _ = library.add_mapping(data);
});

/// The bytes as two TypeObjects.
fn objects(data: &[u8], library: &mut TypeLibrary) {
    let information = TypeInformation::decode(&OURS.information).expect("our own type");
    let ours = information.of(Equivalence::Minimal).type_id.clone();
    let middle = data
        .first()
        .map_or(0, |first| usize::from(*first).min(data.len()));
    let (first, second) = data.split_at(middle);
    let mut types = vec![ours];
    for object in [first, second] {
        let hash = TypeHash::of(Equivalence::Minimal, object);
        library.add(hash, object);
        types.push(TypeIdentifier::Hash(hash));
    }
    let policies = [
        TypeConsistency::default(),
        TypeConsistency {
            ignore_member_names: true,
            prevent_type_widening: true,
            force_type_validation: true,
            ..TypeConsistency::default()
        },
    ];
    for reader in &types {
        for writer in &types {
            for policy in &policies {
                library.is_assignable(reader, writer, policy);
            }
        }
    }
}
