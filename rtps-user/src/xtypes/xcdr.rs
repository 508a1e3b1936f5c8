//! Extended CDR version 2 as far as type representation needs it: objects are at most 4-byte aligned, and all but
//! primitives may stand behind their size.

use crate::wire::{Cursor, Endianness, WireError};

/// Appends to bytes whose first one is the origin of alignment, little endian.
#[derive(Debug, Default)]
pub(super) struct Writer {
    out: Vec<u8>,
}

impl Writer {
    pub(super) fn finish(self) -> Vec<u8> {
        self.out
    }

    pub(super) fn u8(&mut self, value: u8) {
        self.out.push(value);
    }

    pub(super) fn u16(&mut self, value: u16) {
        self.align(2);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.align(4);
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.u32(value.cast_unsigned());
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    pub(super) fn string(&mut self, value: &str) {
        self.len(value.len() + 1);
        self.bytes(value.as_bytes());
        self.u8(0);
    }

    /// The length of a collection.
    pub(super) fn len(&mut self, len: usize) {
        self.u32(u32::try_from(len).unwrap_or(u32::MAX));
    }

    /// What `body` writes, behind its size (DHEADER).
    pub(super) fn delimited(&mut self, body: impl FnOnce(&mut Self)) {
        self.u32(0);
        let start = self.out.len();
        body(self);
        let len = u32::try_from(self.out.len() - start).unwrap_or(u32::MAX);
        self.out[start - 4..start].copy_from_slice(&len.to_le_bytes());
    }

    /// A sequence of what is not primitive.
    pub(super) fn sequence<T>(
        &mut self,
        items: impl ExactSizeIterator<Item = T>,
        mut item: impl FnMut(&mut Self, T),
    ) {
        self.delimited(|w| {
            w.len(items.len());
            items.for_each(|each| item(w, each));
        });
    }

    /// A member of a mutable type, behind an EMHEADER with its size (length code 4).
    pub(super) fn member(&mut self, id: u32, body: impl FnOnce(&mut Self)) {
        self.u32(0x4000_0000 | id);
        self.delimited(body);
    }

    /// An object that is serialized already, from its DHEADER on; its alignment is the same at every multiple of 4.
    pub(super) fn object(&mut self, bytes: &[u8]) {
        self.align(4);
        self.bytes(bytes);
    }

    fn align(&mut self, alignment: usize) {
        let len = self.out.len().next_multiple_of(alignment);
        self.out.resize(len, 0);
    }
}

/// Reads what is written so, every byte checked.
#[derive(Clone, Debug)]
pub(super) struct Reader<'a> {
    cursor: Cursor<'a>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8], endianness: Endianness) -> Self {
        Self {
            cursor: Cursor::new(bytes, endianness),
        }
    }

    pub(super) fn rest(&self) -> &'a [u8] {
        self.cursor.rest()
    }

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        self.cursor.take(count)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        self.cursor.array()
    }

    pub(super) fn u8(&mut self) -> Result<u8, WireError> {
        self.cursor.u8()
    }

    pub(super) fn u16(&mut self) -> Result<u16, WireError> {
        self.cursor.align(2)?;
        self.cursor.u16()
    }

    pub(super) fn u32(&mut self) -> Result<u32, WireError> {
        self.cursor.align(4)?;
        self.cursor.u32()
    }

    pub(super) fn i32(&mut self) -> Result<i32, WireError> {
        Ok(self.u32()?.cast_signed())
    }

    pub(super) fn string(&mut self) -> Result<&'a str, WireError> {
        self.cursor.string()
    }

    /// A sequence of octets.
    pub(super) fn octets(&mut self) -> Result<&'a [u8], WireError> {
        let len = self.u32()?;
        self.take(usize::try_from(len).map_err(|_| WireError::UnexpectedEnd)?)
    }

    /// Reads an object behind its size, all of which is then passed.
    pub(super) fn delimited<T>(
        &mut self,
        body: impl FnOnce(&mut Self) -> Result<T, WireError>,
    ) -> Result<T, WireError> {
        let len = self.u32()?;
        self.within(len, body)
    }

    fn within<T>(
        &mut self,
        len: u32,
        body: impl FnOnce(&mut Self) -> Result<T, WireError>,
    ) -> Result<T, WireError> {
        let len = usize::try_from(len).map_err(|_| WireError::UnexpectedEnd)?;
        let cursor = self.cursor.limited(len)?;
        let value = body(&mut Self { cursor })?;
        self.take(len)?;
        Ok(value)
    }

    /// The bytes of an object from its DHEADER on.
    pub(super) fn object(&mut self) -> Result<&'a [u8], WireError> {
        self.cursor.align(4)?;
        let len = self.clone().u32()?;
        let len = usize::try_from(len).map_err(|_| WireError::UnexpectedEnd)?;
        self.take(len.saturating_add(4))
    }

    /// Reads a sequence of what is not primitive. Memory follows what has been read.
    pub(super) fn sequence<T>(
        &mut self,
        mut item: impl FnMut(&mut Self) -> Result<T, WireError>,
    ) -> Result<Vec<T>, WireError> {
        self.delimited(|r| {
            let mut items = Vec::new();
            for _ in 0..r.u32()? {
                // An item takes a byte at least, so that the count cannot drive the loop.
                if r.rest().is_empty() {
                    return Err(WireError::UnexpectedEnd);
                }
                items.push(item(r)?);
            }
            Ok(items)
        })
    }

    /// Reads the members of a mutable type: `member` gets the id and the value of each.
    pub(super) fn members(
        &mut self,
        mut member: impl FnMut(u32, &mut Self) -> Result<(), WireError>,
    ) -> Result<(), WireError> {
        self.delimited(|r| {
            while r.rest().len() >= 4 {
                let header = r.u32()?;
                let id = header & 0x0fff_ffff;
                let len = r.member_len((header >> 28) & 7)?;
                r.within(len, |value| member(id, value))?;
            }
            Ok(())
        })
    }

    /// The size that a length code tells, XTypes 7.4.3.4.2; with codes from 5 on the value begins with it.
    fn member_len(&mut self, code: u32) -> Result<u32, WireError> {
        let unit = match code {
            0..=3 => return Ok(1 << code),
            4 => return self.u32(),
            5 => 1,
            6 => 4,
            _ => 8,
        };
        let count = self.clone().u32()?;
        let len = count.checked_mul(unit).and_then(|len| len.checked_add(4));
        len.ok_or(WireError::UnexpectedEnd)
    }
}
