//! Reading Extended CDR, every byte of it checked.

use super::{
    ByteOrder, CdrType, DecodeError, Extensibility, MAX_DEPTH, Member, MemberIds, MemberInfo,
    Representation, Scope, Struct, members::parameter, primitives::Primitive,
};

/// Reads objects from a slice.
///
/// Alignment is relative to the slice's start, at most 8 bytes in XCDR1 and 4 in XCDR2.
#[derive(Debug)]
pub struct Decoder<'a> {
    data: &'a [u8],
    position: usize,
    origin: usize,
    representation: Representation,
    byte_order: ByteOrder,
    scope: Scope,
    depth: u8,
}

impl<'a> Decoder<'a> {
    /// A decoder of `data`, whose first byte is the origin of alignment.
    #[must_use]
    pub fn new(
        data: &'a [u8],
        representation: Representation,
        byte_order: ByteOrder,
        scope: Scope,
    ) -> Self {
        Self {
            data,
            position: 0,
            origin: 0,
            representation,
            byte_order,
            scope,
            depth: 0,
        }
    }

    /// What is being decoded.
    #[must_use]
    pub fn scope(&self) -> Scope {
        self.scope
    }

    /// Bytes left of the payload or of the enclosing delimited object.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.data.len().saturating_sub(self.position)
    }

    /// Reads bytes as they are.
    ///
    /// # Errors
    /// When fewer remain.
    pub fn take_bytes(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let bytes = self
            .rest()
            .get(..count)
            .ok_or_else(|| self.too_short(count))?;
        self.position += count;
        Ok(bytes)
    }

    /// Reads the count of a collection whose elements take at least `min_size` bytes each.
    ///
    /// # Errors
    /// When the elements cannot be there.
    pub fn take_count(&mut self, min_size: usize) -> Result<usize, DecodeError> {
        let count: u32 = self.take()?;
        // Elements of a key may lack members; but each is one step of a loop, so it has a price.
        let min_size = match self.scope {
            Scope::Sample => min_size.max(1),
            Scope::Key | Scope::KeyHash => 1,
        };
        let remaining = self.remaining();
        usize::try_from(count)
            .ok()
            .filter(|count| *count <= remaining / min_size)
            .ok_or(DecodeError::CountTooLarge { count, remaining })
    }

    /// Decodes a struct: `body` reads its members.
    ///
    /// # Errors
    /// Those of `body`, and too deep nesting.
    pub fn structure<R>(
        &mut self,
        extensibility: Extensibility,
        body: impl FnOnce(&mut MemberDecoder<'_, 'a>) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        let extensible = extensibility != Extensibility::Final && self.scope != Scope::KeyHash;
        self.aggregate(extensibility, |decoder| {
            body(&mut MemberDecoder {
                decoder,
                extensible,
            })
        })
    }

    /// Decodes what an aggregated type contains, behind a DHEADER where it has one.
    ///
    /// # Errors
    /// Those of `body`, and too deep nesting.
    pub fn aggregate<R>(
        &mut self,
        extensibility: Extensibility,
        body: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        if self.depth == MAX_DEPTH {
            return Err(DecodeError::TooDeep);
        }
        self.depth += 1;
        let value = if extensibility == Extensibility::Final || self.scope == Scope::KeyHash {
            body(self)?
        } else {
            self.delimited(body)?
        };
        self.depth -= 1;
        Ok(value)
    }

    /// Decodes a collection, behind a DHEADER unless its elements are primitives.
    ///
    /// # Errors
    /// Those of `body`.
    pub fn collection<R>(
        &mut self,
        of_primitives: bool,
        body: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        if of_primitives {
            body(self)
        } else {
            self.delimited(body)
        }
    }

    pub(super) fn take<P: Primitive>(&mut self) -> Result<P, DecodeError> {
        self.align(P::SIZE)?;
        let value = P::read(self.rest(), self.byte_order).ok_or_else(|| self.too_short(P::SIZE))?;
        self.position += P::SIZE;
        Ok(value)
    }

    pub(super) fn take_vec<P: Primitive>(&mut self, count: usize) -> Result<Vec<P>, DecodeError> {
        let bytes = self.take_run::<P>(count)?;
        Ok(P::read_vec(bytes, self.byte_order))
    }

    pub(super) fn take_slice<P: Primitive>(&mut self, values: &mut [P]) -> Result<(), DecodeError> {
        let bytes = self.take_run::<P>(values.len())?;
        P::read_slice(bytes, self.byte_order, values);
        Ok(())
    }

    fn take_run<P: Primitive>(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        if count == 0 {
            return Ok(&[]);
        }
        self.align(P::SIZE)?;
        self.take_bytes(count.saturating_mul(P::SIZE))
    }

    fn align(&mut self, size: usize) -> Result<(), DecodeError> {
        let size = size.min(self.representation.max_alignment());
        let padding = self.origin.wrapping_sub(self.position) & (size - 1);
        self.take_bytes(padding).map(drop)
    }

    fn rest(&self) -> &'a [u8] {
        self.data.get(self.position..).unwrap_or_default()
    }

    fn too_short(&self, needed: usize) -> DecodeError {
        DecodeError::UnexpectedEnd {
            needed,
            remaining: self.remaining(),
        }
    }

    fn delimited<R>(
        &mut self,
        body: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        if self.representation == Representation::Xcdr1 {
            return body(self);
        }
        let size: u32 = self.take()?;
        let end = self.end_of(size)?;
        self.within(end, body)
    }

    /// All that a value that is refused leaves behind, but for the position.
    fn place(&self) -> (&'a [u8], usize, u8) {
        (self.data, self.origin, self.depth)
    }

    fn return_to(&mut self, (data, origin, depth): (&'a [u8], usize, u8)) {
        (self.data, self.origin, self.depth) = (data, origin, depth);
    }

    /// Where `size` bytes from here end.
    fn end_of(&self, size: u32) -> Result<usize, DecodeError> {
        let size = usize::try_from(size).unwrap_or(usize::MAX);
        if size > self.remaining() {
            return Err(self.too_short(size));
        }
        Ok(self.position + size)
    }

    /// Lets `body` see nothing behind `end`, then goes on there: what it left is skipped.
    fn within<R>(
        &mut self,
        end: usize,
        body: impl FnOnce(&mut Self) -> Result<R, DecodeError>,
    ) -> Result<R, DecodeError> {
        let data = self.data;
        self.data = data.get(..end).ok_or_else(|| self.too_short(end))?;
        let value = body(self)?;
        self.data = data;
        self.position = end;
        Ok(value)
    }

    /// Reads the value behind a member header; `None` when its length says that it is absent.
    fn member_value<M: Member>(&mut self, header: &MemberHeader) -> Result<Option<M>, DecodeError> {
        let xcdr1 = self.representation == Representation::Xcdr1;
        if xcdr1 && M::IS_OPTIONAL && header.end == self.position {
            return Ok(None);
        }
        let origin = self.origin;
        if xcdr1 {
            self.origin = self.position;
        }
        let value = self.within(header.end, |decoder| decoder.value::<M>())?;
        self.origin = origin;
        Ok(Some(value))
    }

    fn value<M: Member>(&mut self) -> Result<M, DecodeError> {
        CdrType::decode(self).map(M::from_value)
    }

    /// Reads a header of XCDR1 (XTypes 7.4.1.2); `None` at the end of the list.
    fn parameter_header(&mut self) -> Result<Option<MemberHeader>, DecodeError> {
        loop {
            self.align(4)?;
            let short: u16 = self.take()?;
            let length: u16 = self.take()?;
            let must_understand = short & parameter::MUST_UNDERSTAND != 0;
            match short & parameter::ID_MASK {
                parameter::LIST_END => return Ok(None),
                parameter::IGNORE => {
                    self.position = self.end_of(length.into())?;
                }
                parameter::EXTENDED => {
                    if length != parameter::EXTENDED_LENGTH {
                        return Err(DecodeError::InvalidMemberHeader(short.into()));
                    }
                    let id: u32 = self.take()?;
                    let length: u32 = self.take()?;
                    return Ok(Some(MemberHeader {
                        id: id & parameter::EXTENDED_ID_MASK,
                        must_understand: id & parameter::MUST_UNDERSTAND_EXTENDED != 0,
                        end: self.end_of(length)?,
                    }));
                }
                id if u32::from(id) > parameter::MAX_SHORT_ID => {
                    return Err(DecodeError::InvalidMemberHeader(short.into()));
                }
                id => {
                    return Ok(Some(MemberHeader {
                        id: id.into(),
                        must_understand,
                        end: self.end_of(length.into())?,
                    }));
                }
            }
        }
    }

    /// Reads an EMHEADER of XCDR2 (XTypes 7.4.3.4.2); `None` at the end of the object.
    fn enhanced_header(&mut self) -> Result<Option<MemberHeader>, DecodeError> {
        if self.remaining() == 0 {
            return Ok(None);
        }
        let header: u32 = self.take()?;
        let size = match (header >> 28) & 7 {
            code @ 0..=3 => 1 << code,
            4 => self.take()?,
            code => {
                // The length is the first word of the value: it is read again with it.
                let start = self.position;
                let count: u32 = self.take()?;
                self.position = start;
                let unit = if code == 5 { 1 } else { 4 << (code - 6) };
                count.saturating_mul(unit).saturating_add(4)
            }
        };
        Ok(Some(MemberHeader {
            id: header & parameter::EXTENDED_ID_MASK,
            must_understand: header >> 31 == 1,
            end: self.end_of(size)?,
        }))
    }
}

/// Id and extent of a mutable type's member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemberHeader {
    id: u32,
    must_understand: bool,
    end: usize,
}

impl MemberHeader {
    /// The member's id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.id
    }
}

/// Reads the members of one struct.
///
/// Final and appendable types [`take`](Self::take) them in their order. Mutable types ask for the
/// [`next`](Self::next) member and read its [`value`](Self::value) or [`skip`](Self::skip) it, and
/// [`finish`](Self::finish) each at the end.
#[derive(Debug)]
pub struct MemberDecoder<'d, 'a> {
    decoder: &'d mut Decoder<'a>,
    extensible: bool,
}

impl MemberDecoder<'_, '_> {
    /// What is being decoded.
    #[must_use]
    pub fn scope(&self) -> Scope {
        self.decoder.scope
    }

    /// Reads the next member; `default` stands in when the sender's type ends before it.
    ///
    /// # Errors
    /// Those of the member's value, and when a key is missing.
    pub fn take<M: Member>(
        &mut self,
        info: &MemberInfo,
        default: impl FnOnce() -> M,
    ) -> Result<M, DecodeError> {
        if self.extensible && self.at_end::<M>() {
            return self.finish(info, None, default);
        }
        let decoder = &mut *self.decoder;
        if !M::IS_OPTIONAL {
            return decoder.value();
        }
        let value = match decoder.representation {
            Representation::Xcdr1 => match decoder.parameter_header()? {
                Some(header) if header.id == info.id => decoder.member_value(&header)?,
                Some(header) => return Err(DecodeError::InvalidMemberHeader(header.id)),
                None => {
                    let list_end = parameter::LIST_END.into();
                    return Err(DecodeError::InvalidMemberHeader(list_end));
                }
            },
            Representation::Xcdr2 => {
                let present: bool = CdrType::decode(decoder)?;
                present.then(|| decoder.value()).transpose()?
            }
        };
        Ok(value.unwrap_or_else(M::default_member))
    }

    /// The header of a mutable type's next member.
    ///
    /// # Errors
    /// When it is malformed or reaches beyond its object.
    #[expect(
        clippy::should_implement_trait,
        reason = "an iterator could not lend the decoder to the member's value"
    )]
    pub fn next(&mut self) -> Result<Option<MemberHeader>, DecodeError> {
        match self.decoder.representation {
            Representation::Xcdr1 => self.decoder.parameter_header(),
            Representation::Xcdr2 => self.decoder.enhanced_header(),
        }
    }

    /// The value of the member that [`next`](Self::next) announced.
    ///
    /// # Errors
    /// Those of the value.
    pub fn value<M: Member>(&mut self, header: &MemberHeader) -> Result<Option<M>, DecodeError> {
        self.decoder.member_value(header)
    }

    /// As [`value`](Self::value), with the default for a value that the member's type does not have (XTypes 7.2.2.7,
    /// USE_DEFAULT).
    ///
    /// # Errors
    /// When the bytes are malformed.
    pub fn value_or_default<M: Member>(
        &mut self,
        header: &MemberHeader,
        default: impl FnOnce() -> M,
    ) -> Result<Option<M>, DecodeError> {
        let outside = self.decoder.place();
        match self.value(header) {
            Err(error) if error.is_about_value() => {
                self.decoder.return_to(outside);
                self.decoder.position = header.end;
                Ok(Some(default()))
            }
            result => result,
        }
    }

    /// As [`take`](Self::take), with the default for a value that the member's type does not have, if all of its values
    /// have one size, so that what follows can be found.
    ///
    /// # Errors
    /// As [`take`](Self::take) otherwise.
    pub fn take_or_default<M: Member>(
        &mut self,
        info: &MemberInfo,
        default: impl Fn() -> M,
    ) -> Result<M, DecodeError> {
        let outside = self.decoder.place();
        match self.take(info, &default) {
            Err(error) if error.is_about_value() && M::Value::LENGTH_CODE.is_fixed() => {
                self.decoder.return_to(outside);
                Ok(default())
            }
            result => result,
        }
    }

    /// Reads the members that a struct with these ids inherits. Those of mutable types may stand anywhere: the list is
    /// then read again for its own.
    ///
    /// # Errors
    /// Those of the members.
    pub fn inherited<B: Struct>(&mut self, ids: &MemberIds) -> Result<B, DecodeError> {
        let start = self.decoder.position;
        let base = B::take_members(self, ids)?;
        if B::EXTENSIBILITY == Extensibility::Mutable {
            self.decoder.position = start;
        }
        Ok(base)
    }

    /// Passes over a member that is not one's own; `ids` are those that the whole type has.
    ///
    /// # Errors
    /// When the type does not have it and the sender says that it must be understood.
    pub fn skip(&mut self, header: &MemberHeader, ids: &MemberIds) -> Result<(), DecodeError> {
        if header.must_understand && !ids.contains(header.id) {
            return Err(DecodeError::NotUnderstood { id: header.id });
        }
        self.decoder.position = header.end;
        Ok(())
    }

    /// The member read, or `default` when the sender did not send it.
    ///
    /// # Errors
    /// When a key is missing.
    pub fn finish<M: Member>(
        &self,
        info: &MemberInfo,
        member: Option<M>,
        default: impl FnOnce() -> M,
    ) -> Result<M, DecodeError> {
        match member {
            Some(member) => Ok(member),
            None if info.key => Err(DecodeError::MissingMember { member: info.name }),
            None => Ok(default()),
        }
    }

    /// Whether the sender's type ended before this member.
    fn at_end<M: Member>(&self) -> bool {
        let remaining = self.decoder.remaining();
        if remaining == 0 || self.decoder.representation == Representation::Xcdr2 {
            return remaining == 0;
        }
        // XCDR1 has no delimiter, and some senders do not announce the padding at the end.
        let zeros = self.decoder.rest().iter().all(|byte| *byte == 0);
        remaining < 4 && remaining < M::MIN_SIZE && zeros
    }
}
