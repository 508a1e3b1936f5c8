//! Strings, sequences, arrays and maps.

use std::collections::{BTreeMap, HashMap};
use std::hash::{BuildHasher, Hash};

use rtps_user::xtypes::{TypeBuilder, TypePair};

use super::fields::{element_type, index, leaf_type};
use super::{
    Bounded, CdrType, DecodeError, Decoder, EncodeError, Encoder, FieldType, KeySize, Kind,
    LengthCode, Value,
};

/// An IDL `string`: its length with the NUL, the characters, the NUL.
impl CdrType for String {
    // An empty string is a length of 1 and the NUL.
    const MIN_SIZE: usize = 5;
    const LENGTH_CODE: LengthCode = LengthCode::SharedBytes;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        if self.as_bytes().contains(&0) {
            return Err(EncodeError::NulInString);
        }
        encoder.put_len(self.len().saturating_add(1))?;
        encoder.put_bytes(self.as_bytes());
        encoder.put_bytes(&[0]);
        Ok(())
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let count = decoder.take_count(1)?;
        let bytes = decoder.take_bytes(count)?;
        let Some((0, characters)) = bytes.split_last() else {
            return Err(DecodeError::InvalidString);
        };
        if characters.contains(&0) {
            return Err(DecodeError::InvalidString);
        }
        let characters = str::from_utf8(characters).map_err(|_| DecodeError::InvalidUtf8)?;
        Ok(characters.to_owned())
    }

    fn default_value() -> Self {
        Self::new()
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
        Some(TypePair::string(false, 0))
    }
}

impl Bounded for String {
    fn bounded_len(&self) -> usize {
        self.len()
    }

    fn trim(&mut self, bound: usize) {
        self.truncate(self.floor_char_boundary(bound));
    }

    fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
        size.add(4, 1);
        size.add(1, bound.saturating_add(1));
    }

    fn describe_bounded(_: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        Some(TypePair::string(false, bound))
    }
}

/// An IDL `sequence`.
impl<T: CdrType> CdrType for Vec<T> {
    const MIN_SIZE: usize = 4;
    const LENGTH_CODE: LengthCode = if T::IS_PRIMITIVE {
        LengthCode::of_primitive_sequence(T::MIN_SIZE)
    } else {
        LengthCode::SharedBytes
    };

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        encoder.collection(T::IS_PRIMITIVE, |encoder| {
            encoder.put_len(self.len())?;
            T::encode_slice(self, encoder)
        })
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        decoder.collection(T::IS_PRIMITIVE, |decoder| {
            let count = decoder.take_count(T::MIN_SIZE)?;
            T::decode_vec(decoder, count)
        })
    }

    fn default_value() -> Self {
        Self::new()
    }

    fn add_key_size(size: &mut KeySize) {
        size.add_unbounded();
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        let (at, path) = index(path)?;
        self.get(at)?.value_at(path)
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        element_type::<T>(path)
    }

    fn describe(types: &mut TypeBuilder) -> Option<TypePair> {
        Some(T::describe(types)?.sequence(0))
    }
}

impl<T: CdrType> Bounded for Vec<T> {
    fn bounded_len(&self) -> usize {
        self.len()
    }

    fn trim(&mut self, bound: usize) {
        self.truncate(bound);
    }

    fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
        size.add_delimiter(T::IS_PRIMITIVE);
        size.add(4, 1);
        size.add_repeated(bound, T::add_key_size);
    }

    fn describe_bounded(types: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
        Some(T::describe(types)?.sequence(bound))
    }
}

/// An IDL array; an array of arrays is one of more dimensions.
impl<T: CdrType, const N: usize> CdrType for [T; N] {
    const LEAF_IS_PRIMITIVE: bool = T::LEAF_IS_PRIMITIVE;
    const MIN_SIZE: usize = N * T::MIN_SIZE;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        encoder.collection(T::LEAF_IS_PRIMITIVE, |encoder| self.encode_flat(encoder))
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        decoder.collection(T::LEAF_IS_PRIMITIVE, |decoder| {
            let mut array = Self::default_value();
            array.decode_flat(decoder)?;
            Ok(array)
        })
    }

    fn default_value() -> Self {
        std::array::from_fn(|_| T::default_value())
    }

    fn add_key_size(size: &mut KeySize) {
        size.add_delimiter(T::LEAF_IS_PRIMITIVE);
        size.add_repeated(N, T::add_key_size);
    }

    fn describe(types: &mut TypeBuilder) -> Option<TypePair> {
        Some(T::describe(types)?.array(u32::try_from(N).ok()?))
    }

    fn encode_flat(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        if T::IS_PRIMITIVE {
            return T::encode_slice(self, encoder);
        }
        self.iter().try_for_each(|item| item.encode_flat(encoder))
    }

    fn decode_flat(&mut self, decoder: &mut Decoder<'_>) -> Result<(), DecodeError> {
        if T::IS_PRIMITIVE {
            return T::decode_slice(decoder, self);
        }
        self.iter_mut()
            .try_for_each(|item| item.decode_flat(decoder))
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        let (at, path) = index(path)?;
        self.get(at)?.value_at(path)
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        element_type::<T>(path)
    }
}

/// Nothing on the wire: it lets types be recursive.
impl<T: CdrType> CdrType for Box<T> {
    const IS_PRIMITIVE: bool = T::IS_PRIMITIVE;
    const LEAF_IS_PRIMITIVE: bool = T::LEAF_IS_PRIMITIVE;
    const MIN_SIZE: usize = T::MIN_SIZE;
    const LENGTH_CODE: LengthCode = T::LENGTH_CODE;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        T::encode(self, encoder)
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        T::decode(decoder).map(Self::new)
    }

    fn default_value() -> Self {
        Self::new(T::default_value())
    }

    fn add_key_size(size: &mut KeySize) {
        T::add_key_size(size);
    }

    fn describe(types: &mut TypeBuilder) -> Option<TypePair> {
        T::describe(types)
    }

    fn encode_flat(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        T::encode_flat(self, encoder)
    }

    fn decode_flat(&mut self, decoder: &mut Decoder<'_>) -> Result<(), DecodeError> {
        T::decode_flat(self, decoder)
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        T::value_at(self, path)
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        T::type_at(path)
    }
}

macro_rules! map {
    ($map:ident<K, V $(, $hasher:ident)?>, $($bounds:tt)*) => {
        /// An IDL `map`.
        impl<K: CdrType + $($bounds)*, V: CdrType $(, $hasher: BuildHasher + Default)?> CdrType
            for $map<K, V $(, $hasher)?>
        {
            const MIN_SIZE: usize = 4;

            fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
                encoder.collection(K::IS_PRIMITIVE && V::IS_PRIMITIVE, |encoder| {
                    encoder.put_len(self.len())?;
                    self.iter().try_for_each(|(key, value)| {
                        key.encode(encoder)?;
                        value.encode(encoder)
                    })
                })
            }

            fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
                decoder.collection(K::IS_PRIMITIVE && V::IS_PRIMITIVE, |decoder| {
                    let count = decoder.take_count(K::MIN_SIZE + V::MIN_SIZE)?;
                    (0..count)
                        .map(|_| Ok((K::decode(decoder)?, V::decode(decoder)?)))
                        .collect()
                })
            }

            fn default_value() -> Self {
                Self::default()
            }

            fn add_key_size(size: &mut KeySize) {
                size.add_unbounded();
            }

            fn describe(types: &mut TypeBuilder) -> Option<TypePair> {
                Some(K::describe(types)?.map_to(V::describe(types)?, 0))
            }
        }

        impl<K: CdrType + $($bounds)*, V: CdrType $(, $hasher)?> Bounded for $map<K, V $(, $hasher)?> {
            fn bounded_len(&self) -> usize {
                self.len()
            }

            fn trim(&mut self, bound: usize) {
                let mut left = bound;
                self.retain(|_, _| left.checked_sub(1).is_some_and(|rest| {
                    left = rest;
                    true
                }));
            }

            fn add_bounded_key_size(size: &mut KeySize, bound: usize) {
                size.add_delimiter(K::IS_PRIMITIVE && V::IS_PRIMITIVE);
                size.add(4, 1);
                size.add_repeated(bound, |size| {
                    K::add_key_size(size);
                    V::add_key_size(size);
                });
            }

            fn describe_bounded(types: &mut TypeBuilder, bound: u32) -> Option<TypePair> {
                Some(K::describe(types)?.map_to(V::describe(types)?, bound))
            }
        }
    };
}

map!(BTreeMap<K, V>, Ord);
map!(HashMap<K, V, S>, Eq + Hash);
