//! What members are compared with.

use std::cmp::Ordering;

use super::token::{Token, Tokens};
use super::{Kind, Value};

/// An integer or floating-point number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Integer(i128),
    Float(f64),
}

impl Number {
    /// Reads a decimal or hexadecimal integer of up to 64 bits, or a floating-point number.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
        let is_negative = text.starts_with('-');
        let hexadecimal = unsigned
            .strip_prefix("0x")
            .or_else(|| unsigned.strip_prefix("0X"));
        let (digits, radix) = hexadecimal.map_or((unsigned, 10), |digits| (digits, 16));
        if !digits.is_empty() && digits.chars().all(|digit| digit.is_digit(radix)) {
            let magnitude = i128::from(u64::from_str_radix(digits, radix).ok()?);
            let value = if is_negative { -magnitude } else { magnitude };
            return (value >= i64::MIN.into()).then_some(Self::Integer(value));
        }
        // Not the names of what is no number.
        if !unsigned.starts_with(|first: char| first == '.' || first.is_ascii_digit()) {
            return None;
        }
        let value: f64 = text.parse().ok()?;
        value.is_finite().then_some(Self::Float(value))
    }

    /// Compares as C does: integers as such, otherwise as floating-point numbers. `None` where one is no number.
    fn compare(self, other: Self) -> Option<Ordering> {
        match (self, other) {
            (Self::Integer(a), Self::Integer(b)) => Some(a.cmp(&b)),
            _ => self.as_float().partial_cmp(&other.as_float()),
        }
    }

    /// The number as a member with 32 bits would have it; what that could not hold stays as it is.
    fn rounded(self) -> Self {
        let rounded = f64::from(self.as_float() as f32);
        match rounded.is_finite() {
            true => Self::Float(rounded),
            false => self,
        }
    }

    fn as_float(self) -> f64 {
        match self {
            Self::Integer(value) => value as f64,
            Self::Float(value) => value,
        }
    }
}

/// A constant, in all the ways that it can be read: what a parameter without quotes is only the member tells that it
/// is compared with.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Literal {
    text: Option<String>,
    number: Option<Number>,
    boolean: Option<bool>,
}

impl Literal {
    pub(super) fn text(text: String) -> Self {
        Self {
            text: Some(text),
            ..Self::default()
        }
    }

    pub(super) fn number(number: Number) -> Self {
        Self {
            number: Some(number),
            ..Self::default()
        }
    }

    pub(super) fn boolean(value: bool) -> Self {
        Self {
            boolean: Some(value),
            ..Self::default()
        }
    }

    /// Reads a parameter, a text with or without quotes.
    pub(super) fn parameter(text: &str) -> Self {
        let mut tokens = Tokens::new(text);
        if let (Ok((Token::Text(text), _)), Ok((Token::End, _))) = (tokens.next(), tokens.next()) {
            return Self::text(text);
        }
        let trimmed = text.trim();
        Self {
            text: Some(text.to_owned()),
            number: Number::parse(trimmed),
            boolean: boolean(trimmed),
        }
    }

    pub(super) fn as_text(&self) -> Option<&str> {
        self.text.as_deref()
    }

    /// The literal as what a member of this kind compares with, if it does.
    pub(super) fn bound_to(mut self, kind: Kind) -> Option<Self> {
        let fits = match kind {
            Kind::Bool => self.boolean.is_some(),
            Kind::Integer | Kind::Float => self.number.is_some(),
            Kind::Float32 => {
                self.number = self.number.map(Number::rounded);
                self.number.is_some()
            }
            Kind::Char | Kind::String => self.text.is_some(),
            Kind::Enum(literals) => {
                if let Some(text) = &self.text {
                    let named = literals.iter().find(|(name, _)| name == text);
                    let value = named.map(|(_, value)| Number::Integer((*value).into()));
                    self.number = value.or(self.number);
                }
                self.number.is_some()
            }
        };
        fits.then_some(self)
    }

    /// Where `value` stands in relation to the literal; `None` where they do not compare.
    pub(super) fn compare(&self, value: Value<'_>) -> Option<Ordering> {
        match value {
            Value::Bool(value) => Some(value.cmp(&self.boolean?)),
            Value::Char(value) => Some(compare_char(value, self.as_text()?)),
            Value::Str(value) => Some(value.cmp(self.as_text()?)),
            Value::Int(_) | Value::UInt(_) | Value::Float(_) => {
                number_of(value)?.compare(self.number?)
            }
        }
    }
}

/// Where one member stands in relation to another; `None` where they do not compare.
pub(super) fn compare_values(left: Value<'_>, right: Value<'_>) -> Option<Ordering> {
    match (left, right) {
        (Value::Bool(left), Value::Bool(right)) => Some(left.cmp(&right)),
        (Value::Char(left), Value::Char(right)) => Some(left.cmp(&right)),
        (Value::Str(left), Value::Str(right)) => Some(left.cmp(right)),
        (Value::Char(left), Value::Str(right)) => Some(compare_char(left, right)),
        (Value::Str(left), Value::Char(right)) => Some(compare_char(right, left).reverse()),
        _ => number_of(left)?.compare(number_of(right)?),
    }
}

/// A character compares as a text of its own.
fn compare_char(character: char, text: &str) -> Ordering {
    (*character.encode_utf8(&mut [0; 4])).cmp(text)
}

/// The value of TRUE and FALSE, which like all keywords are written in either case.
pub(super) fn boolean(text: &str) -> Option<bool> {
    match text {
        _ if text.eq_ignore_ascii_case("true") => Some(true),
        _ if text.eq_ignore_ascii_case("false") => Some(false),
        _ => None,
    }
}

fn number_of(value: Value<'_>) -> Option<Number> {
    match value {
        Value::Int(value) => Some(Number::Integer(value.into())),
        Value::UInt(value) => Some(Number::Integer(value.into())),
        Value::Float(value) => Some(Number::Float(value)),
        Value::Bool(_) | Value::Char(_) | Value::Str(_) => None,
    }
}
