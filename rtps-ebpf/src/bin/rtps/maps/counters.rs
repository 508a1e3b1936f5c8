//! One set of counters for each interface and CPU.

use core::ptr::NonNull;

use aya_ebpf::{btf_maps::PerCpuHashMap, check_bounds_signed, macros::btf_map};
use rtps_ebpf::{Counter, Reason, abi};

#[btf_map(name = "counters")]
static COUNTERS: PerCpuHashMap<u32, [u64; Counter::COUNT], { abi::INTERFACES as usize }> =
    PerCpuHashMap::new();

/// The counters of one interface on this CPU.
#[derive(Clone, Copy)]
pub(crate) struct Counters(Option<NonNull<[u64; Counter::COUNT]>>);

impl Counters {
    /// Falls back to the common entry for an interface without its own.
    #[inline(always)]
    pub(crate) fn of(ifindex: u32) -> Self {
        let own = COUNTERS.get_ptr_mut(ifindex);
        Self(
            own.or_else(|| COUNTERS.get_ptr_mut(0))
                .and_then(NonNull::new),
        )
    }

    #[inline(always)]
    pub(crate) fn count(self, counter: Counter) {
        self.add(counter, 1);
    }

    #[inline(always)]
    pub(crate) fn count_malformed(self, reason: Option<Reason>) {
        if let Some(reason) = reason {
            self.add_at(reason as u8, 1);
        }
    }

    #[inline(always)]
    pub(crate) fn add(self, counter: Counter, amount: u64) {
        self.add_at(counter as u8, amount);
    }

    #[inline(always)]
    fn add_at(self, index: u8, amount: u64) {
        let Some(counters) = self.0 else { return };
        // The compiler knows the range of the enums' discriminants, the verifier does not.
        if check_bounds_signed(i64::from(index), 0, Counter::COUNT as i64 - 1) {
            // SAFETY: within the array; only this CPU writes it, in one context at a time.
            unsafe { *counters.cast::<u64>().add(index.into()).as_mut() += amount };
        }
    }
}
