//! Hook 4, tc on egress of the loopback interface: what an app sends once leaves to all of its destinations.
//!
//! The packet, which may be a burst of several datagrams (GSO), is cloned for each destination but the last, and
//! each clone sent through the loopback interface once more, where this program gives it its addresses. So each
//! has headers of its own, and goes on by way of the neighbour table, which asks for neighbours that are not
//! known yet. (`bpf_fib_lookup` would find the hardware addresses here and now, but not on a host that does not
//! forward, and would not ask.)
//!
//! What is refused is dropped, and the app's system call fails, if it has IP_RECVERR: it then sends one by one.

use core::ops::ControlFlow;

use aya_ebpf::bindings::tcx_action_base::{TCX_DROP, TCX_NEXT};
use rtps_ebpf::{
    Bytes as _, Counter,
    abi::{Destination, Domain, FAN_OUT_ADDRESS, FAN_OUT_DESTINATIONS, FanOut, FanOutKey, Sender},
    frame::{ETHERNET_LEN, IPV4_DESTINATION, IPV4_MIN_LEN, UDP_LEN, datagram},
    review::{Opinion, Review},
    walk::MAX_STEPS,
};

use crate::{
    maps::{self, Counters},
    sys::{LinkBuffer, Repeat, repeat},
};

/// Where the UDP header is: frames of this hook have no VLAN tag, and those with IP options are refused.
const UDP: u32 = ETHERNET_LEN + IPV4_MIN_LEN;

/// The packet in hand. In a map, because the stack is too small, and because the copies that come by once more
/// find here where they go.
#[repr(C)]
pub(crate) struct Emission {
    /// A copy is on its way through the loopback interface, to `destination`.
    is_copying: bool,
    /// All datagrams are in the app's name.
    is_granted: bool,
    destination: Destination,
    key: FanOutKey,
    sender: Sender,
    review: Review,
    /// Offset of the datagram under review in the frame.
    start: u32,
    /// Where the last one ends.
    end: u32,
    /// Bytes of each but the last.
    segment: u32,
}

#[inline(always)]
pub(crate) fn handle(buffer: &LinkBuffer) -> i32 {
    let Some(emission) = maps::emission() else {
        return TCX_NEXT;
    };
    if emission.is_copying {
        return leave(buffer, &emission.destination);
    }
    let destination = buffer.load::<4>(ETHERNET_LEN + IPV4_DESTINATION);
    if !buffer.is_ipv4() || destination != Some(FAN_OUT_ADDRESS) {
        return TCX_NEXT;
    }
    let counters = Counters::of(buffer.ifindex());
    if let Err(counter) = arrive(buffer, emission).and_then(|()| review(buffer, emission)) {
        counters.count(counter);
        return TCX_DROP;
    }
    let Some(fan_out) = maps::fan_out(&emission.key) else {
        counters.count(Counter::DropFanOutUnknown);
        return TCX_DROP;
    };
    counters.count(Counter::FanOuts);
    send(buffer, emission, fan_out, counters)
}

/// Finds out who sends, and what.
#[inline(never)]
fn arrive(buffer: &LinkBuffer, emission: &mut Emission) -> Result<(), Counter> {
    let datagram = datagram(buffer).map_err(|_| Counter::DropFanOutDenied)?;
    if datagram.udp != UDP {
        return Err(Counter::DropFanOutDenied);
    }
    maps::config().ok_or(Counter::DropFanOutStranger)?;
    let sender = maps::sender(buffer.socket_cookie()).ok_or(Counter::DropFanOutStranger)?;
    emission.sender = *sender;
    emission.key = FanOutKey {
        slot: sender.slot,
        number: datagram.ports.destination.into(),
    };
    emission.start = UDP + UDP_LEN;
    emission.end = UDP + datagram.ports.len;
    let segment = buffer.segment();
    emission.segment = if segment == 0 {
        datagram.ports.len - UDP_LEN
    } else {
        segment
    };
    Ok(())
}

/// Whether the app may say all this.
#[inline(never)]
fn review(buffer: &LinkBuffer, emission: &mut Emission) -> Result<(), Counter> {
    let domain = maps::domain(emission.sender.domain_index).ok_or(Counter::DropFanOutDenied)?;
    if emission.segment == 0 || emission.segment > domain.datagram_size {
        return Err(Counter::DropFanOutDenied);
    }
    emission.is_granted = false;
    emission.review = Review::new(domain.guid_prefix, emission.sender.slot as u8);
    let mut reviewing = Reviewing {
        buffer,
        emission: &mut *emission,
        domain,
    };
    repeat(MAX_STEPS, &mut reviewing);
    if emission.is_granted {
        Ok(())
    } else {
        Err(Counter::DropFanOutDenied)
    }
}

struct Reviewing<'a> {
    buffer: &'a LinkBuffer,
    emission: &'a mut Emission,
    domain: &'static Domain,
}

impl Repeat for Reviewing<'_> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let emission = &mut *self.emission;
        let len = (emission.end - emission.start).min(emission.segment);
        let datagram = self.buffer.message(emission.start, len);
        match emission.review.step(&datagram) {
            Opinion::Continue => ControlFlow::Continue(()),
            Opinion::Denied => ControlFlow::Break(()),
            Opinion::Granted => {
                emission.start += len;
                if emission.start >= emission.end {
                    emission.is_granted = true;
                    return ControlFlow::Break(());
                }
                let slot = emission.sender.slot as u8;
                emission.review = Review::new(self.domain.guid_prefix, slot);
                ControlFlow::Continue(())
            }
        }
    }
}

/// Copies for all destinations but the last, which gets the packet itself.
#[inline(always)]
fn send(
    buffer: &LinkBuffer,
    emission: &mut Emission,
    fan_out: &'static FanOut,
    counters: Counters,
) -> i32 {
    let mut copying = Copying {
        buffer,
        emission,
        fan_out,
        counters,
        next: 0,
    };
    repeat(FAN_OUT_DESTINATIONS as u32, &mut copying);
    counters.count(Counter::FanOutCopies);
    match maps::destination(fan_out, fan_out.count.wrapping_sub(1)) {
        Some(last) => leave(buffer, last),
        None => TCX_DROP,
    }
}

struct Copying<'a> {
    buffer: &'a LinkBuffer,
    emission: &'a mut Emission,
    fan_out: &'static FanOut,
    counters: Counters,
    next: u32,
}

impl Repeat for Copying<'_> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let index = self.next;
        if index + 1 >= self.fan_out.count {
            return ControlFlow::Break(());
        }
        let Some(destination) = maps::destination(self.fan_out, index) else {
            return ControlFlow::Break(());
        };
        self.next = index + 1;
        self.emission.destination = *destination;
        self.emission.is_copying = true;
        let sent = self.buffer.send(self.buffer.ifindex());
        self.emission.is_copying = false;
        self.counters.count(match sent {
            Ok(()) => Counter::FanOutCopies,
            Err(()) => Counter::LostFanOut,
        });
        ControlFlow::Continue(())
    }
}

/// Gives the packet its addresses, and sends it on.
#[inline(never)]
fn leave(buffer: &LinkBuffer, destination: &Destination) -> i32 {
    match buffer.readdress(ETHERNET_LEN, UDP, destination) {
        Ok(()) => buffer.hand_to_neighbour(destination.ifindex),
        Err(()) => TCX_DROP,
    }
}
