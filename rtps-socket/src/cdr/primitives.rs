//! Primitive types, and runs of them: one copy where the byte order is this machine's.

use rtps_user::xtypes::{TypeBuilder, TypeKind, TypePair};

use super::fields::leaf_type;
use super::{
    ByteOrder, CdrType, DecodeError, Decoder, EncodeError, Encoder, FieldType, KeySize, Kind,
    LengthCode, Value,
};

/// A number as it stands on the wire.
pub(super) trait Primitive: Copy {
    const SIZE: usize;
    type Bytes: AsRef<[u8]>;

    fn bytes(self, order: ByteOrder) -> Self::Bytes;
    fn append(self, order: ByteOrder, out: &mut Vec<u8>) {
        out.extend_from_slice(self.bytes(order).as_ref());
    }
    fn append_all(values: &[Self], order: ByteOrder, out: &mut Vec<u8>);
    /// Reads the value at the start of `bytes`, unless they are too few.
    fn read(bytes: &[u8], order: ByteOrder) -> Option<Self>;
    /// Reads as many values as `bytes` holds.
    fn read_vec(bytes: &[u8], order: ByteOrder) -> Vec<Self>;
    /// Reads as many values as both sides hold.
    fn read_slice(bytes: &[u8], order: ByteOrder, values: &mut [Self]);
}

macro_rules! primitive {
    ($($type:ty)*) => {$(
        impl Primitive for $type {
            const SIZE: usize = size_of::<$type>();
            type Bytes = [u8; size_of::<$type>()];

            fn bytes(self, order: ByteOrder) -> Self::Bytes {
                match order {
                    ByteOrder::Little => self.to_le_bytes(),
                    ByteOrder::Big => self.to_be_bytes(),
                }
            }

            // Loops over fixed-size chunks, one for each byte order, compile to block moves.
            fn append_all(values: &[Self], order: ByteOrder, out: &mut Vec<u8>) {
                let start = out.len();
                out.resize(start + size_of_val(values), 0);
                let chunks = out[start..].as_chunks_mut().0.iter_mut().zip(values);
                match order {
                    ByteOrder::Little => chunks.for_each(|(to, from)| *to = from.to_le_bytes()),
                    ByteOrder::Big => chunks.for_each(|(to, from)| *to = from.to_be_bytes()),
                }
            }

            fn read(bytes: &[u8], order: ByteOrder) -> Option<Self> {
                let bytes = *bytes.first_chunk()?;
                Some(match order {
                    ByteOrder::Little => Self::from_le_bytes(bytes),
                    ByteOrder::Big => Self::from_be_bytes(bytes),
                })
            }

            fn read_vec(bytes: &[u8], order: ByteOrder) -> Vec<Self> {
                let chunks = bytes.as_chunks().0.iter();
                match order {
                    ByteOrder::Little => chunks.map(|from| Self::from_le_bytes(*from)).collect(),
                    ByteOrder::Big => chunks.map(|from| Self::from_be_bytes(*from)).collect(),
                }
            }

            fn read_slice(bytes: &[u8], order: ByteOrder, values: &mut [Self]) {
                let chunks = values.iter_mut().zip(bytes.as_chunks().0);
                match order {
                    ByteOrder::Little => chunks.for_each(|(to, from)| *to = Self::from_le_bytes(*from)),
                    ByteOrder::Big => chunks.for_each(|(to, from)| *to = Self::from_be_bytes(*from)),
                }
            }
        }
    )*};
}

macro_rules! cdr_number {
    ($field:ident, $value:ident: $($type:ty = $kind:ident)*) => {$(
        impl CdrType for $type {
            const IS_PRIMITIVE: bool = true;
            const MIN_SIZE: usize = size_of::<$type>();
            const LENGTH_CODE: LengthCode = LengthCode::of_primitive(size_of::<$type>());

            fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
                encoder.put(*self);
                Ok(())
            }

            fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
                decoder.take()
            }

            fn default_value() -> Self {
                Self::default()
            }

            fn add_key_size(size: &mut KeySize) {
                size.add(size_of::<$type>(), 1);
            }

            fn describe(_: &mut TypeBuilder) -> Option<TypePair> {
                Some(TypePair::primitive(TypeKind::$kind))
            }

            fn encode_slice(items: &[Self], encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
                encoder.put_all(items);
                Ok(())
            }

            fn decode_vec(decoder: &mut Decoder<'_>, count: usize) -> Result<Vec<Self>, DecodeError> {
                decoder.take_vec(count)
            }

            fn decode_slice(decoder: &mut Decoder<'_>, items: &mut [Self]) -> Result<(), DecodeError> {
                decoder.take_slice(items)
            }

            fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
                path.is_empty().then(|| Value::$value((*self).into()))
            }

            fn type_at(path: &[&str]) -> Option<FieldType> {
                leaf_type(path, Kind::$field)
            }
        }
    )*};
}

primitive!(i8 i16 u16 i32 u32 i64 u64 u128 f32 f64);
cdr_number!(Integer, Int: i8 = INT8 i16 = INT16 i32 = INT32 i64 = INT64);
cdr_number!(Integer, UInt: u8 = BYTE u16 = UINT16 u32 = UINT32 u64 = UINT64);
cdr_number!(Float32, Float: f32 = FLOAT32);
cdr_number!(Float, Float: f64 = FLOAT64);

impl Primitive for u8 {
    const SIZE: usize = 1;
    type Bytes = [Self; 1];

    fn bytes(self, _: ByteOrder) -> Self::Bytes {
        [self]
    }

    fn append_all(values: &[Self], _: ByteOrder, out: &mut Vec<u8>) {
        out.extend_from_slice(values);
    }

    fn read(bytes: &[u8], _: ByteOrder) -> Option<Self> {
        bytes.first().copied()
    }

    fn read_vec(bytes: &[u8], _: ByteOrder) -> Vec<Self> {
        bytes.to_vec()
    }

    fn read_slice(bytes: &[u8], _: ByteOrder, values: &mut [Self]) {
        values
            .iter_mut()
            .zip(bytes)
            .for_each(|(to, from)| *to = *from);
    }
}

impl CdrType for bool {
    const IS_PRIMITIVE: Self = true;
    const MIN_SIZE: usize = 1;
    const LENGTH_CODE: LengthCode = LengthCode::One;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        encoder.put(u8::from(*self));
        Ok(())
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        match decoder.take()? {
            0u8 => Ok(false),
            1 => Ok(true),
            other => Err(DecodeError::InvalidBool(other)),
        }
    }

    fn default_value() -> Self {
        false
    }

    fn add_key_size(size: &mut KeySize) {
        size.add(1, 1);
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        path.is_empty().then_some(Value::Bool(*self))
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        leaf_type(path, Kind::Bool)
    }

    fn describe(_: &mut TypeBuilder) -> Option<TypePair> {
        Some(TypePair::primitive(TypeKind::BOOLEAN))
    }
}

/// An IDL `char`: one byte, of ISO 8859-1.
impl CdrType for char {
    const IS_PRIMITIVE: bool = true;
    const MIN_SIZE: usize = 1;
    const LENGTH_CODE: LengthCode = LengthCode::One;

    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        let byte = u8::try_from(*self).map_err(|_| EncodeError::CharOutOfRange(*self))?;
        encoder.put(byte);
        Ok(())
    }

    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self::from(decoder.take::<u8>()?))
    }

    fn default_value() -> Self {
        '\0'
    }

    fn add_key_size(size: &mut KeySize) {
        size.add(1, 1);
    }

    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        path.is_empty().then_some(Value::Char(*self))
    }

    fn type_at(path: &[&str]) -> Option<FieldType> {
        leaf_type(path, Kind::Char)
    }

    fn describe(_: &mut TypeBuilder) -> Option<TypePair> {
        Some(TypePair::primitive(TypeKind::CHAR8))
    }
}
