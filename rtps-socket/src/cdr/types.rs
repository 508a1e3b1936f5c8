//! The traits of types that have a CDR encoding, and the words they are described with.

use rtps_user::xtypes::{Extensibility, TypeBuilder, TypePair, TypeSupport};

use super::{DecodeError, Decoder, EncodeError, Encoder, FieldType, Fields, KeySize, Value};

/// Order of the bytes of a multi-byte primitive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first: what this crate sends.
    Little,
    /// Most significant byte first.
    Big,
}

/// Which members of an aggregated type are encoded, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// All of them.
    Sample,
    /// Key members only, in the type's own encoding: the payload of a dispose or unregister.
    Key,
    /// Key members only, ordered by id, every type taken as final: the input of the key hash
    /// (XTypes 7.6.8).
    KeyHash,
}

/// How the EMHEADER of a mutable type's member gives the member's size, XTypes 7.4.3.4.2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthCode {
    /// One byte (LC 0).
    One,
    /// Two bytes (LC 1).
    Two,
    /// Four bytes (LC 2).
    Four,
    /// Eight bytes (LC 3).
    Eight,
    /// A NEXTINT of its own (LC 4).
    NextInt,
    /// The value begins with its size in bytes (LC 5).
    SharedBytes,
    /// The value begins with its size in units of 4 bytes (LC 6).
    SharedWords,
    /// The value begins with its size in units of 8 bytes (LC 7).
    SharedDoubleWords,
}

impl LengthCode {
    /// The code of a primitive of `size` bytes.
    pub(super) const fn of_primitive(size: usize) -> Self {
        match size {
            1 => Self::One,
            2 => Self::Two,
            4 => Self::Four,
            _ => Self::Eight,
        }
    }

    /// Whether all values have the same size.
    pub(super) const fn is_fixed(self) -> bool {
        matches!(self, Self::One | Self::Two | Self::Four | Self::Eight)
    }

    /// The code of a sequence whose elements are primitives of `size` bytes.
    pub(super) const fn of_primitive_sequence(size: usize) -> Self {
        match size {
            1 => Self::SharedBytes,
            4 => Self::SharedWords,
            8 => Self::SharedDoubleWords,
            _ => Self::NextInt,
        }
    }
}

/// A type with a CDR encoding: primitives, `String`, `Vec`, arrays, maps, `Box`, and whatever
/// derives `DdsType`.
///
/// The provided methods for runs of elements exist so that primitives are moved in one go.
#[diagnostic::on_unimplemented(
    message = "`{Self}` has no CDR encoding",
    note = "derive `DdsType` for structs and enums; `Option` is for members, not for elements"
)]
pub trait CdrType: Sized {
    /// A primitive in the sense of XTypes 7.4.3: collections of it have no DHEADER in XCDR2.
    const IS_PRIMITIVE: bool = false;
    /// Whether the scalar elements of an array are primitives; differs from
    /// [`IS_PRIMITIVE`](Self::IS_PRIMITIVE) for arrays, as `[[T; N]; M]` is one IDL array.
    const LEAF_IS_PRIMITIVE: bool = Self::IS_PRIMITIVE;
    /// The fewest bytes that a value takes in any representation.
    const MIN_SIZE: usize;
    /// How a mutable type's EMHEADER tells the size.
    const LENGTH_CODE: LengthCode = LengthCode::NextInt;

    /// Appends the value.
    ///
    /// # Errors
    /// When the value exceeds what its type or CDR can carry; the output is then incomplete.
    fn encode(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError>;

    /// Reads a value.
    ///
    /// # Errors
    /// When the bytes are not a value of the type.
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, DecodeError>;

    /// The value that a member has when the sender did not know it, XTypes 7.2.2.4.4.4.
    fn default_value() -> Self;

    /// Adds the largest serialized size of the type as (part of) a key.
    fn add_key_size(size: &mut KeySize);

    /// The value of the member at `path`, as [`Fields::field`] gives it; content filters have no access to the members
    /// of a type that does not say.
    fn value_at(&self, path: &[&str]) -> Option<Value<'_>> {
        let _ = path;
        None
    }

    /// The type of the member at `path`; `None` where there is no such member.
    fn type_at(path: &[&str]) -> Option<FieldType> {
        let _ = path;
        None
    }

    /// Says what the type is, for its TypeObject; `None` where that cannot be said.
    fn describe(types: &mut TypeBuilder) -> Option<TypePair> {
        let _ = types;
        None
    }

    /// Appends `items` without a count.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    fn encode_slice(items: &[Self], encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        items.iter().try_for_each(|item| item.encode(encoder))
    }

    /// Reads `count` values; the caller has compared `count` with what remains.
    ///
    /// # Errors
    /// As [`decode`](Self::decode).
    fn decode_vec(decoder: &mut Decoder<'_>, count: usize) -> Result<Vec<Self>, DecodeError> {
        // Elements may be far larger here than on the wire, so memory follows what was decoded.
        let fits = decoder.remaining() / size_of::<Self>().max(1);
        let mut items = Vec::with_capacity(count.min(fits));
        for _ in 0..count {
            items.push(Self::decode(decoder)?);
        }
        Ok(items)
    }

    /// Reads values over `items`.
    ///
    /// # Errors
    /// As [`decode`](Self::decode).
    fn decode_slice(decoder: &mut Decoder<'_>, items: &mut [Self]) -> Result<(), DecodeError> {
        for item in items {
            *item = Self::decode(decoder)?;
        }
        Ok(())
    }

    /// Appends the elements of an array, or the value itself, without a DHEADER of its own.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    fn encode_flat(&self, encoder: &mut Encoder<'_>) -> Result<(), EncodeError> {
        self.encode(encoder)
    }

    /// Reads what [`encode_flat`](Self::encode_flat) wrote.
    ///
    /// # Errors
    /// As [`decode`](Self::decode).
    fn decode_flat(&mut self, decoder: &mut Decoder<'_>) -> Result<(), DecodeError> {
        *self = Self::decode(decoder)?;
        Ok(())
    }
}

/// A type that can be the type of a topic. Implemented by `#[derive(DdsType)]`.
pub trait DdsType: CdrType + Fields {
    /// The registered type name, which must be the same on all sides.
    const TYPE_NAME: &'static str;
    /// Selects the encoding together with the representation.
    const EXTENSIBILITY: Extensibility;
    /// Whether the topic has instances.
    const HAS_KEY: bool;

    /// Whether endpoints announce what the type is; else they are matched by its name alone.
    const IS_DESCRIBED: bool = true;

    /// The type's TypeInformation (XTypes 7.6.3.2.1) as its endpoints announce it, and the TypeObjects
    /// that it names. Empty where the type is not described, or cannot be: where it refers to itself, or
    /// uses a type whose [`CdrType`] is implemented by hand without [`describe`](CdrType::describe).
    #[must_use]
    fn type_support() -> TypeSupport {
        match Self::IS_DESCRIBED {
            true => TypeBuilder::describe(Self::describe),
            false => TypeSupport::default(),
        }
    }

    /// The first part of [`type_support`](Self::type_support).
    #[must_use]
    fn type_information() -> Vec<u8> {
        Self::type_support().information
    }
}

/// [`CdrType::MIN_SIZE`] of a struct whose members take at least `members` bytes together.
#[must_use]
pub const fn min_struct_size(extensibility: Extensibility, members: usize) -> usize {
    match extensibility {
        Extensibility::Final => members,
        // In XCDR2 the writer's type may have no more than the DHEADER in common.
        Extensibility::Appendable if members < 4 => members,
        Extensibility::Appendable | Extensibility::Mutable => 4,
    }
}
