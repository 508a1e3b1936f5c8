//! Wide characters and strings, UTF-16 on the wire, and `long double`.

use std::fmt;
use std::ops::Deref;

use rtps_user::xtypes::{TypeBuilder, TypeKind, TypePair};

use super::fields::leaf_type;
use super::{
    Bounded, CdrType, DecodeError, Decoder, EncodeError, Encoder, FieldType, KeySize, Kind,
    LengthCode, Value,
};

/// An IDL `wstring`: its length in bytes, and UTF-16 without a NUL (XTypes 7.4.1.1.2).
///
/// A bound counts UTF-16 units.
#[derive(Clone, Debug, Default, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct WString(pub String);

impl From<&str> for WString {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl From<String> for WString {
    fn from(text: String) -> Self {
        Self(text)
    }
}

impl Deref for WString {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for WString {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

impl CdrType for WString {
    const MIN_SIZE: usize = 4;
    const LENGTH_CODE: LengthCode = LengthCode::SharedBytes;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        if self.contains('\0') {
            return Err(EncodeError::NulInString);
        }
        let units: Vec<u16> = self.encode_utf16().collect();
        encoder.put_len(units.len().saturating_mul(2))?;
        encoder.put_all(&units);
        Ok(())
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let bytes = decoder.take_count(1)?;
        let units: Vec<u16> = decoder.take_vec(bytes / 2)?;
        if bytes % 2 != 0 || units.contains(&0) {
            return Err(DecodeError::InvalidWString);
        }
        let text = String::from_utf16(&units).map_err(|_| DecodeError::InvalidWString)?;
        Ok(Self(text))
    }

    fn default_value() -> Self {
        Self::default()
    }

    fn add_key_size(size: &mut KeySize) {
        size.add_unbounded();
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        path.is_empty().then_some(Value::Str(self))
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        leaf_type(path, Kind::String)
    }

    fn describe(_: &mut TypeBuilder) -> Option<TypePair> {
        Some(TypePair::string(true, 0))
    }
}

impl Bounded for WString {
    fn bounded_len(&self) -> usize {
        self.encode_utf16().count()
    }

    fn trim(&mut self, bound: usize) {
        let mut units = 0;
        let end = self.char_indices().find(|(_, character)| {
            units += character.len_utf16();
            units > bound
        });
        if let Some((end, _)) = end {
            self.0.truncate(end);
        }
    }

    fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
        size.add(4, 1);
        size.add(2, bound);
    }

    fn describe_bounded(_: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        Some(TypePair::string(true, bound))
    }
}

/// An IDL `wchar`: a UTF-16 unit.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct WChar(pub u16);

impl WChar {
    /// The character, unless the unit is half of one.
    #[must_use]
    pub fn to_char(self) -> Option<char> {
        char::from_u32(self.0.into())
    }
}

impl TryFrom<char> for WChar {
    type Error = EncodeError;

    fn try_from(character: char) -> Result<Self, EncodeError> {
        let unit = u16::try_from(u32::from(character));
        unit.map(Self)
            .map_err(|_| EncodeError::WCharOutOfRange(character))
    }
}

/// An IDL `long double`: an IEEE 754 binary128, of which this implementation knows the bits alone.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct LongDouble(pub u128);

macro_rules! bits {
    ($type:ident($bits:ty), $kind:ident, $length:expr, $field:expr, $value:expr) => {
        impl CdrType for $type {
            const IS_PRIMITIVE: bool = true;
            const MIN_SIZE: usize = size_of::<$bits>();
            const LENGTH_CODE: LengthCode = $length;

            fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
                encoder.put(self.0);
                Ok(())
            }

            fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
                decoder.take().map(Self)
            }

            fn default_value() -> Self {
                Self::default()
            }

            fn add_key_size(size: &mut KeySize) {
                size.add(size_of::<$bits>(), 1);
            }

            fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
                let value: fn(&Self) -> Option<Value<'_>> = $value;
                path.is_empty().then(|| value(self)).flatten()
            }

            fn type_at(path: &[&str]) -> Option<FieldType> {
                leaf_type(path, $field?)
            }

            fn describe(_: &mut TypeBuilder) -> Option<TypePair> {
                Some(TypePair::primitive(TypeKind::$kind))
            }
        }
    };
}

bits!(
    WChar(u16),
    CHAR16,
    LengthCode::Two,
    Some(Kind::Char),
    |unit| unit.to_char().map(Value::Char)
);
// Content filters have no numbers of its precision.
bits!(
    LongDouble(u128),
    FLOAT128,
    LengthCode::NextInt,
    None::<Kind>,
    |_| None
);
