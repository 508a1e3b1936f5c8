//! How a sample shows its members to an expression.

/// A sample, or a member of one, whose members have names.
pub trait Fields {
    /// The value of the primitive, string or enumerated member at `path`, a name for each level, and a decimal number
    /// for an element of a sequence. `None` where there is none now: an optional member that is absent, an index
    /// beyond the end, a branch that the union's discriminator does not select.
    fn field(&self, path: &[&str]) -> Option<Value<'_>>;
}

/// The value of a member.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// A boolean.
    Bool(bool),
    /// A signed integer of any size, or the value of an enumerated literal.
    Int(i64),
    /// An unsigned integer of any size.
    UInt(u64),
    /// A floating-point number.
    Float(f64),
    /// A character.
    Char(char),
    /// A string.
    Str(&'a str),
}

/// What the type of a sample says of a member.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldType {
    /// What values it has.
    pub kind: Kind,
    /// Whether a serialized key holds it.
    pub is_key: bool,
}

/// What values a member has.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Kind {
    /// [`Value::Bool`].
    Bool,
    /// [`Value::Int`] or [`Value::UInt`].
    Integer,
    /// [`Value::Float`].
    Float,
    /// [`Value::Float`] of a number with 32 bits: what it is compared with is rounded to as many.
    Float32,
    /// [`Value::Char`].
    Char,
    /// [`Value::Str`].
    String,
    /// [`Value::Int`], where expressions may name the literals: their names and values.
    Enum(&'static [(&'static str, i64)]),
}

impl Kind {
    /// Whether members of the two kinds compare with each other: numbers do, of whatever kind, and so do texts.
    pub(super) fn compares_with(self, other: Self) -> bool {
        let is_number = |kind| {
            matches!(
                kind,
                Self::Integer | Self::Float | Self::Float32 | Self::Enum(_)
            )
        };
        let is_text = |kind| matches!(kind, Self::Char | Self::String);
        self == other || (is_number(self) && is_number(other)) || (is_text(self) && is_text(other))
    }
}
