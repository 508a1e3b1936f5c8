//! Writing Extended CDR: alignment, delimiters and member headers.

use super::{
    ByteOrder, CdrType, EncodeError, Extensibility, LengthCode, MAX_DEPTH, Member, MemberInfo,
    Representation, Scope, members::parameter, primitives::Primitive,
};

/// Appends objects to a caller's buffer.
///
/// Alignment is relative to the buffer's length at construction, at most 8 bytes in XCDR1 and 4 in
/// XCDR2.
#[derive(Debug)]
pub struct Encoder<'a> {
    out: &'a mut Vec<u8>,
    origin: usize,
    representation: Representation,
    byte_order: ByteOrder,
    scope: Scope,
    depth: u8,
}

impl<'a> Encoder<'a> {
    /// An encoder whose origin is the present end of `out`.
    pub fn new(
        out: &'a mut Vec<u8>,
        representation: Representation,
        byte_order: ByteOrder,
        scope: Scope,
    ) -> Self {
        let origin = out.len();
        Self {
            out,
            origin,
            representation,
            byte_order,
            scope,
            depth: 0,
        }
    }

    /// What is being encoded; a keyed type writes its key members only unless this is a sample.
    #[must_use]
    pub fn scope(&self) -> Scope {
        self.scope
    }

    /// Appends the length of a string or collection.
    ///
    /// # Errors
    /// When it does not fit 32 bits.
    pub fn put_len(&mut self, len: usize) -> Result<(), EncodeError> {
        let len = u32::try_from(len).map_err(|_| EncodeError::TooLong(len))?;
        self.put(len);
        Ok(())
    }

    /// Appends bytes as they are.
    pub fn put_bytes(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    /// Encodes a struct: `body` writes its members.
    ///
    /// # Errors
    /// Those of `body`, and too deep nesting.
    pub fn structure(
        &mut self,
        extensibility: Extensibility,
        body: impl FnOnce(&mut MemberEncoder<'_, 'a>) -> Result<(), EncodeError>,
    ) -> Result<(), EncodeError> {
        let mutable = extensibility == Extensibility::Mutable && self.scope != Scope::KeyHash;
        self.aggregate(extensibility, |encoder| {
            body(&mut MemberEncoder { encoder, mutable })?;
            if mutable && encoder.representation == Representation::Xcdr1 {
                encoder.align(4);
                encoder.put(parameter::MUST_UNDERSTAND | parameter::LIST_END);
                encoder.put(0u16);
            }
            Ok(())
        })
    }

    /// Encodes what an aggregated type contains, behind a DHEADER where it has one.
    ///
    /// # Errors
    /// Those of `body`, and too deep nesting.
    pub fn aggregate(
        &mut self,
        extensibility: Extensibility,
        body: impl FnOnce(&mut Self) -> Result<(), EncodeError>,
    ) -> Result<(), EncodeError> {
        if self.depth == MAX_DEPTH {
            return Err(EncodeError::TooDeep);
        }
        self.depth += 1;
        if extensibility == Extensibility::Final || self.scope == Scope::KeyHash {
            body(self)?;
        } else {
            self.delimited(body)?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Encodes a collection, behind a DHEADER unless its elements are primitives.
    ///
    /// # Errors
    /// Those of `body`.
    pub fn collection(
        &mut self,
        of_primitives: bool,
        body: impl FnOnce(&mut Self) -> Result<(), EncodeError>,
    ) -> Result<(), EncodeError> {
        if of_primitives {
            body(self)
        } else {
            self.delimited(body)
        }
    }

    pub(super) fn put<P: Primitive>(&mut self, value: P) {
        self.align(P::SIZE);
        value.append(self.byte_order, self.out);
    }

    pub(super) fn put_all<P: Primitive>(&mut self, values: &[P]) {
        // An empty run is nothing at all, not even alignment.
        if !values.is_empty() {
            self.align(P::SIZE);
            P::append_all(values, self.byte_order, self.out);
        }
    }

    fn align(&mut self, size: usize) {
        let size = size.min(self.representation.max_alignment());
        let padding = self.origin.wrapping_sub(self.out.len()) & (size - 1);
        self.out.extend_from_slice(&[0; 8][..padding]);
    }

    /// XCDR2 puts the size of delimited objects in front of them; XCDR1 knows no delimiter.
    fn delimited(
        &mut self,
        body: impl FnOnce(&mut Self) -> Result<(), EncodeError>,
    ) -> Result<(), EncodeError> {
        if self.representation == Representation::Xcdr1 {
            return body(self);
        }
        let start = self.reserve_length();
        body(self)?;
        self.fill_length(start)
    }

    /// A member behind the parameter header of XCDR1 (XTypes 7.4.1.2); `None` has length 0.
    fn parameter<T: CdrType>(
        &mut self,
        info: &MemberInfo,
        value: Option<&T>,
    ) -> Result<(), EncodeError> {
        self.align(4);
        let header = self.out.len();
        let size = if info.id > parameter::MAX_SHORT_ID {
            parameter::EXTENDED_SIZE
        } else {
            parameter::SHORT_SIZE
        };
        self.out.resize(header + size, 0);
        if let Some(value) = value {
            // The value is aligned as if it stood alone.
            let origin = std::mem::replace(&mut self.origin, header + size);
            value.encode(self)?;
            self.origin = origin;
        }
        self.fill_parameter_header(info, header, size)
    }

    /// Fills the header in, and makes it an extended one when the value is too long for a short.
    fn fill_parameter_header(
        &mut self,
        info: &MemberInfo,
        at: usize,
        size: usize,
    ) -> Result<(), EncodeError> {
        let length = self.out.len() - at - size;
        if let (Ok(length), parameter::SHORT_SIZE) = (u16::try_from(length), size) {
            let flag = u16::from(info.must_understand) * parameter::MUST_UNDERSTAND;
            // The id fits: the header has been laid out as a short one.
            self.patch(at, flag | (info.id & 0x3fff) as u16);
            self.patch(at + 2, length);
            return Ok(());
        }
        let length = u32::try_from(length).map_err(|_| EncodeError::TooLong(length))?;
        if size == parameter::SHORT_SIZE {
            let missing = [0; parameter::EXTENDED_SIZE - parameter::SHORT_SIZE];
            self.out.splice(at..at, missing);
        }
        let flag = u32::from(info.must_understand) * parameter::MUST_UNDERSTAND_EXTENDED;
        self.patch(at, parameter::MUST_UNDERSTAND | parameter::EXTENDED);
        self.patch(at + 2, parameter::EXTENDED_LENGTH);
        self.patch(at + 4, flag | info.id);
        self.patch(at + 8, length);
        Ok(())
    }

    /// A member behind the EMHEADER of XCDR2 (XTypes 7.4.3.4.2).
    fn enhanced<T: CdrType>(&mut self, info: &MemberInfo, value: &T) -> Result<(), EncodeError> {
        let flag = u32::from(info.must_understand) << 31;
        self.put(flag | (T::LENGTH_CODE as u32) << 28 | info.id);
        if T::LENGTH_CODE != LengthCode::NextInt {
            return value.encode(self);
        }
        let start = self.reserve_length();
        value.encode(self)?;
        self.fill_length(start)
    }

    /// Leaves room for a 32-bit length; returns where the counted bytes start.
    fn reserve_length(&mut self) -> usize {
        self.put(0u32);
        self.out.len()
    }

    fn fill_length(&mut self, start: usize) -> Result<(), EncodeError> {
        let length = self.out.len() - start;
        let length = u32::try_from(length).map_err(|_| EncodeError::TooLong(length))?;
        self.patch(start - 4, length);
        Ok(())
    }

    fn patch<P: Primitive>(&mut self, at: usize, value: P) {
        let bytes = value.bytes(self.byte_order);
        self.out[at..at + P::SIZE].copy_from_slice(bytes.as_ref());
    }
}

/// Writes the members of one struct.
#[derive(Debug)]
pub struct MemberEncoder<'e, 'a> {
    encoder: &'e mut Encoder<'a>,
    mutable: bool,
}

impl MemberEncoder<'_, '_> {
    /// What is being encoded.
    #[must_use]
    pub fn scope(&self) -> Scope {
        self.encoder.scope
    }

    /// Writes one member.
    ///
    /// # Errors
    /// Those of the member's value.
    pub fn put<M: Member>(&mut self, info: &MemberInfo, member: &M) -> Result<(), EncodeError> {
        let encoder = &mut *self.encoder;
        let value = member.value();
        match (encoder.representation, value) {
            (_, None) if self.mutable => Ok(()),
            (Representation::Xcdr1, Some(value)) if self.mutable => {
                encoder.parameter(info, Some(value))
            }
            (Representation::Xcdr2, Some(value)) if self.mutable => encoder.enhanced(info, value),
            (Representation::Xcdr1, value) if M::IS_OPTIONAL => encoder.parameter(info, value),
            (Representation::Xcdr2, value) if M::IS_OPTIONAL => {
                encoder.put(u8::from(value.is_some()));
                value.map_or(Ok(()), |value| value.encode(encoder))
            }
            (_, value) => value.map_or(Ok(()), |value| value.encode(encoder)),
        }
    }
}
