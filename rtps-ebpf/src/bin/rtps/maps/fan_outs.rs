//! Which app a socket is of, and its lists of destinations.

use aya_ebpf::{
    bindings::BPF_F_NO_PREALLOC,
    btf_maps::{HashMap, PerCpuArray},
    check_bounds_signed,
    macros::btf_map,
};
use rtps_ebpf::abi::{self, Destination, FAN_OUT_DESTINATIONS, FanOut, FanOutKey, Sender};

use crate::fan_out::Emission;

#[btf_map(name = "senders")]
static SENDERS: HashMap<u64, Sender, { abi::SLOTS as usize }> = HashMap::new();
#[btf_map(name = "fan_outs")]
static FAN_OUTS: HashMap<
    FanOutKey,
    FanOut,
    { abi::FAN_OUTS as usize },
    { BPF_F_NO_PREALLOC as usize },
> = HashMap::new();
#[btf_map(name = "emission")]
static EMISSION: PerCpuArray<Emission, 1> = PerCpuArray::new();

/// The app whose socket has this cookie.
#[inline(always)]
pub(crate) fn sender(cookie: u64) -> Option<&'static Sender> {
    // SAFETY: the value is read at once; a reused one names an app, too, whose name is then checked.
    unsafe { SENDERS.get(cookie) }
}

/// A list of destinations.
#[inline(always)]
pub(crate) fn fan_out(key: &FanOutKey) -> Option<&'static FanOut> {
    // SAFETY: rtpsd replaces a list as a whole, and the kernel frees the old one only when no program runs any
    // more that may have found it.
    unsafe { FAN_OUTS.get(key) }
}

/// One destination of a list.
#[inline(always)]
pub(crate) fn destination(fan_out: &'static FanOut, index: u32) -> Option<&'static Destination> {
    if !check_bounds_signed(i64::from(index), 0, FAN_OUT_DESTINATIONS as i64 - 1) {
        return None;
    }
    // SAFETY: within the array.
    Some(unsafe { &*fan_out.destinations.as_ptr().add(index as usize) })
}

/// What this CPU is sending to several destinations.
#[inline(always)]
pub(crate) fn emission() -> Option<&'static mut Emission> {
    // SAFETY: a CPU sends one packet at a time. The copies that come by meanwhile only read where they go.
    EMISSION
        .get_ptr_mut(0)
        .map(|emission| unsafe { &mut *emission })
}
