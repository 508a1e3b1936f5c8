//! Hashing of keys that are of the app's own making: nobody else can choose them so that they collide.

use std::hash::{BuildHasherDefault, Hasher};

/// For maps with such keys.
pub type OwnKeys = BuildHasherDefault<OwnKeyHasher>;

/// Folds the words of a key. Most are numbers that were counted up, or hashes already.
#[derive(Clone, Copy, Debug, Default)]
pub struct OwnKeyHasher(u64);

impl OwnKeyHasher {
    fn fold(&mut self, word: u64) {
        // An odd number without pattern spreads the bits of small keys upwards, and the rotation down again.
        const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
        let mixed = (self.0 ^ word).wrapping_mul(SPREAD);
        self.0 = mixed ^ (mixed >> 32);
    }
}

impl Hasher for OwnKeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for word in bytes.chunks(8) {
            let mut padded = [0; 8];
            padded[..word.len()].copy_from_slice(word);
            self.fold(u64::from_le_bytes(padded));
        }
    }

    fn write_u32(&mut self, word: u32) {
        self.fold(word.into());
    }

    fn write_u128(&mut self, words: u128) {
        self.fold(words as u64);
        self.fold((words >> 64) as u64);
    }
}
