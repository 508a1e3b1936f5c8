//! What a frame at the tc hook has for apps: a datagram, or several in one.
//!
//! A veth hands over as one what its other end has sent in one call (GSO), unless an XDP program is in the way. Each
//! datagram is walked by itself, and who is concerned by one of them gets all, in one record.

use core::ops::ControlFlow;

use rtps_ebpf::{
    Counter, SlotSet,
    abi::{DOORBELL_PACKET, Domain},
    frame::UDP_LEN,
};

use crate::{
    deliver::{Delivery, ring},
    maps::{self, Counters, Scratch},
    message::examine,
    sys::{LinkBuffer, Repeat, repeat},
};

/// UDP_MAX_SEGMENTS, the most that the kernel puts into one.
const MAX_DATAGRAMS: u32 = 128;

/// The datagrams in hand.
#[repr(C)]
pub(crate) struct Burst {
    /// Where the next one begins in the frame.
    start: u32,
    /// Where the last one ends.
    end: u32,
    /// Bytes of each but the last.
    segment: u32,
    /// How many there have been.
    count: u32,
    /// The apps that these concern.
    targets: SlotSet,
}

/// What became of a frame for one of the apps' ports.
pub(crate) enum Taken {
    /// Nothing: built-in endpoints are concerned as well, or it is a burst that holds something else than messages for
    /// apps. Others see each of its datagrams by itself.
    Left,
    /// It concerns nobody.
    Nobody(Counter),
    /// Apps have it in their rings.
    Delivered,
    /// The same, and it now is on its way to the port of an app that sleeps.
    Rings,
}

/// Delivers what the frame, which [`Scratch::header`] describes, has for apps.
#[inline(never)]
pub(crate) fn take(buffer: &LinkBuffer, scratch: &mut Scratch) -> Taken {
    let Some(domain) = maps::domain(scratch.header.domain_index.into()) else {
        return Taken::Left;
    };
    let counters = Counters::of(buffer.ifindex());
    let is_one = scratch.header.segment == 0;
    match walk(buffer, scratch, domain) {
        Ok(()) => {}
        Err(Some(counter)) if is_one => {
            counters.count(Counter::IngressMessages);
            counters.count_malformed(scratch.malformed);
            return Taken::Nobody(counter);
        }
        Err(_) => return Taken::Left,
    }
    counters.add(Counter::IngressMessages, scratch.burst.count.into());
    counters.count_malformed(scratch.malformed);
    deliver(buffer, scratch, counters)
}

/// Finds the apps that all of the datagrams are for. The error is that one is not, with the counter if it is for nobody.
#[inline(always)]
fn walk(
    buffer: &LinkBuffer,
    scratch: &mut Scratch,
    domain: &'static Domain,
) -> Result<(), Option<Counter>> {
    let len = scratch.header.message_len;
    let start = scratch.datagram.udp + UDP_LEN;
    scratch.burst = Burst {
        start,
        end: start + len,
        segment: match scratch.header.segment {
            0 => len,
            segment => segment.into(),
        },
        count: 0,
        targets: SlotSet::EMPTY,
    };
    let mut walk = Walk {
        buffer,
        scratch,
        domain,
        // More than there can be, until the last one is reached.
        found: Err(None),
    };
    repeat(MAX_DATAGRAMS, &mut walk);
    walk.found?;
    scratch.targets = scratch.burst.targets;
    Ok(())
}

struct Walk<'a> {
    buffer: &'a LinkBuffer,
    scratch: &'a mut Scratch,
    domain: &'static Domain,
    found: Result<(), Option<Counter>>,
}

impl Repeat for Walk<'_> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let scratch = &mut *self.scratch;
        let (start, end) = (scratch.burst.start, scratch.burst.end);
        let len = (end - start).min(scratch.burst.segment);
        let message = self.buffer.message(start, len);
        match examine(&message, scratch, self.domain) {
            Ok(false) => scratch.burst.targets.union(&scratch.targets),
            Ok(true) => return ControlFlow::Break(()),
            Err(counter) => {
                self.found = Err(Some(counter));
                return ControlFlow::Break(());
            }
        }
        scratch.burst.count += 1;
        scratch.burst.start = start + len;
        if start + len >= end {
            self.found = Ok(());
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

#[inline(always)]
fn deliver(buffer: &LinkBuffer, scratch: &mut Scratch, counters: Counters) -> Taken {
    let by_packet = maps::config().is_some_and(|config| config.doorbell == DOORBELL_PACKET);
    let message = buffer.message(scratch.datagram.udp + UDP_LEN, scratch.header.message_len);
    // The stack would take several datagrams apart again before the first could wake anybody.
    let doorbell_by_packet = by_packet && scratch.datagram.ipv4 && scratch.header.segment == 0;
    let mut delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet,
    };
    match delivery.run() {
        Some(port) if ring(buffer, scratch.datagram.udp, port).is_ok() => Taken::Rings,
        _ => Taken::Delivered,
    }
}
