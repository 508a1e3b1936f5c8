//! Counts of HEARTBEATs and ACKNACKs (RTPS 2.5, 8.3.8.1.2 and 8.3.8.6.2), which kernel and rtpsd both take
//! from the time, so that neither has to know what the other has counted.

/// Nanoseconds that a count stands for, as a power of two: some 8 ms, so that it takes 208 days until
/// counts become negative and 417 until they begin anew.
const TICK_BITS: u32 = 23;

/// The count at an age, in nanoseconds, of what counts.
#[inline(always)]
pub const fn count_at(age_ns: u64) -> u32 {
    (age_ns >> TICK_BITS) as u32
}

/// The count that follows `previous` at that age.
#[inline(always)]
pub const fn next_count(previous: u32, age_ns: u64) -> u32 {
    let (next, now) = (previous.wrapping_add(1), count_at(age_ns));
    if next > now { next } else { now }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_grow_with_each_use_and_with_time() {
        let second = 1_000_000_000;
        assert_eq!(next_count(0, 0), 1);
        assert_eq!(next_count(1, 0), 2);
        assert_eq!(count_at(second), 119);
        assert_eq!(next_count(5, second), 119);
        assert_eq!(next_count(119, second), 120);
    }
}
