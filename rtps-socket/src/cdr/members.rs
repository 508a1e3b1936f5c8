//! Members of aggregated types: optional or not, bounded or not, and the ids they carry.

use rtps_user::xtypes::{TypeBuilder, TypePair};

use super::{CdrType, KeySize};

/// What the encoding of a struct needs to know of a member besides its type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemberInfo {
    /// Name as declared, for errors.
    pub name: &'static str,
    /// Member id, 28 bits.
    pub id: u32,
    /// A receiver that does not know the member must discard the sample: set for keys.
    pub must_understand: bool,
    /// It is part of the key: a sample without it is refused.
    pub key: bool,
}

/// A type in the place of a struct's member: a [`CdrType`], or an `Option` of one.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be a member of a DDS type",
    note = "a member is a type that implements `CdrType` (derive `DdsType`) or an `Option` of one"
)]
pub trait Member: Sized {
    /// The type of the member when it is there.
    type Value: CdrType;
    /// Whether it may be absent.
    const IS_OPTIONAL: bool;
    /// The fewest bytes that it takes in a type that is not mutable.
    const MIN_SIZE: usize;

    /// The value, unless absent.
    fn value(&self) -> Option<&Self::Value>;
    /// The member with a value.
    fn from_value(value: Self::Value) -> Self;
    /// What a member is that no sender wrote.
    fn default_member() -> Self;
    /// Adds the largest size as part of a key.
    fn add_key_size(size: &mut KeySize);
}

impl<T: CdrType> Member for T {
    type Value = T;
    const IS_OPTIONAL: bool = false;
    const MIN_SIZE: usize = T::MIN_SIZE;

    fn value(&self) -> Option<&T> {
        Some(self)
    }

    fn from_value(value: T) -> Self {
        value
    }

    fn default_member() -> Self {
        T::default_value()
    }

    fn add_key_size(size: &mut KeySize) {
        T::add_key_size(size);
    }
}

impl<T: CdrType> Member for Option<T> {
    type Value = T;
    const IS_OPTIONAL: bool = true;
    const MIN_SIZE: usize = 1;

    fn value(&self) -> Option<&T> {
        self.as_ref()
    }

    fn from_value(value: T) -> Self {
        Some(value)
    }

    fn default_member() -> Self {
        None
    }

    fn add_key_size(size: &mut KeySize) {
        size.add_optional();
        size.add_unless_exceeded(T::add_key_size);
    }
}

/// A type that `#[dds(bound = N)]` applies to.
#[diagnostic::on_unimplemented(
    message = "`{Self}` has no length that a bound could limit",
    note = "bounds apply to strings, sequences and maps"
)]
pub trait Bounded {
    /// Bytes of a string, elements of a sequence or map.
    fn bounded_len(&self) -> usize;
    /// Leaves out what is beyond the bound.
    fn trim(&mut self, bound: usize);
    /// Adds the largest size that the bound leaves.
    fn add_bounded_key_size(size: &mut KeySize, bound: usize);
    /// As [`CdrType::describe`], with the bound.
    fn describe_bounded(types: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        let _ = (types, bound);
        None
    }
}

impl<B: Bounded> Bounded for Option<B> {
    fn bounded_len(&self) -> usize {
        self.as_ref().map_or(0, B::bounded_len)
    }

    fn trim(&mut self, bound: usize) {
        if let Some(value) = self {
            value.trim(bound);
        }
    }

    fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
        size.add_optional();
        B::add_bounded_key_size(size, bound);
    }

    fn describe_bounded(types: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        B::describe_bounded(types, bound)
    }
}

impl<B: Bounded> Bounded for Box<B> {
    fn bounded_len(&self) -> usize {
        (**self).bounded_len()
    }

    fn trim(&mut self, bound: usize) {
        (**self).trim(bound);
    }

    fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
        B::add_bounded_key_size(size, bound);
    }

    fn describe_bounded(types: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        B::describe_bounded(types, bound)
    }
}

/// Compares a member's length with its bound, when writing and when reading.
///
/// # Errors
/// When it is longer.
pub fn check_bound<B: Bounded>(
    member: &'static str,
    bound: usize,
    value: &B,
) -> Result<(), super::BoundExceeded> {
    let len = value.bounded_len();
    if len > bound {
        return Err(super::BoundExceeded { member, len, bound });
    }
    Ok(())
}

/// Whether a member is longer than its bound.
pub fn is_beyond<B: Bounded>(bound: usize, value: &B) -> bool {
    value.bounded_len() > bound
}

/// The member as far as its bound goes (XTypes 7.2.2.7, TRIM).
pub fn trim<B: Bounded>(bound: usize, mut value: B) -> B {
    if is_beyond(bound, &value) {
        value.trim(bound);
    }
    value
}

/// The parameter headers of XCDR1, XTypes 7.4.1.2 table 34.
pub(super) mod parameter {
    /// Flag of a short header.
    pub(in super::super) const MUST_UNDERSTAND: u16 = 0x4000;
    /// Flag of an extended header.
    pub(in super::super) const MUST_UNDERSTAND_EXTENDED: u32 = 0x4000_0000;
    /// The bits of a short header that hold the id.
    pub(in super::super) const ID_MASK: u16 = 0x3fff;
    /// The bits of an extended header that hold the id.
    pub(in super::super) const EXTENDED_ID_MASK: u32 = 0x0fff_ffff;
    /// Ids above have a meaning of their own or need an extended header.
    pub(in super::super) const MAX_SHORT_ID: u32 = 0x3f00;
    /// Marks an extended header.
    pub(in super::super) const EXTENDED: u16 = 0x3f01;
    /// Marks the end of the list.
    pub(in super::super) const LIST_END: u16 = 0x3f02;
    /// Marks a parameter to skip.
    pub(in super::super) const IGNORE: u16 = 0x3f03;
    /// What an extended header says as its short length.
    pub(in super::super) const EXTENDED_LENGTH: u16 = 8;
    /// Bytes of a short header.
    pub(in super::super) const SHORT_SIZE: usize = 4;
    /// Bytes of an extended header.
    pub(in super::super) const EXTENDED_SIZE: usize = 12;
}
