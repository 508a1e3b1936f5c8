//! What a frame at the tc hook has for apps: a datagram, or several in one.
//!
//! A veth hands over as one what its other end has sent in one call (GSO), unless an XDP program is in the way. The
//! datagrams are walked one after the other, and who is concerned by one of them gets all, in one record.

use core::ops::ControlFlow;

use rtps_ebpf::{
    Counter,
    abi::DOORBELL_PACKET,
    frame::{Datagram, IPV4_CHECKSUM, IPV4_LENGTH, UDP_LEN, UDP_LENGTH},
};

use crate::{
    deliver::{Delivery, ring},
    maps::{self, Counters, Scratch},
    message,
    sys::{LinkBuffer, Overwrite as _, Repeat, repeat},
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
}

/// What became of a frame for one of the apps' ports.
pub(crate) enum Taken {
    /// Nothing: built-in endpoints are concerned as well, or it is a burst for nobody, or with something malformed.
    /// Others see each of its datagrams by itself.
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
    message::begin(scratch, domain);
    if !walk(buffer, scratch) {
        return Taken::Left;
    }
    let counters = Counters::of(buffer.ifindex());
    let concerned = message::conclude(scratch);
    match concerned {
        Ok(false) => {}
        Err(counter) if scratch.header.segment == 0 => {
            counters.count(Counter::IngressMessages);
            counters.count_malformed(scratch.malformed);
            return Taken::Nobody(counter);
        }
        _ => return Taken::Left,
    }
    counters.add(Counter::IngressMessages, scratch.burst.count.into());
    counters.count_malformed(scratch.malformed);
    deliver(buffer, scratch, counters)
}

/// Walks all of the datagrams; whether there is no reason to have others see each of them by itself.
#[inline(always)]
fn walk(buffer: &LinkBuffer, scratch: &mut Scratch) -> bool {
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
    };
    let mut walk = Walk {
        buffer,
        scratch,
        is_whole: false,
    };
    repeat(MAX_DATAGRAMS, &mut walk);
    walk.is_whole
}

struct Walk<'a> {
    buffer: &'a LinkBuffer,
    scratch: &'a mut Scratch,
    /// The last one was reached.
    is_whole: bool,
}

impl Repeat for Walk<'_> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let scratch = &mut *self.scratch;
        let (start, end) = (scratch.burst.start, scratch.burst.end);
        let len = (end - start).min(scratch.burst.segment);
        scratch.walk.next_message();
        message::walk(&self.buffer.message(start, len), scratch);
        if scratch.malformed.is_some() && scratch.header.segment != 0 {
            return ControlFlow::Break(());
        }
        scratch.burst.count += 1;
        scratch.burst.start = start + len;
        if start + len >= end {
            self.is_whole = true;
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

#[inline(always)]
fn deliver(buffer: &LinkBuffer, scratch: &mut Scratch, counters: Counters) -> Taken {
    let by_packet = maps::config().is_some_and(|config| config.doorbell == DOORBELL_PACKET);
    let message = buffer.message(scratch.datagram.udp + UDP_LEN, scratch.header.message_len);
    let doorbell_by_packet = by_packet && scratch.datagram.ipv4;
    let mut delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet,
    };
    match delivery.run() {
        Some(port) if redirect(buffer, scratch, port).is_ok() => Taken::Rings,
        _ => Taken::Delivered,
    }
}

/// Turns the frame into the doorbell of the app with this port.
#[inline(always)]
fn redirect(buffer: &LinkBuffer, scratch: &Scratch, port: u16) -> Result<(), ()> {
    let datagram = &scratch.datagram;
    if scratch.header.segment != 0 {
        empty(buffer, datagram)?;
    }
    ring(buffer, datagram.udp, port)
}

/// Makes a burst one datagram without a payload: the stack would take it apart again before the first could wake
/// anybody, and all of them would wait in the app's socket.
#[inline(always)]
fn empty(buffer: &LinkBuffer, datagram: &Datagram) -> Result<(), ()> {
    buffer.resize(datagram.udp + UDP_LEN)?;
    buffer.store_u16(datagram.udp + UDP_LENGTH, UDP_LEN as u16)?;
    let len = (datagram.udp + UDP_LEN - datagram.ip) as u16;
    let (length, checksum) = (datagram.ip + IPV4_LENGTH, datagram.ip + IPV4_CHECKSUM);
    buffer.store_ipv4(length, &len.to_be_bytes(), checksum)
}
