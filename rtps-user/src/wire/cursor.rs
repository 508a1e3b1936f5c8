//! Reading of numbers and slices from a datagram in the byte order that its submessage declares.

use super::WireError;

/// Byte order of a submessage (flag E, RTPS 9.4.5.1.2) or of a CDR encapsulation.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Endianness {
    /// Most significant byte first.
    Big,
    /// Least significant byte first.
    Little,
}

impl Endianness {
    /// The byte order that flag E of a submessage declares.
    #[inline]
    pub fn from_flags(flags: u8) -> Self {
        if flags & 1 == 1 {
            Self::Little
        } else {
            Self::Big
        }
    }
}

/// A position in bytes that never reads beyond their end.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    endianness: Endianness,
}

impl<'a> Cursor<'a> {
    /// Starts at the first of `bytes`.
    #[inline]
    pub fn new(bytes: &'a [u8], endianness: Endianness) -> Self {
        Self {
            bytes,
            position: 0,
            endianness,
        }
    }

    /// Bytes read so far.
    #[inline]
    pub fn position(&self) -> usize {
        self.position
    }

    /// The byte order that numbers are read in.
    pub fn endianness(&self) -> Endianness {
        self.endianness
    }

    /// What has not been read yet.
    #[inline]
    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.position..).unwrap_or_default()
    }

    /// The next `count` bytes.
    #[inline]
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        let end = self
            .position
            .checked_add(count)
            .ok_or(WireError::UnexpectedEnd)?;
        let taken = self
            .bytes
            .get(self.position..end)
            .ok_or(WireError::UnexpectedEnd)?;
        self.position = end;
        Ok(taken)
    }

    /// This cursor, with no more than `count` further bytes to read.
    pub fn limited(&self, count: usize) -> Result<Self, WireError> {
        let end = self
            .position
            .checked_add(count)
            .ok_or(WireError::UnexpectedEnd)?;
        let bytes = self.bytes.get(..end).ok_or(WireError::UnexpectedEnd)?;
        Ok(Self { bytes, ..*self })
    }

    /// The next `N` bytes as an array.
    #[inline]
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let (array, _) = self
            .rest()
            .split_first_chunk::<N>()
            .ok_or(WireError::UnexpectedEnd)?;
        self.position += N;
        Ok(*array)
    }

    /// Skips to the next multiple of `alignment` (a power of two), counted from the start.
    pub fn align(&mut self, alignment: usize) -> Result<(), WireError> {
        let padding = self.position.wrapping_neg() & (alignment - 1);
        self.take(padding).map(|_| ())
    }

    /// An 8-bit unsigned number.
    #[inline]
    pub fn u8(&mut self) -> Result<u8, WireError> {
        Ok(self.array::<1>()?[0])
    }

    /// A 16-bit unsigned number.
    #[inline]
    pub fn u16(&mut self) -> Result<u16, WireError> {
        let bytes = self.array()?;
        Ok(match self.endianness {
            Endianness::Big => u16::from_be_bytes(bytes),
            Endianness::Little => u16::from_le_bytes(bytes),
        })
    }

    /// A 32-bit unsigned number.
    #[inline]
    pub fn u32(&mut self) -> Result<u32, WireError> {
        let bytes = self.array()?;
        Ok(match self.endianness {
            Endianness::Big => u32::from_be_bytes(bytes),
            Endianness::Little => u32::from_le_bytes(bytes),
        })
    }

    /// A 32-bit signed number.
    #[inline]
    pub fn i32(&mut self) -> Result<i32, WireError> {
        Ok(self.u32()?.cast_signed())
    }

    /// A CDR string: its length with the NUL (u32), the characters, the NUL.
    pub fn string(&mut self) -> Result<&'a str, WireError> {
        self.align(4)?;
        let length = usize::try_from(self.u32()?).map_err(|_| WireError::InvalidString)?;
        let bytes = self.take(length).map_err(|_| WireError::InvalidString)?;
        let (nul, characters) = bytes.split_last().ok_or(WireError::InvalidString)?;
        if *nul != 0 {
            return Err(WireError::InvalidString);
        }
        std::str::from_utf8(characters).map_err(|_| WireError::InvalidString)
    }
}
