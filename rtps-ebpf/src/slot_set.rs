//! A set of app slots: the value of the route map, and the result of a walk.

/// 256 bits, one for each slot; slot `n` is bit `n % 64` of word `n / 64`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlotSet([u64; 4]);

const _: () = assert!(size_of::<SlotSet>() == 32);

impl SlotSet {
    /// The set without a slot.
    pub const EMPTY: Self = Self([0; 4]);

    /// Adds a slot.
    #[inline(always)]
    pub const fn insert(&mut self, slot: u8) {
        self.0[(slot >> 6) as usize] |= 1 << (slot & 63);
    }

    /// Takes a slot out.
    #[inline(always)]
    pub const fn remove(&mut self, slot: u8) {
        self.0[(slot >> 6) as usize] &= !(1 << (slot & 63));
    }

    /// Whether the slot is in the set.
    #[inline(always)]
    pub const fn contains(&self, slot: u8) -> bool {
        self.0[(slot >> 6) as usize] & (1 << (slot & 63)) != 0
    }

    /// Whether no slot is in the set.
    #[inline(always)]
    pub const fn is_empty(&self) -> bool {
        let [a, b, c, d] = self.0;
        a | b | c | d == 0
    }

    /// Adds every slot of `other`.
    #[inline(always)]
    pub const fn union(&mut self, other: &Self) {
        self.0[0] |= other.0[0];
        self.0[1] |= other.0[1];
        self.0[2] |= other.0[2];
        self.0[3] |= other.0[3];
    }

    /// Takes the lowest slot out and returns it.
    #[inline(always)]
    pub const fn pop(&mut self) -> Option<u8> {
        let (word, base) = match &mut self.0 {
            [0, 0, 0, 0] => return None,
            [0, 0, 0, word] => (word, 192),
            [0, 0, word, _] => (word, 128),
            [0, word, _, _] => (word, 64),
            [word, _, _, _] => (word, 0),
        };
        let slot = base + lowest_bit(*word);
        *word &= *word - 1;
        Some(slot)
    }

    /// The slots in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = u8> + use<> {
        let mut rest = *self;
        core::iter::from_fn(move || rest.pop())
    }
}

impl FromIterator<u8> for SlotSet {
    fn from_iter<I: IntoIterator<Item = u8>>(slots: I) -> Self {
        let mut set = Self::EMPTY;
        slots.into_iter().for_each(|slot| set.insert(slot));
        set
    }
}

/// The number of the lowest bit set, as the number of ones in the bits below it.
///
/// By hand, because on the BPF target `trailing_zeros` becomes a look-up in a constant table, for
/// which the loader would need another map, and without branches, because the verifier would
/// follow each of them through all that comes after.
#[inline(always)]
const fn lowest_bit(word: u64) -> u8 {
    let below = (word & word.wrapping_neg()).wrapping_sub(1);
    let pairs = below - (below >> 1 & 0x5555_5555_5555_5555);
    let nibbles = (pairs & 0x3333_3333_3333_3333) + (pairs >> 2 & 0x3333_3333_3333_3333);
    let bytes = (nibbles + (nibbles >> 4)) & 0x0f0f_0f0f_0f0f_0f0f;
    let shorts = bytes + (bytes >> 8);
    let words = shorts + (shorts >> 16);
    (words + (words >> 32)) as u8
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, vec::Vec};

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn behaves_like_a_set_of_bytes(slots in prop::collection::btree_set(any::<u8>(), 0..40), removed: u8) {
            let mut set: SlotSet = slots.iter().copied().collect();
            prop_assert_eq!(set.iter().collect::<Vec<_>>(), slots.iter().copied().collect::<Vec<_>>());
            prop_assert_eq!(set.is_empty(), slots.is_empty());
            set.remove(removed);
            let rest: BTreeSet<u8> = slots.iter().copied().filter(|&slot| slot != removed).collect();
            prop_assert_eq!(set.iter().collect::<BTreeSet<_>>(), rest);
            prop_assert!(!set.contains(removed));
        }

        #[test]
        fn union_holds_the_slots_of_both(a: Vec<u8>, b: Vec<u8>) {
            let mut set: SlotSet = a.iter().copied().collect();
            set.union(&b.iter().copied().collect());
            for slot in 0..=255 {
                prop_assert_eq!(set.contains(slot), a.contains(&slot) || b.contains(&slot));
            }
        }
    }
}
