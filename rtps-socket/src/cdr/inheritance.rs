//! Structs that inherit the members of another (XTypes 7.2.2.4.4.4.5): on the wire those come first, without a mark.

use super::{DdsType, DecodeError, EncodeError, MemberDecoder, MemberEncoder};

/// A struct, whose members another may inherit. Implemented by `#[derive(DdsType)]`.
pub trait Struct: DdsType {
    /// The ids of its members.
    const MEMBER_IDS: MemberIds;

    /// Writes the members.
    ///
    /// # Errors
    /// Those of their values.
    fn put_members(&self, members: &mut MemberEncoder<'_, '_>) -> Result<(), EncodeError>;

    /// Reads the members from among those of a struct with these ids.
    ///
    /// # Errors
    /// Those of their values, and unknown members that must be understood.
    fn take_members(
        members: &mut MemberDecoder<'_, '_>,
        ids: &MemberIds,
    ) -> Result<Self, DecodeError>;
}

/// The ids of a struct's members.
#[derive(Clone, Copy, Debug)]
pub struct MemberIds {
    /// Those of the members that it inherits.
    pub inherited: Option<&'static Self>,
    /// Those of its own, in the order of their declaration.
    pub own: &'static [u32],
}

impl MemberIds {
    /// Whether a member has this id.
    #[must_use]
    pub const fn contains(&self, id: u32) -> bool {
        let mut rest = self.own;
        while let [first, others @ ..] = rest {
            if *first == id {
                return true;
            }
            rest = others;
        }
        match self.inherited {
            Some(inherited) => inherited.contains(id),
            None => false,
        }
    }

    /// The id of a member that follows, unless it has another: one more than the last.
    #[must_use]
    pub const fn next(&self) -> u32 {
        match (self.own, self.inherited) {
            ([.., last], _) => *last + 1,
            ([], Some(inherited)) => inherited.next(),
            ([], None) => 0,
        }
    }

    /// Whether no two members have the same id.
    #[must_use]
    pub const fn are_distinct(&self) -> bool {
        let mut rest = self.own;
        while let [first, others @ ..] = rest {
            let remaining = Self {
                own: others,
                ..*self
            };
            if remaining.contains(*first) {
                return false;
            }
            rest = others;
        }
        true
    }
}
