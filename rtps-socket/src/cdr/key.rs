//! The key hash: RTPS 2.5 section 9.6.4.8, XTypes 1.3 section 7.6.8.

use md5::{Digest, Md5};

use super::{ByteOrder, DdsType, EncodeError, Encoder, Representation, Scope};

/// A key hash is the key itself when no key of the type takes more bytes.
const KEY_HASH_SIZE: usize = 16;

/// The key hash of a value that is sent in `representation`; zeros for a type without key.
///
/// The key members, ordered by id and as if all types were final, are serialized big endian; a
/// type whose keys may take more than 16 bytes has their MD5. As Cyclone DDS does, the
/// representation is that of the data: only for keys with 8-byte primitives or with collections
/// of strings and structs does it make a difference. `scratch` holds the serialized key meanwhile.
///
/// # Errors
/// When the key cannot be encoded.
pub fn key_hash<T: DdsType>(
    value: &T,
    representation: Representation,
    scratch: &mut Vec<u8>,
) -> Result<[u8; KEY_HASH_SIZE], EncodeError> {
    let mut hash = [0; KEY_HASH_SIZE];
    if !T::HAS_KEY {
        return Ok(hash);
    }
    scratch.clear();
    let mut encoder = Encoder::new(scratch, representation, ByteOrder::Big, Scope::KeyHash);
    value.encode(&mut encoder)?;
    let mut size = KeySize::new(representation);
    T::add_key_size(&mut size);
    match hash.get_mut(..scratch.len()) {
        Some(start) if !size.exceeded() => start.copy_from_slice(scratch),
        _ => hash = Md5::digest(scratch).into(),
    }
    Ok(hash)
}

/// The largest serialized size of a type's key, counted until it exceeds a key hash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeySize {
    size: usize,
    representation: Representation,
}

impl KeySize {
    /// Nothing added yet.
    #[must_use]
    pub fn new(representation: Representation) -> Self {
        Self {
            size: 0,
            representation,
        }
    }

    /// Whether keys may take more than 16 bytes.
    #[must_use]
    pub fn exceeded(&self) -> bool {
        self.size > KEY_HASH_SIZE
    }

    /// Adds `count` primitives of `size` bytes.
    pub fn add(&mut self, size: usize, count: usize) {
        let alignment = size.min(self.representation.max_alignment());
        if !self.exceeded() {
            let aligned = self.size.next_multiple_of(alignment);
            self.size = aligned.saturating_add(size.saturating_mul(count));
        }
    }

    /// Adds something without a largest size.
    pub fn add_unbounded(&mut self) {
        self.size = usize::MAX;
    }

    /// Adds what `add` adds, unless the answer is known: so recursive types come to an end.
    pub fn add_unless_exceeded(&mut self, add: impl FnOnce(&mut Self)) {
        if !self.exceeded() {
            add(self);
        }
    }

    /// Adds the largest of several alternatives.
    pub fn add_largest(&mut self, alternatives: &[fn(&mut Self)]) {
        let start = *self;
        for add in alternatives {
            let mut size = start;
            self.add_unless_exceeded(|largest| {
                add(&mut size);
                largest.size = largest.size.max(size.size);
            });
        }
    }

    pub(super) fn add_repeated(&mut self, count: usize, add: impl Fn(&mut Self)) {
        for _ in 0..count {
            let before = self.size;
            self.add_unless_exceeded(&add);
            if self.size == before {
                // Exceeded, or elements of no size.
                return;
            }
        }
    }

    /// The DHEADER that XCDR2 puts before collections of anything but primitives.
    pub(super) fn add_delimiter(&mut self, of_primitives: bool) {
        if !of_primitives && self.representation == Representation::Xcdr2 {
            self.add(4, 1);
        }
    }

    /// What says that an optional member is there.
    pub(super) fn add_optional(&mut self) {
        match self.representation {
            Representation::Xcdr1 => self.add(4, 1),
            Representation::Xcdr2 => self.add(1, 1),
        }
    }
}
