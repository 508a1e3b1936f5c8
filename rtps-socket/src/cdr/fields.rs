//! How members are found by the paths that content filters have, for the implementations of [`CdrType`].

use super::{CdrType, FieldType, Kind, Member};

/// The type of a struct's member, or of what is in it.
pub fn member_type<M: Member>(path: &[&str], is_key: bool) -> Option<FieldType> {
    let found = M::Value::type_at(path)?;
    Some(FieldType {
        is_key: found.is_key && is_key,
        ..found
    })
}

/// The type of what has no members.
pub(super) fn leaf_type(path: &[&str], kind: Kind) -> Option<FieldType> {
    path.is_empty().then_some(FieldType { kind, is_key: true })
}

/// The type of a sequence's or an array's element, or of what is in it.
pub(super) fn element_type<T: CdrType>(path: &[&str]) -> Option<FieldType> {
    let (_, path) = index(path)?;
    T::type_at(path)
}

/// The index that a path begins with, and what follows it.
pub(super) fn index<'p>(path: &'p [&'p str]) -> Option<(usize, &'p [&'p str])> {
    let (at, path) = path.split_first()?;
    Some((at.parse().ok()?, path))
}
